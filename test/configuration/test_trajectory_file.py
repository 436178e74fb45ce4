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

"""Files of waypoints: what they say, and one line for everything that is wrong with them."""

from __future__ import annotations

from pathlib import Path
import runpy
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.trajectory_file import read_trajectory
from ctc_chattering.errors import CtcError
import numpy as np
import parameter_files
import pytest
import yaml

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / 'config' / 'trajectories' / 'waypoints.yaml'
NAMES = ('joint1', 'joint2')


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / 'a file.yaml'


def point(**change: Any) -> dict[str, Any]:
    """Return a point with some keys changed; None takes one away."""
    whole = {'positions': [1.0, 2.0], 'time_from_start': 1.0, **change}
    return {key: value for key, value in whole.items() if value is not None}


def refused(file: Path, *words: str) -> None:
    """Assert that the error is one line with the file and all `words` in it."""
    parameter_files.refused(lambda: read_trajectory(file, NAMES), str(file), *words)


def test_values(file: Path) -> None:
    """Check integers, 1e-1, the order of the joints, and a header."""
    file.write_text("""
header: {stamp: {sec: 5, nanosec: 0}, frame_id: ''}
joint_names: [joint2, joint1]
points:
  - {positions: [1, 2.5], time_from_start: 0}
  - {positions: [3, 4], velocities: [5, 6], accelerations: [], effort: [], time_from_start: 1e-1}
  - positions: [1e-3, -4]
    velocities: [5, 6]
    accelerations: [7, 8]
    time_from_start: 1.500000001
  - {positions: [0, 0], time_from_start: 3}
""")
    names, times, points = read_trajectory(file, NAMES)
    assert names == NAMES
    assert times == (0, 100_000_000, 1_500_000_001, 3_000_000_000)
    assert points == (((2.5, 1.0), (), ()), ((4.0, 3.0), (6.0, 5.0), ()),
                      ((-4.0, 1e-3), (6.0, 5.0), (8.0, 7.0)), ((0.0, 0.0), (), ()))


# Of what is allowed: test_waypoints.py.
@pytest.mark.parametrize(('change', 'words'), [
    ({'positions': None}, ('positions', 'one per joint')),
    ({'positions': [1.0, 'x']}, ('positions', "'x'", 'finite numbers')),
    ({'velocities': 'fast'}, ('velocities', 'fast')), ({'effort': [1.0, 2.0]}, ('effort', 'none')),
    ({'velocity': [0, 0]}, ('velocity', 'positions')),
    ({'time_from_start': None}, ('time_from_start', 'number')),
    ({'time_from_start': -1}, ('time_from_start', '-1', '>= 0')),
    ({'time_from_start': True}, ('time_from_start', 'True')),
    ({'time_from_start': {'sec': 1, 'nanosec': 5}}, ('time_from_start', 'nanosec', 'number')),
    ({'time_from_start': 0.5}, ('time_from_start', '0.5', 'point before'))])
def test_what_is_no_point(file: Path, change: dict[str, Any], words: tuple[str, ...]) -> None:
    """Check that the line names the file, the point and what is allowed."""
    tree = {'joint_names': list(NAMES), 'points': [
        point(time_from_start=0.5), point(**change), point(time_from_start=2.0)]}
    file.write_text(yaml.safe_dump(tree))
    refused(file, 'points[1]', 'allowed', *words)


@pytest.mark.parametrize(('content', 'words'), [
    (None, ('No such file',)), (b'- a', ('mapping',)), (b'a: [1', ('not a YAML file',)),
    (b'{a: 1}\n---\n{b: 1}', ('not a YAML file', 'single document')),
    (b'{joint_names: [joint1, joint2]}', ('points', 'list')), (b'{points: []}', ('joint_names',)),
    (b'{joint_names: [joint1, joint2], points: []}', ('points', 'one or more')),
    (b'{joint_names: [joint1, joint2], points: [5]}', ('points[0]', 'mapping')),
    (b'{joint_names: [joint1, joint2], points: &a [*a]}', ('Circular reference',)),
    (b'{joint_names: [joint1, joint2], point: []}', ("'point'", 'points')),
    (b'{joint_names: [1, 2], points: []}', ('joint_names', 'list of strings')),
    (b'{joint_names: [joint1, x], points: [{positions: [1, 2], time_from_start: 0}]}',
     ('joint_names', "'x'", 'joint1, joint2'))])
def test_what_is_no_trajectory(file: Path, content: bytes | None, words: tuple[str, ...]) -> None:
    """Check that the line names the file and what is wrong."""
    if content is not None:
        file.write_bytes(content)
    refused(file, *words)


def test_the_example_is_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that every file below config is packaged where it stands."""
    seen: dict[str, Any] = {}
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr('setuptools.setup', seen.update)
    runpy.run_path(str(ROOT / 'setup.py'))
    packaged = {f'{target.removeprefix("share/ctc_chattering/")}/{Path(name).name}': name
                for target, names in seen['data_files'] for name in names if 'config' in target}
    assert all(target == name for target, name in packaged.items())
    assert set(packaged) == {
        str(path.relative_to(ROOT)) for path in (ROOT / 'config').rglob('*') if path.is_file()}


def test_a_parameter_file_names_it() -> None:
    """Check the whole way: parameters, file, simulation that meets the waypoints."""
    setup = parameter_file.load(None, {
        'plant': {'duration': 4.5}, 'reference': {'trajectory_file': str(EXAMPLE)},
        'controller': {'ka': [12.0, 12.0], 'switching': 'implicit_observer'}})
    assert setup.route == read_trajectory(EXAMPLE, NAMES)
    run = simulate(setup).run
    for k, q in ((0, [0.0, 0.0]), (2000, [1.0, 0.5]), (4000, [2.0, 1.5])):
        assert run.q_d[k].tolist() == q
        np.testing.assert_allclose(run.q[k], q, atol=1e-3)
    with pytest.raises(CtcError, match=r'none\.yaml'):
        parameter_file.load(None, {'reference': {'trajectory_file': 'none.yaml'}})
    assert parameter_file.load(None).route is None
