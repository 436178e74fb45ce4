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

"""Files of a correction: read as written, and refused for another motion, robot or law."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
import json
from pathlib import Path
import pickle
from typing import Any
import zipfile

from ctc_chattering.analysis.result import simulate
from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.learned_file import (
    check_replaceable,
    read_correction,
    write_correction,
)
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.trajectory.reference import make_motion
from learning_bags import repeated_setup
import numpy as np
import pytest

SETUP = repeated_setup(1.0)
ROWS = np.random.default_rng(4).uniform(-0.1, 0.1, (500, 2))


def arguments(setup: Setup, description: str = 'robot') -> tuple[Any, ...]:
    """Return what a file is written for, or compared with."""
    motion = motion_of(setup.reference, None, make_motion(setup.reference))
    return motion, setup.reference, setup.controller, description


def changed(node: str, **values: object) -> Setup:
    return SETUP.changed({node: values})


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """Return a file for `SETUP`."""
    path = tmp_path / 'learned.npz'
    write_correction(path, ROWS, *arguments(SETUP))
    return path


def test_a_correction_is_read_as_it_was_written(file: Path) -> None:
    np.testing.assert_array_equal(read_correction(file, *arguments(SETUP)), ROWS)


@pytest.mark.parametrize('values', [
    {'state_decimation': 1}, {'compiled': True}, {'resonance': 20.0}, {'error_limit': 1.0},
    {'effort_limit': 9.0},
    {'ka': 3.0}])
def test_parameters_without_influence_may_differ(file: Path, values: dict[str, object]) -> None:
    """The last one is none of the law."""
    setup = changed('controller', **values)
    np.testing.assert_array_equal(read_correction(file, *arguments(setup)), ROWS)


@pytest.mark.parametrize(('setup', 'description', 'difference'), [
    (changed('reference', frequency=1.0), 'robot', 'another motion'),
    (changed('reference', phase=0.1), 'robot', 'another motion'),
    (SETUP, 'other robot', 'another robot'),
    (changed('controller', law='observer_feedback'), 'robot',
     "law 'pd_gravity', and now it is 'observer_feedback'"),
    (changed('controller', kp=[100.0, 900.0]), 'robot',
     r'kp \[900.0, 900.0\], and now it is \[100.0, 900.0\]'),
    (changed('reference', joint_names=['joint2', 'joint1'], center=[1.0, 1.0]), 'robot',
     'another motion')])
def test_a_file_for_another_setup_is_refused(
        file: Path, setup: Setup, description: str, difference: str) -> None:
    with pytest.raises(CtcError, match=f'^{file}: was learned for {difference}; make it anew'):
        read_correction(file, *arguments(setup, description))


def test_law_and_robot_are_not_compared_while_they_are_not_known(file: Path) -> None:
    motion, reference, _, _ = arguments(SETUP)
    np.testing.assert_array_equal(read_correction(file, motion, reference, None, ''), ROWS)
    motion, reference, _, _ = arguments(changed('reference', phase=0.1))
    with pytest.raises(CtcError, match='another motion'):
        read_correction(file, motion, reference, None, '')


def test_a_file_does_not_write_to_the_terminal(file: Path) -> None:
    with np.load(file) as arrays:
        learned = json.loads(str(arrays['learned'])) | {'law': '\x1b[2J'}
        np.savez(file, rows=arrays['rows'], learned=json.dumps(learned))
    with pytest.raises(CtcError) as error:
        read_correction(file, *arguments(SETUP))
    assert str(error.value).isprintable()


def test_joints_in_another_order_are_other_joints(tmp_path: Path) -> None:
    """Both joints have the same motion, so that only their order tells."""
    alike = changed('reference', center=[1.0, 1.0])
    file = tmp_path / 'learned.npz'
    write_correction(file, ROWS, *arguments(alike))
    swapped = alike.changed({'reference': {'joint_names': ['joint2', 'joint1']}})
    with pytest.raises(CtcError, match=r"joints \['joint1', 'joint2'\], and now it is"):
        read_correction(file, *arguments(swapped))


@pytest.mark.parametrize('rows', [
    ROWS[1:], ROWS[:, :1], ROWS.astype(np.float32), ROWS.astype(complex), ROWS * 1.01,
    np.where(ROWS > 0.09, np.nan, ROWS), np.full((500, 2), -np.inf), np.array(0.0),
    np.zeros((0, 2))])
def test_another_correction_is_refused(rows: Array, tmp_path: Path) -> None:
    file = tmp_path / 'learned.npz'
    write_correction(file, rows, *arguments(SETUP))
    with pytest.raises(CtcError, match=r'must be 500 x 2 numbers within learning_bound, 0\.1 rad'):
        read_correction(file, *arguments(SETUP))


class Trap:
    """Code that a pickle runs."""

    def __reduce__(self) -> tuple[Callable[..., object], tuple[object, ...]]:
        return Path.touch, (Path('caught'),)


def huge(rows: int, data: int) -> bytes:
    """Return an array that says it has so many rows, with so many bytes of zeros."""
    stream = BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {'descr': '<f8', 'fortran_order': False, 'shape': (rows, 2)})
    return stream.getvalue() + bytes(data)


def zipped(**members: bytes) -> bytes:
    stream = BytesIO()
    with zipfile.ZipFile(stream, 'w', zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(f'{name}.npy', content)
    return stream.getvalue()


def array(x: Any, **how: Any) -> bytes:
    stream = BytesIO()
    np.save(stream, x, **how)
    return stream.getvalue()


LEARNED = array(json.dumps({}))
#: Contents, of which one takes half a second to make.
HOSTILE: dict[str, Callable[[], bytes]] = {
    'empty': lambda: b'', 'text': lambda: b'kp: 3', 'zip': zipped,
    'rows only': lambda: zipped(rows=array(ROWS)),
    'no json': lambda: zipped(rows=array(ROWS), learned=array('{')),
    'json list': lambda: zipped(rows=array(ROWS), learned=array('[1, 2]')),
    'deep json': lambda: zipped(rows=array(ROWS), learned=array('[' * 100_000)),
    'pickle': lambda: pickle.dumps(Trap()),
    'pickled rows': lambda: zipped(
        rows=array(np.array([Trap()]), allow_pickle=True), learned=LEARNED),
    'pickled text': lambda: zipped(rows=array(ROWS), learned=array(
        np.array(Trap(), object), allow_pickle=True)),
    '1e9 rows': lambda: zipped(rows=huge(10 ** 9, 1000), learned=LEARNED),
    'bomb': lambda: zipped(rows=huge(10 ** 7, 160_000_000), learned=LEARNED)}


@pytest.mark.parametrize('name', HOSTILE)
def test_what_is_no_learned_file_is_refused(
        name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / 'learned.npz'
    file.write_bytes(HOSTILE[name]())
    with pytest.raises(CtcError, match=f'^{file}: is damaged, or no file of ctc learn$'):
        read_correction(file, *arguments(SETUP))
    assert [x.name for x in tmp_path.iterdir()] == ['learned.npz']


def test_a_truncated_file_is_refused(file: Path) -> None:
    content = file.read_bytes()
    for length in range(0, len(content), 500):
        file.write_bytes(content[:length])
        with pytest.raises(CtcError, match='is damaged'):
            read_correction(file, *arguments(SETUP))


def test_a_missing_file_is_refused_with_advice(tmp_path: Path) -> None:
    with pytest.raises(CtcError, match='no such file; make it with: ctc learn BAG --out '):
        read_correction(tmp_path / 'none', *arguments(SETUP))


def test_only_learned_files_are_replaced(
        file: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    check_replaceable(file, overwrite=True)
    with pytest.raises(CtcError, match='exists already'):
        check_replaceable(file, overwrite=False)
    for name, content in {'arm.yaml': b'mine', 'mine.npz': zipped(rows=array(ROWS))}.items():
        mine = tmp_path / name
        mine.write_bytes(content)
        assert main(['learn', 'bag', '--out', str(mine), '--overwrite']) == 1
        assert capsys.readouterr().err.startswith(f'ctc learn: not overwritten: {mine}: ')
        assert mine.read_bytes() == content


def test_the_reference_takes_a_file_only_where_it_learns(file: Path) -> None:
    with pytest.raises(CtcError, match=r'learning_file: .* only with learning: true'):
        repeated_setup(learning_file=str(file))


def test_a_simulation_refuses_a_wrong_file(file: Path) -> None:
    """It was written for a robot with a description."""
    with pytest.raises(CtcError, match='was learned for another robot'):
        simulate(repeated_setup(learning=True, learning_file=str(file)))
