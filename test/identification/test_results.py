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

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

from ctc_chattering.analysis.tables import WIDTH
from ctc_chattering.identification import figures
from ctc_chattering.identification.findings import (
    ALL_JOINTS,
    Estimate,
    Finding,
    Kind,
    NONE,
    Severity,
)
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.results import IdentificationResults, write_page
from ctc_chattering.identification.sensors import Clock
from ctc_chattering.identification.verdict import Verdict
from figure_layout import overlaps
import numpy as np
import pytest

NAMES = tuple(f'left_manipulator_of_the_second_cell_joint_{k}' for k in range(7))
#: A number that is only of the joint that is refused.
SECRET = 7.654321
WHY = ('31.4% of the friction, 1.2 N*m RMS, depends on the way since a reversal: backlash, an '
       'elastic joint, or friction that builds up over a way')


def results(refused: int = 2) -> IdentificationResults:
    """Return results of seven joints of long names, one of which is not usable."""
    n = len(NAMES)
    none = Estimate.none(NONE)

    def friction(i: int) -> JointFriction:
        one = Estimate(SECRET if i == refused else 5.12345 + i, 0.01, 'N*m')
        return JointFriction(one, one, one, Estimate(0.0, 0.01), one, none, none, none)
    size = np.full(n, 1.0)
    size[refused] = SECRET
    numbers = [Estimate(1.0, 0.1)] * n
    lags = np.full(n, 1e-3)
    lags[refused] = SECRET
    timing = SimpleNamespace(
        drive=(1.0, lags, 0.1 * lags), source='command', of_commands=None,
        delays={1: np.stack((lags, lags, lags))})
    rate = [Estimate.none('at least 680 N*m/s: the drive follows commands that change so fast')]
    findings = (Finding(Kind.NO_NUMBER, refused, WHY, 'reduce the backlash'),
                Finding(Kind.DOUBT, 3, WHY), Finding(Kind.DOUBT, ALL_JOINTS, 'base tilted'),
                Finding(Kind.NOTE, 1, 'a note'))
    found = SimpleNamespace(
        joints=NAMES, friction=[friction(i) for i in range(n)], timing=timing, findings=findings,
        unexplained=(), encoder=[Estimate(1e-5)] * n, noise=[none] * n, scale=numbers,
        rotor=numbers, dead_band=numbers, rate=n * rate, tilt=(), bodies=None, errors=[],
        duration=20.0, selected=SimpleNamespace(attributed=True, explanation=None),
        clock=Clock(1e-3, 0),
        data=SimpleNamespace(torque=np.zeros((1, n)), way=np.zeros((1, n))))
    recommended = SimpleNamespace(
        findings=(), ka=size.tolist(), values={'ka': (size.tolist(), 'of the largest |P|')},
        trials=())
    run = SimpleNamespace(peak=size)
    return IdentificationResults('run', cast(Any, found), cast(Any, run),
                                 cast(Any, recommended))


def test_lines_of_the_terminal_are_short_and_verdicts_come_first() -> None:
    lines = results().text().splitlines()
    assert max(map(len, lines)) <= WIDTH == 100
    assert lines[0] == 'Verdict'
    # First of all which joints are usable, and what to do next.
    assert lines[1].startswith(f'  usable with care: {NAMES[0]},')
    after = next(k for k, line in enumerate(lines) if 'Next: do what the reasons ask' in ' '.join(
        lines[max(k - 1, 0):k + 1])) + 1
    assert lines[after] == '  all joints: usable with care: base tilted'
    assert lines[after + 1].strip() == f'{NAMES[0]}: usable with care'
    assert any(line.startswith(f'  {NAMES[2]}: not usable: 31.4% of the') for line in lines)
    # The cut names still tell the joints apart.
    rows = [line for line in lines if '…' in line]
    assert len({row.split()[0] for row in rows}) == 7


def test_a_joint_that_is_not_usable_has_no_numbers(tmp_path: Path) -> None:
    one = results()
    page = tmp_path / 'index.html'
    write_page(one, [], page, {})
    for text in (one.text(), page.read_text()):
        assert '5.12' in text and str(SECRET)[:4] not in text
        assert 'not usable' in text and 'reduce the backlash' in text
    found = one.as_mapping()
    assert [x['verdict'] for x in found['verdicts']] == [
        *['usable with care'] * 2, 'not usable', *['usable with care'] * 4]
    bad = found['friction'][2]
    assert bad['coulomb'] == {'value': None, 'reason': 'not usable'}
    assert str(SECRET) not in json.dumps(found)
    for values in (found['peak_perturbation_nm'], found['recommended']['ka']['value']):
        assert values[2] is None and values[0] is not None
    assert found['torque_scale'][2]['value'] is None
    drives = found['delays_possible'][0]
    for values in (drives['actuator_lag_s'], drives['actuator_lag_interval_95_s']):
        assert values[2] is None and values[0] is not None


def test_the_page_has_the_verdicts_before_the_numbers(tmp_path: Path) -> None:
    page = tmp_path / 'index.html'
    write_page(results(), [], page, {})
    text = page.read_text()
    assert text.index('severity2') < text.index('<h2>Numbers')
    assert '<p class="attention">All joints are usable with care: base tilted</p>' in text


def test_notes_stand_below_the_tables() -> None:
    text = ' '.join(results().text().split())
    assert f'{NAMES[1]}: a note' in text
    # A bound stands in the table, and needs no sentence.
    assert ' at least 680 ' in text and 'follows commands' not in text


@pytest.mark.parametrize('n', [2, 7])
def test_nothing_is_over_a_label_and_a_joint_that_is_not_usable_has_no_fit(
        n: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check joints of long names."""
    monkeypatch.setattr(figures, 'friction_at', lambda _, v, __: (0.0 * v, 0.0 * v + 1.0))
    way = np.ones((50, n))
    fit = SimpleNamespace(
        terms=(), residual=way, columns=lambda _: np.zeros((50, 0)), value=np.zeros(0))
    found = SimpleNamespace(data=SimpleNamespace(way=way, velocity=way), unexplained=(),
                            selected=SimpleNamespace(fit=fit))
    verdicts = [Verdict(f'a_joint_of_the_left_arm_of_a_robot_{k}', (
        Severity.CARE, Severity.REFUSED)[k % 2], ()) for k in range(n)]
    _, figure, caption = figures.friction_figure(cast(Any, found), verdicts)
    assert not overlaps(figure)
    good, bad = figure.axes[:2]
    assert [len(good.lines), len(bad.lines)] == [2, 1]
    assert bad.get_title(loc='left').endswith(': not usable')
    assert 'not usable' in caption
