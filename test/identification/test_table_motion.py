# Copyright 2026 The ctc_chattering maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""Tables of comma-separated values as recordings, as most public ones are."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_chattering.errors import CtcError
from ctc_chattering.identification.recording import RecordingError, RecordingFault
from ctc_chattering.identification.table_motion import read_table
import numpy as np
import pytest
from refusals import refused
import urdfs

T = np.arange(0.0, 3.0, 0.01)
Q = np.column_stack((np.sin(T), np.cos(2.0 * T)))
DQ = np.column_stack((np.cos(T), -2.0 * np.sin(2.0 * T)))
TAU = np.column_stack((3.0 * np.cos(T), np.sin(T)))


def written(path: Path, heads: str, *columns: np.ndarray) -> Path:
    """Write a table, its numbers in full."""
    np.savetxt(path, np.column_stack(columns), fmt='%.17g', delimiter=',', header=heads,
               comments='')
    return path


@pytest.mark.parametrize('heads', [
    't,q_a,q_b,dq_a,dq_b,tau_a,tau_b', 'time,q1,q2,dq1,dq2,tau1,tau2',
    't [s],q_a [rad],q_b [rad],dq_a [rad/s],dq_b [rad/s],effort_a [N·m],effort_b [N·m]'])
def test_columns_are_the_recording(tmp_path: Path, heads: str) -> None:
    motion = read_table(written(tmp_path / 'run.csv', heads, T + 7.0, Q, DQ, TAU), (),
                        urdfs.two_links())
    recording = motion.recording
    assert recording.joints == urdfs.TWO_LINKS
    for name, wanted in (('t', T), ('q', Q), ('dq', DQ), ('effort', TAU)):
        np.testing.assert_allclose(getattr(recording, name), wanted, atol=1e-12)


def test_columns_may_have_any_order_and_others_are_ignored(tmp_path: Path) -> None:
    """Desired motions, as `ctc export` writes them, are none of a joint."""
    heads = 't,tau_b,q_d_a,q_d_b,dq_d_a,ddq_d_a,q_b,temperature,q_a,tau_a'
    file = written(tmp_path / 'run.csv', heads, T, TAU[:, 1], Q, Q, Q[:, 1], T, Q[:, 0],
                   TAU[:, 0])
    recording = read_table(file).recording
    assert set(recording.joints) == {'a', 'b'} and recording.dq is None
    recording = read_table(file, ('a', 'b')).recording
    np.testing.assert_array_equal(recording.q, Q)
    assert recording.effort is not None and (recording.effort == TAU).all()


@pytest.mark.parametrize(('heads', 'fault'), [
    ('q_a,q_b,tau_a', RecordingFault.TOPIC), ('t,q_x,tau_x', RecordingFault.JOINTS),
    ('t,q1,tau1', RecordingFault.JOINTS)])
def test_a_table_with_other_columns_is_refused(
        tmp_path: Path, heads: str, fault: RecordingFault) -> None:
    file = written(tmp_path / 'run.csv', heads, T, Q)
    with refused(fault):
        read_table(file, (), urdfs.two_links())


def test_a_missing_column_is_named(tmp_path: Path) -> None:
    file = written(tmp_path / 'run.csv', 't,q_a,tau_a', T, Q)
    with pytest.raises(RecordingError, match='no column q_b') as error:
        read_table(file, ('a', 'b'), urdfs.two_links())
    assert error.value.fault is RecordingFault.TOPIC


def test_columns_without_names_are_refused(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='2 names above 3 columns'):
        read_table(written(tmp_path / 'run.csv', 't,q_a', T, Q))


@pytest.mark.parametrize('text', ['', 't,q_a\n', 't,q_a\n0,x\n1,2\n', 't,q_a\n0,1\n1\n', '\0\xff'])
def test_a_damaged_table_is_refused_in_one_line(tmp_path: Path, text: str) -> None:
    (tmp_path / 'run.csv').write_text(text, encoding='latin-1')
    with pytest.raises(CtcError) as refusal:
        read_table(tmp_path / 'run.csv')
    assert '\n' not in str(refusal.value).strip() and 'run.csv' in str(refusal.value)


def test_a_pipe_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / 'run.csv')
    with pytest.raises(CtcError, match='is a pipe; a regular file is needed'):
        read_table(tmp_path / 'run.csv')
