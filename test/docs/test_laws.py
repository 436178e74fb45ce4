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

"""docs/laws.md has every law with its parameters, and ranges that hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
import re
from typing import Any

from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.laws.base import law_class
from ctc_chattering.control.step import FADE
from ctc_chattering.errors import CtcError
from ctc_chattering.runs.conditions import condition
from ctc_chattering.runs.recommended import by_rule, recommended_setup
import numpy as np
import pytest

PAGE = (Path(__file__).resolve().parents[2] / 'docs' / 'laws.md').read_text(encoding='utf-8')


def rows() -> list[list[str]]:
    """Return the cells of the table of laws."""
    lines = PAGE[PAGE.index('| `law` |'):].split('\n\n')[0].splitlines()[2:]
    return [[cell.strip() for cell in re.split(r'(?<!\\)\|', line.strip().strip('|'))]
            for line in lines]


def test_the_table_has_every_law_with_its_parameters() -> None:
    assert [row[0].strip('`') for row in rows()] == list(LAWS)
    declared = {law: {name for name, spec in ControllerConfig.parameters().items()
                      if law in spec.laws} for law in LAWS}
    for law, _, _, parameters, _ in rows():
        assert set(re.findall(r'`(\w+)`', parameters)) == declared[law.strip('`')]


def test_every_law_has_a_paragraph_and_every_module_a_reference() -> None:
    for law in LAWS:
        assert f'**`{law}`' in PAGE
        text = __import__(law_class(law).__module__, fromlist=['']).__doc__ or ''
        assert re.search(r'\b(19|20)\d\d\b|of the paper', text)
        assert text.startswith(f'\nLaw `{law}`')
        assert re.search(r'  \((\d|[A-Z]+1)\)\n', text)


def test_the_time_of_fading_is_that_of_the_code() -> None:
    assert f'fades linearly within {FADE:g} s' in PAGE


def like_a_real_arm(duration: float, factor: float, values: Mapping[str, Any]) -> Setup:
    """Return the paper's arm under the condition real_arm, with values of the controller."""
    friction = find_config('friction')
    given = condition('real_arm').overrides(parameter_file.load(friction))[0]
    controller = {**given['controller'], 'inertia_scale': factor, 'gravity_scale': factor}
    return parameter_file.load(friction, {
        **given, 'plant': {**given['plant'], 'duration': duration},
        'controller': {**controller, **values}})


def triple_pole(p: float) -> dict[str, Any]:
    return {'law': 'integral', 'kp': [3 * p * p] * 2, 'kv': [3 * p] * 2, 'ki': [p ** 3] * 2}


@pytest.mark.slow
@pytest.mark.parametrize('factor', [0.9, 1.1])
def test_the_pole_of_integral_on_the_paper_s_arm(factor: float) -> None:
    """The rule is stable, where one without F / R is not."""
    p = 0.24 / (2e-3 + 1e-3 * (1 + 1) + 9.9 / 1000.0)
    known = like_a_real_arm(4.0, factor, {'law': 'integral', 'friction_level': [9.9, 9.9]})
    assert by_rule(known)['ki'] == pytest.approx([p ** 3] * 2)
    assert f'this is {p:.0f} rad/s' in PAGE
    run = simulate(like_a_real_arm(4.0, factor, triple_pole(p))).run
    assert np.abs(run.q_d - run.q)[2500:].max() < 0.05
    with pytest.raises(CtcError, match='exceeds error_limit'):
        simulate(like_a_real_arm(4.0, factor, triple_pole(60.0)))


@pytest.mark.slow
def test_what_a_lag_costs_that_observer_feedback_is_not_told() -> None:
    """The factors of docs/theory.md, on joint 2, with the model 10 % too light and too heavy."""
    def error(factor: float, lag: float) -> float:
        setup = recommended_setup(like_a_real_arm(10.0, factor, {}), 'observer_feedback')
        run = simulate(setup.changed({'controller': {'actuator_lag': [lag] * 2}})).run
        return float(np.sqrt(np.mean((run.q_d - run.q)[5000:, 1] ** 2)))

    told = {factor: error(factor, 2e-3) for factor in (0.9, 1.1)}
    assert error(1.1, 1e-3) == pytest.approx(told[1.1], rel=0.25)
    assert error(0.9, 0.0) == pytest.approx(1.4 * told[0.9], rel=0.2)
    assert error(1.1, 0.0) == pytest.approx(19.0 * told[1.1], rel=0.2)
