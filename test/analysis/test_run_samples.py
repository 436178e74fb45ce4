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

"""Samples of runs for the plots of a page, exact or rounded."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from ctc_chattering.analysis.run_samples import write_samples
from ctc_chattering.analysis.signals import PARTS
from made_up_runs import made_up
import numpy as np
from page_samples import columns
import pytest


def test_runs_of_an_experiment_are_plotted_together(tmp_path: Path) -> None:
    one, two = made_up(2), made_up(2, law='compensation')
    other = dataclasses.replace(one, experiment='</script>')
    plots = write_samples([one, other, two], tmp_path)
    assert [[run.name for run in x.runs] for x in plots] == [
        ['chattering', 'compensation'], ['chattering']]
    assert len({run.path for x in plots for run in x.runs}) == len(list(tmp_path.iterdir())) == 3
    found = columns(plots[0].runs[1].path)
    assert np.abs(found['q_d', 1] - two.run.q_d[:, 1]).max() < 1e-9
    assert np.allclose(found['e', 1], 0.1, rtol=1e-6)
    assert np.array_equal(found['torque', 0], two.run.tau[:, 0].astype('f4'))
    assert np.array_equal(found['V', 0], two.terms.lyapunov.astype('f4'))
    # The parts of the torque only where the run is alone; as published, so that they add up.
    alone = columns(plots[1].runs[0].path)
    assert ('robust', 0) not in found and ('robust', 0) in alone
    parts = other.terms
    total = (parts.nominal - parts.compensation - parts.robust)[:, 1]
    assert sum(alone[x, 1] for x in PARTS) == pytest.approx(total, rel=1e-5, abs=1e-5)


def test_the_caption_names_runs_that_are_cut_off(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long' not in plots.caption
    monkeypatch.setattr('ctc_chattering.analysis.run_samples.MAX_COUNT', 1000)
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long to show completely: friction: chattering to 0.' in plots.caption
    found = columns(plots.runs[0].path)['t', 0]
    assert np.array_equal(found, made_up(2).run.t[:len(found)]) and 50 < len(found) < 200


def test_samples_of_a_long_run_are_rounded(tmp_path: Path) -> None:
    """Check by how much, what the caption says, and half the bytes."""
    rng = np.random.default_rng(4)
    made = made_up(2, 80_000)
    t = made.run.t + rng.normal(scale=1e-5, size=80_000)
    noisy = dataclasses.replace(made, run=dataclasses.replace(
        made.run, t=t, tau=made.run.tau + rng.normal(size=(80_000, 2))))
    exact, rounded = noisy, dataclasses.replace(noisy, law_terms=dataclasses.replace(
        made.terms, t=t))
    (short,), (long,) = (write_samples([x], tmp_path / str(k)) for k, x in enumerate(
        (dataclasses.replace(exact, law_terms=made_up(2, 100).terms), rounded)))
    assert 'rounded' not in short.caption
    assert 'Values of friction: chattering are rounded by at most 2e-5 of each' in long.caption
    one, two = (columns(x.runs[0].path) for x in (short, long))
    assert np.array_equal(one['t', 'e'], t)
    assert np.abs(two['t', 'e'] - t).max() < 5e-7
    tau = noisy.run.tau[:, 1]
    assert np.array_equal(one['torque', 1], tau.astype('f4'))
    assert (np.abs(two['torque', 1] - tau) <= 1.6e-5 * np.abs(tau)).all()
    numbers = [sum(x.size for x in found.values()) for found in (one, two)]
    sizes = [x.runs[0].path.stat().st_size / n for x, n in zip((short, long), numbers)]
    assert sizes[1] < 0.8 * sizes[0] < 4.0
