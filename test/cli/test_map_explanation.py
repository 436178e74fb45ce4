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

"""`ctc map --explain`: the run that it writes is that of the map."""

from __future__ import annotations

import json
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs import store
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.spec import read_spec
from ctc_commands import ctc, refused
from map_specs import SMALL, written
import numpy as np

POINT = 'friction=6,rate=2e-3,law=chattering implicit,repeat=1'
RUN = 15


def table(spec: Path, out: Path) -> None:
    """Write a map with the run alone."""
    runs = Runs(read_spec(spec))
    directory = store.Directory(out, store.about(runs), store.schema(runs.spec))
    directory.merge([store.compute(runs, store.version(), [RUN])])


def test_a_run_is_written_drawn_and_named(tmp_path: Path) -> None:
    """Check that its parameter file is its setup, and `ctc simulate` gives the same samples."""
    spec, out = written(tmp_path / 'small.yaml', failure={'error_above': 1e-9}), tmp_path / 'out'
    table(spec, out)
    words = ('map', spec, '--out', out, '--explain')
    result = ctc(*words, POINT)
    assert result.returncode == 0, result.stderr
    assert f'run {RUN}, point 3, repeat 1, seed 8, variant chattering implicit' in result.stdout
    assert 'in the map: error: joint' in result.stdout
    folder = out / 'explain' / str(RUN)
    assert {x.name for x in folder.iterdir()} == {
        'run.yaml', 'trajectory.npz', 'metrics.json', 'figures', 'index.html',
        'samples'}
    entry = json.loads((folder / 'metrics.json').read_text(encoding='utf-8'))['runs'][0]
    assert entry['window_s'] == [0.05, 0.1]
    assert entry['rms_error_rad'] is not None
    setup = Runs(read_spec(spec)).setup(RUN)
    loaded = parameter_file.load(folder / 'run.yaml')
    named = setup.changed({'plant': {'experiment': f'run_{RUN}'}})
    assert loaded.values == named.values
    assert ctc('simulate', '--params-file', folder / 'run.yaml', '--out', tmp_path / 'simulated'
               ).returncode == 0
    with np.load(folder / 'trajectory.npz') as mine, np.load(
            tmp_path / 'simulated' / 'trajectory.npz') as other:
        assert mine['q'].tobytes() == other['q'].tobytes()
    refused(ctc(*words, str(RUN)), 'run.yaml: exists already', '--overwrite')


def test_a_run_that_diverges_is_drawn_up_to_there(tmp_path: Path) -> None:
    """Check samples that end before the error does, and the reason; none where it starts so."""
    limit = {'parameter': 'controller.error_limit', 'values': [1e-9, 2e-4]}
    spec = written(tmp_path / 'brief.yaml', **{
        **SMALL, 'axes': {'limit': limit}, 'laws': ['compensation'], 'uncertain': {},
        'overrides': {'plant': SMALL['overrides']['plant'] | {'velocity_noise': [0.0, 0.0]}}})
    out = tmp_path / 'out'
    words = ('map', spec, '--out', out, '--explain')
    result = ctc(*words, 'limit=2e-4,repeat=0')
    assert result.returncode == 0, result.stderr
    assert 'this run ends: the position error of joint' in result.stdout
    folder = out / 'explain' / '2'
    with np.load(folder / 'trajectory.npz') as arrays:
        assert 1 < len(arrays['t']) < 100
        assert np.abs(arrays['q_d'] - arrays['q']).max() <= 2e-4
    assert json.loads((folder / 'metrics.json').read_text())['runs'][0]['experiment'] == 'run_2'
    at_once = ctc(*words, '0')
    assert at_once.returncode == 0, at_once.stderr
    assert 'this run ends' in at_once.stdout
    assert {x.name for x in (out / 'explain' / '0').iterdir()} == {'run.yaml'}
