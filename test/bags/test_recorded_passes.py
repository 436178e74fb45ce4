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

"""`ctc learn`: what the passes in a bag teach is what the learner of the run has learned."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

from bags import Entry, parameters, write_bag
from ctc_chattering.analysis.result import Result, simulate
from ctc_chattering.analysis.terms import Replay, ReplayVerdict
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.recorded_passes import learn_from_bag
from ctc_chattering.cli.ctc import main
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.trajectory_file import write_trajectory
from ctc_chattering.errors import CtcError
from ctc_chattering.learning.learned_file import read_correction
from ctc_chattering.trajectory.waypoints import Route
from learning_bags import learning_entries, record_run, repeated_setup
import numpy as np
import pytest
from recorded_runs import assert_equal

TRACKING = '/controller/tracking'
#: Half as many samples take half the time.
repeated = partial(repeated_setup, control_period=2e-3)


@pytest.fixture(scope='module')
def plain() -> tuple[Setup, Result]:
    """Return a run without learning."""
    setup = repeated()
    return setup, simulate(setup)


@pytest.fixture(scope='module')
def learning() -> tuple[Setup, Result]:
    """Return a run that learns."""
    setup = repeated(learning=True)
    return setup, simulate(setup)


def first_error(result: Result) -> float:
    """Return the norm of the RMS errors in the first pass."""
    assert result.learner is not None
    return float(np.linalg.norm(result.learner.passes[0].rms))


def test_a_bag_of_a_learning_run_teaches_what_the_run_learned(
        learning: tuple[Setup, Result], tmp_path: Path) -> None:
    setup, result = learning
    write_bag(tmp_path / 'bag', learning_entries(setup, result))
    learned = learn_from_bag(tmp_path / 'bag', {})
    learner = result.learner
    assert learner is not None and len(learner.passes) == 3
    for of_bag, of_run in zip(learned.learner.passes, learner.passes, strict=True):
        assert of_bag[:2] == of_run[:2]
        # In a bag the correction is a difference of two positions.
        assert of_bag.rms == pytest.approx(of_run.rms, rel=1e-9)
    assert learner.rows is not None
    assert learned.learner.rows == pytest.approx(learner.rows, abs=1e-12)


def test_a_run_begins_with_what_a_bag_without_learning_taught(
        plain: tuple[Setup, Result], learning: tuple[Setup, Result], tmp_path: Path) -> None:
    write_bag(tmp_path / 'bag', learning_entries(*plain))
    file = tmp_path / 'new folder' / 'learned.npz'
    assert main(['learn', str(tmp_path / 'bag'), '--out', str(file)]) == 0
    result = simulate(repeated(2.0, learning=True, learning_file=str(file)))
    assert first_error(result) < 0.5 * first_error(learning[1])


def test_errors_of_a_bag_are_those_from_the_desired_motion(
        learning: tuple[Setup, Result], tmp_path: Path) -> None:
    setup, result = learning
    write_bag(tmp_path / 'bag', learning_entries(setup, result))
    read = read_bag(tmp_path / 'bag')
    assert_equal(read.run, result.run)
    np.testing.assert_array_equal(read.e, result.e)
    np.testing.assert_array_equal(read.de, result.de)
    assert read.replay == Replay(ReplayVerdict.EXACT)
    assert np.abs(read.run.q_d - read.q_d).max() > 1e-3
    rms_error = read.metrics()['rms_error_rad']
    assert rms_error == result.metrics()['rms_error_rad']
    inside = read.t >= read.window[0]
    np.testing.assert_allclose(
        rms_error, np.sqrt(np.mean((read.q_d - read.q)[inside] ** 2, axis=0)), rtol=1e-9)
    signals = read.signals
    np.testing.assert_allclose(  # A page computes q so.
        signals['q_d'].values - signals['e'].values, read.q, rtol=0, atol=1e-12)


def test_an_error_is_not_known_where_the_desired_motion_was_not_recorded(
        learning: tuple[Setup, Result], tmp_path: Path) -> None:
    setup, result = learning
    found = [x for x in learning_entries(setup, result)
             if x.topic != '/reference/desired' or not 1.0 <= x.t / 1e9 < 1.05]
    write_bag(tmp_path / 'bag', found)
    read = read_bag(tmp_path / 'bag')
    unknown = (read.t >= 1.0) & (read.t < 1.05)
    assert np.isnan(read.e[unknown]).all()
    np.testing.assert_array_equal(read.e[~unknown], result.e[~unknown])


def test_waypoints_are_learned_at_their_end(tmp_path: Path) -> None:
    rest = (0.0, 0.0)
    points = [((3.3, 1.5), rest, rest), ((3.0, 1.8), rest, rest), ((3.14, 1.57), rest, rest)]
    times = [1_000_000_000, 2_000_000_000, 3_000_000_000]
    route = Route(('joint1', 'joint2'), times, points)
    write_trajectory(route, tmp_path / 'way.yaml')
    setup = repeated(3.5, trajectory_file=str(tmp_path / 'way.yaml'))
    before = record_run(tmp_path / 'bag', setup)
    file = tmp_path / 'learned.npz'
    assert main(['learn', str(tmp_path / 'bag'), '-o', str(file)]) == 0
    after = simulate(repeated(
        3.5, trajectory_file=str(tmp_path / 'way.yaml'), learning=True, learning_file=str(file)))
    moves = before.t <= 3.0
    assert np.square(after.e[moves]).mean() < 0.25 * np.square(before.e[moves]).mean()


def left_out(path: Path, found: list[Entry]) -> list[tuple[float, str]]:
    """Return why passes in messages are left out."""
    write_bag(path / 'bag', found)
    return learn_from_bag(path / 'bag', {}).left_out


def test_a_pass_with_a_gap_is_left_out(plain: tuple[Setup, Result], tmp_path: Path) -> None:
    found = [x for x in learning_entries(*plain)
             if x.topic != TRACKING or not 1.1 < x.t / 1e9 < 1.3]
    (t, reason), *_ = left_out(tmp_path, found)
    assert t == 1.5 and reason == 'errors of 0.2 s are missing in the pass'


def test_a_pass_in_which_the_controller_was_elsewhere_is_left_out(
        plain: tuple[Setup, Result], tmp_path: Path) -> None:
    found = learning_entries(*plain)
    for topic, stamp, message in found:
        if topic == TRACKING and 1.2 <= stamp / 1e9 < 1.23:
            message.position[:2] += 0.05
    (t, reason), *_ = left_out(tmp_path, found)
    assert t == 1.2 and reason == 'the controller or its reference left the motion'


def test_the_last_pass_is_left_out_unless_it_is_whole(
        plain: tuple[Setup, Result], tmp_path: Path) -> None:
    found = learning_entries(*plain)
    cut = [x for x in found if x.t <= 3_900_000_000]
    assert left_out(tmp_path, cut) == [(3.9, 'the recording ends in the pass')]
    ended = [x for x in found if x.t <= 1_500_000_000]
    write_bag(tmp_path / 'ended', ended)
    learned = learn_from_bag(tmp_path / 'ended', {})
    assert len(learned.learner.passes) == 1 and learned.learner.rows is not None


@pytest.mark.parametrize(('change', 'reason'), [
    (lambda found: [x for x in found if x.topic != '/reference/parameters'],
     'parameters of the reference are missing'),
    (lambda found: [x for x in found if x.topic != '/controller/parameters'],
     'this package did not record the bag'),
    (lambda found: [*found, parameters('controller', 10 ** 9, {'kp': (800.0, 900.0)}, False)],
     'or parameters change'),
    (lambda found: [x for x in found if x.topic != TRACKING],
     'there is no error of the reference on controller/tracking'),
    (lambda found: [x for x in found if x.t < 1_400_000_000],
     'there is no whole pass to learn from'),
], ids=['reference', 'controller', 'change', 'tracking', 'short'])
def test_a_bag_without_passes_is_refused(
        change: Callable[[list[Entry]], list[Entry]], reason: str, plain: tuple[Setup, Result],
        tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_bag(tmp_path / 'bag', change(learning_entries(*plain)))
    file = tmp_path / 'learned.npz'
    assert main(['learn', str(tmp_path / 'bag'), '--out', str(file)]) == 1
    assert reason in capsys.readouterr().err
    assert not file.exists()


def test_the_command_prints_the_passes_and_writes_what_the_reference_reads(
        plain: tuple[Setup, Result], tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    setup, result = plain
    write_bag(tmp_path / 'bag', learning_entries(setup, result))
    file = tmp_path / 'learned.npz'
    arguments = ['learn', str(tmp_path / 'bag'), '--out', str(file)]
    assert main(arguments) == 0
    out = capsys.readouterr().out
    assert out.splitlines()[1].split() == ['pass', 'from', '[s]', 'to', '[s]', 'joint1', 'joint2']
    assert out.splitlines()[2].split()[:3] == ['1', '1', '1.5']
    assert f'learning: true and learning_file: {file}' in out
    learner = learn_from_bag(tmp_path / 'bag', {}).learner
    assert learner.motion is not None
    rows = read_correction(file, learner.motion, setup.reference, setup.controller, '')
    np.testing.assert_array_equal(rows, learner.rows)
    assert main(arguments) == 1
    assert main([*arguments, '--overwrite']) == 0


def test_a_learned_file_of_another_name_is_not_needed_to_learn_again(tmp_path: Path) -> None:
    """A bag may name a learned file that is not on this computer."""
    setup = repeated(2.0, learning=True)
    result = simulate(setup)
    found = [x for x in learning_entries(setup, result) if x.topic != '/reference/parameters']
    values = {**setup.reference.as_mapping(), 'learning_file': 'elsewhere.npz'}
    write_bag(tmp_path / 'bag', [*found, parameters('reference', 0, values, True)])
    assert len(learn_from_bag(tmp_path / 'bag', {}).learner.passes) == 1
    with pytest.raises(CtcError, match=r'elsewhere\.npz: there is no such file'):
        simulate(setup.changed({'reference': {'learning_file': 'elsewhere.npz'}}))
