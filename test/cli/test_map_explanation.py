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

from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.runs.points import Runs
from ctc_chattering.runs.spec import read_spec
from ctc_commands import ctc, refused
from map_specs import written

POINT = 'friction=6,rate=2e-3,law=chattering implicit,repeat=1'
RUN = 15


def test_the_parameter_file_of_a_run_is_its_setup(tmp_path: Path) -> None:
    spec, out = written(tmp_path / 'small.yaml'), tmp_path / 'out'
    words = ('map', spec, '--out', out, '--explain')
    result = ctc(*words, POINT)
    assert result.returncode == 0, result.stderr
    assert f'run {RUN}, point 3, repeat 1, seed 8, variant chattering implicit' in result.stdout
    file = out / 'explain' / f'run_{RUN}.yaml'
    assert f'ctc simulate {file}' in result.stdout
    named = Runs(read_spec(spec)).setup(RUN).changed({'plant': {'experiment': f'run_{RUN}'}})
    assert parameter_file.load(file).values == named.values
    refused(ctc(*words, str(RUN)), f'run_{RUN}.yaml: exists already', '--overwrite')
