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

"""Samples that a page reads: the same numbers, or the extremes of stretches."""

from __future__ import annotations

import base64
import dataclasses
import json
from pathlib import Path
import re
from typing import Any

from ctc_chattering.analysis.interactive_plots import PARTS
from ctc_chattering.analysis.run_page import decimated, write_samples
from made_up_runs import made_up
import numpy as np
import pytest


def columns(path: Path) -> dict[tuple[str, int], Any]:
    """Return the columns of a file by signal and joint, read as the page does."""
    found = re.fullmatch(r'ctcSamples\["([\w.-]+)"\] = "([\w+/=]+)";\n', path.read_text())
    assert found is not None and found[1] == path.stem
    data = base64.b64decode(found[2])
    size = int.from_bytes(data[:4], 'little')
    head, at, result = json.loads(data[4:4 + size]), -(-(4 + size) // 8) * 8, {}
    for name, joint, width in head['columns']:
        result[name, joint] = np.frombuffer(data, f'<f{width}', head['count'], at)
        at += -(-width * head['count'] // 8) * 8
    return result


def test_runs_of_an_experiment_are_plotted_together(tmp_path: Path) -> None:
    one, two = made_up(2), made_up(2, law='compensation')
    other = dataclasses.replace(one, experiment='</script>')
    plots = write_samples([one, other, two], tmp_path)
    assert [[run.name for run in x.runs] for x in plots] == [
        ['chattering', 'compensation'], ['chattering']]
    assert len({run.path for x in plots for run in x.runs}) == len(list(tmp_path.iterdir())) == 3
    found = columns(plots[0].runs[1].path)
    assert np.array_equal(found['q', 1], two.run.q[:, 1])
    assert np.array_equal(found['q', 1] + found['e', 1].astype(float), two.run.q_d[:, 1]
                          ) or np.allclose(found['e', 1], 0.1, rtol=1e-6)
    assert np.array_equal(found['torque', 0], two.run.tau[:, 0].astype('f4'))
    assert np.array_equal(found['V', 0], two.terms.lyapunov.astype('f4'))
    # The parts of the torque only where the run is alone; as published, so that they add up.
    alone = columns(plots[1].runs[0].path)
    assert ('robust', 0) not in found and ('robust', 0) in alone
    parts = other.terms
    total = (parts.nominal - parts.compensation - parts.robust)[:, 1]
    assert sum(alone[x, 1] for x in PARTS) == pytest.approx(total, rel=1e-5, abs=1e-5)


@pytest.mark.parametrize('samples', [10, 999, 1000, 12_345])
def test_long_runs_keep_their_extremes(samples: int) -> None:
    rng = np.random.default_rng(samples)
    t, (q, e) = 1e-3 * np.arange(samples, dtype=float), rng.normal(size=(2, samples, 2))
    e[samples // 3, 1] = 99.0
    few, signals = decimated(t, {'q': q, 'e': e}, 5000)
    assert len(few) * 5 <= 5000 + 2 * 5 and (np.diff(few) >= 0.0).all()
    assert (len(few) == samples) == (samples <= 1000)
    for whole, found in ((q, signals['q']), (e, signals['e'])):
        assert len(found) == len(few)
        assert np.array_equal(found.max(axis=0), whole.max(axis=0))
        assert np.array_equal(found.min(axis=0), whole.min(axis=0))
    if samples > 1000:
        # In their order: between a stretch's begin and end no value is beyond the two.
        every = -(-2 * samples // 1000)
        part = e[every:2 * every, 0]
        assert sorted(signals['e'][2:4, 0]) == [part.min(), part.max()]


def test_a_page_says_what_it_does_not_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch
                                           ) -> None:
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long' not in plots.caption
    monkeypatch.setattr('ctc_chattering.analysis.run_page.MOST', 1000)
    (plots,) = write_samples([made_up(2)], tmp_path)
    assert 'Too long to show every sample of: friction: chattering' in plots.caption
    assert len(columns(plots.runs[0].path)['t', 0]) < 300
