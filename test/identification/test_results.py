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

"""What is printed, shown, drawn and written of an identification of made-up numbers."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import cast

from ctc_chattering.analysis.page import FigureFile
from ctc_chattering.analysis.tables import WIDTH
from ctc_chattering.identification.figures import friction_figure, torque_figure
from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import GainBasis, LatestTorque, Recommendation
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import MeasuredPerturbation
from ctc_chattering.identification.perturbation_bound import PerturbationBound
from ctc_chattering.identification.results import IdentificationResults, write_page
from ctc_chattering.identification.sensors import Clock
from ctc_chattering.identification.timing import Timing
from ctc_chattering.identification.verdict import Verdict
from figure_layout import overlaps
import numpy as np
import pytest

NAMES = tuple(f'left_manipulator_of_the_second_cell_joint_{k}' for k in range(7))
#: A number that is only of the joint that is refused.
SECRET = 7.654321
#: Values of unseen torque that is not explained.
UNEXPLAINED = {'identified_rms': 0.918, 'recording_rms': 5.16, 'systematic_rms': 0.34}


def joint_friction(size: float) -> JointFriction:
    """Return friction of which each direction has this size [N·m]."""
    level, none = Estimate(size, 0.01, 'N*m'), Estimate.none()
    return JointFriction(coulomb=level, forwards=level, backwards=level,
                         viscous=Estimate(0.3, 0.01, 'N*m*s/rad'), stribeck=none,
                         stribeck_velocity=none, load=none, dead_band=none)


def results(refused: int = 2) -> IdentificationResults:
    """Return results of seven joints of long names, one of which is not usable."""
    n = len(NAMES)
    size, lags, rms = np.full(n, 1.0), np.full(n, 1e-3), np.full(n, 5.0)
    size[refused] = lags[refused] = SECRET
    timing = Timing('command', 1.0, lags, {1: np.stack((lags, lags, lags))},
                    np.full((3, n), np.inf), np.ones(n, bool))
    rate = Estimate(None, at_least=680.0, unit='N*m/s')
    findings = (Finding(Reason.UNITS, Severity.REFUSED, refused, {
                    'signal': 'effort', 'factor': 0.1, 'error': 0.01}),
                Finding(Reason.UNEXPLAINED, Severity.CARE, 3, UNEXPLAINED),
                Finding(Reason.DROPPED, Severity.CARE, values={'recording': 'run', 'count': 99}),
                Finding(Reason.ROTOR, Severity.NOTE, 1, {
                    'file': 'x.urdf', 'rotor': Estimate(0.5)}))
    prediction = SimpleNamespace(
        recording_rms=rms, model_rms=rms, with_friction_rms=0.1 * rms, identified_rms=0.01 * rms,
        typical_rms=0.01 * rms, systematic_rms=0.0 * rms)
    fit = SimpleNamespace(
        data=SimpleNamespace(moving=np.ones(n, bool), used=np.ones((9, n), bool)),
        torque=lambda *_: np.full(9, 5.0))
    found = SimpleNamespace(
        joints=NAMES, timing=timing, findings=findings, fit=fit, prediction=prediction,
        friction=[joint_friction(SECRET if k == refused else 5.12345 + k) for k in range(n)],
        encoder=[Estimate(1e-5)] * n, noise=[Estimate.none()] * n,
        constant=[Estimate(SECRET if k == refused else 1.0, 0.1) for k in range(n)],
        rate=n * [rate], bodies=None, duration=20.0, clock=Clock(1e-3, 0))
    run = cast(MeasuredPerturbation, SimpleNamespace(peak=size, tail=size))
    bound = PerturbationBound(size, size, size, size, size, size, ())
    basis = GainBasis(run, bound, (1,), 1e-3, 1e-3, LatestTorque(3e-3, 1e-3, 1), 1e-5, 2.0)
    recommended = Recommendation({'ka': size.tolist(), 'kv': [200.0] * n}, basis)
    return IdentificationResults('run', cast(Identification, found), run, recommended)


def test_lines_of_the_terminal_are_short_and_verdicts_come_first() -> None:
    lines = results().text().splitlines()
    assert max(map(len, lines)) <= WIDTH == 100
    assert lines[0] == 'Verdict'
    # First of all which joints are usable, and what to do next.
    assert lines[1].startswith(f'  Usable with care: {NAMES[0]},')
    # Then the doubts that all joints share, and those of each.
    starts = [next(k for k, line in enumerate(lines) if line.startswith(f'  {start}: '))
              for start in ('all joints', NAMES[0], f'{NAMES[2]}: not usable')]
    assert starts == sorted(starts)
    # The cut names still tell the joints apart.
    rows = [line for line in lines if '…' in line]
    assert len({row.split()[0] for row in rows}) == 7


def test_a_joint_that_is_not_usable_has_no_numbers(tmp_path: Path) -> None:
    one = results()
    page = tmp_path / 'index.html'
    write_page(one, [], page, {})
    for text in (one.text(), page.read_text()):
        assert '5.12' in text and str(SECRET)[:4] not in text
        assert 'not usable' in text and '--torque-constant' in text
    found = one.as_mapping()
    assert [x['verdict'] for x in found['verdicts']] == [
        *['usable with care'] * 2, 'not usable', *['usable with care'] * 4]
    bad = found['friction'][2]
    assert bad['coulomb'] == {'value': None, 'reason': 'not usable'}
    assert str(SECRET) not in json.dumps(found)
    for values in (found['peak_perturbation_nm'], found['recommended']['ka']['value']):
        assert values[2] is None and values[0] is not None
    assert found['torque_constant'][2]['value'] is None
    drives = found['delays_possible'][0]
    for values in (drives['actuator_lag_s'], drives['actuator_lag_interval_95_s']):
        assert values[2] is None and values[0] is not None


def test_the_page_has_figures_then_verdicts_then_numbers(tmp_path: Path) -> None:
    page = tmp_path / 'index.html'
    figure = FigureFile(tmp_path / 'torque.svg', 'Torque', 'Each block of time is predicted')
    write_page(results(), [figure], page, {})
    text = page.read_text()
    order = [text.index(x) for x in ('<img', '<h2>Verdicts', '<h2>Numbers')]
    assert order == sorted(order)
    assert text.count('<p class="attention">All joints are usable with care: ') == 1


def test_a_column_without_any_number_is_left_out() -> None:
    heads = {table.title: table.heads for table in results().tables()}
    assert 'velocity noise [rad/s]' in heads['Sensors']
    one = results()
    unknown = [Estimate.unknown(Gap.HARDLY_MOVES)] * len(NAMES)
    found = dataclasses.replace(one, found=cast(Identification, SimpleNamespace(
        **{**vars(one.found), 'noise': unknown, 'encoder': unknown})))
    assert 'Sensors' not in {table.title for table in found.tables()}


def test_notes_stand_below_the_tables() -> None:
    text = ' '.join(results().text().split())
    assert text.index('Perturbation') < text.index(f'{NAMES[1]}: x.urdf has a rotor inertia')
    # A bound stands in the table.
    assert ' at least 680 ' in text


def made_up(n: int) -> Identification:
    """Return what figures read of n joints."""
    t = 0.1 * np.arange(50)
    torque = np.sin(t)[:, None] * np.ones(n)
    used = np.ones((50, n), bool)
    data = SimpleNamespace(used=used, beyond_model=torque, windows=SimpleNamespace(
        velocity=np.cos(t)[:, None] * np.ones(n)))
    fit = SimpleNamespace(data=data, torque=lambda joint, *_: 0.5 * torque[:, joint])
    prediction = SimpleNamespace(t=t, measured=torque, model=0.2 * torque,
                                 with_friction=0.8 * torque, identified=0.9 * torque)
    return cast(Identification, SimpleNamespace(
        fit=fit, prediction=prediction, friction=[joint_friction(1.0)] * n))


def verdicts_of(n: int) -> list[Verdict]:
    """Return verdicts of joints of long names, of which every second one is not usable."""
    return [Verdict(f'a_joint_of_the_left_arm_of_a_robot_{k}', (
        Severity.CARE, Severity.REFUSED)[k % 2], ()) for k in range(n)]


@pytest.mark.parametrize('n', [2, 7])
def test_a_friction_figure_has_no_curve_of_an_unusable_joint(n: int) -> None:
    friction = friction_figure(made_up(n), verdicts_of(n))
    assert not overlaps(friction.figure)
    good, bad = friction.figure.axes[:2]
    # Dots, and the curve of each direction.
    assert [len(good.lines), len(bad.lines)] == [3, 1]
    assert bad.get_title(loc='left').endswith(': not usable')
    assert 'not usable' in friction.caption


@pytest.mark.parametrize('n', [2, 7])
def test_torque_is_drawn_over_time_with_all_predictions(n: int) -> None:
    torque = torque_figure(made_up(n), verdicts_of(n))
    assert not overlaps(torque.figure)
    assert len(torque.figure.axes) == n
    lines = {line.get_label(): line.get_ydata() for line in torque.figure.axes[0].lines}
    assert list(lines) == ['recorded', 'model as given', 'model with friction', 'identified']
    assert lines['model with friction'] == pytest.approx(0.8 * np.sin(0.1 * np.arange(50)))
