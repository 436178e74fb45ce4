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
"""The sentences of `ctc identify`: each finding has full ones, made of its values."""

from __future__ import annotations

from string import Formatter
from typing import Any

from ctc_chattering.identification.findings import Estimate, Finding, Reason, Severity
from ctc_chattering.identification.gains import Draw, FailedDraw, GainTrial
from ctc_chattering.identification.sentences import (
    MESSAGES,
    next_step,
    trial_text,
    verdict_text,
    words_of,
)
from ctc_chattering.identification.verdict import Verdict
import numpy as np
import pytest

#: Values of texts; other values are numbers.
TEXTS = {'text', 'recording', 'link', 'signal', 'option', 'file', 'coupled_joint', 'drives'}
DRAW = Draw(1, np.array([2e-3, 3e-3]), 1.05, -1, {})


@pytest.mark.parametrize('reason', Reason)
def test_each_reason_has_full_sentences_of_its_values(reason: Reason) -> None:
    message = MESSAGES[reason]
    names = {name for part in message[1:] for _, name, _, _ in Formatter().parse(part) if name}
    values: dict[str, Any] = {
        name: 'x' if name in TEXTS else 1.0 for name in names - {'joint', 'trial'}}
    if 'trial' in names:
        values['trial'] = GainTrial(50.0, 6)
    words = words_of(Finding(reason, Severity.CARE, 0, values), 'elbow')
    for sentence in filter(None, words):
        assert sentence[0].isalnum() or sentence[0] == '|'
        assert sentence.endswith('.') and '..' not in sentence and '{' not in sentence
    assert ('elbow' in str(words)) == ('joint' in names)


def test_several_values_are_listed() -> None:
    wide = {'Coulomb': Estimate(3.0, 2.0, 'N*m'), 'Stribeck': Estimate(1.0, 2.0, 'N*m')}
    assert words_of(Finding(Reason.UNCERTAIN, Severity.CARE, 0, {'estimates': wide}), 'a') == (
        'The motion shows the friction only within wide intervals: Coulomb 3 ± 2 N*m, '
        'Stribeck 1 ± 2 N*m.',
        'Record a motion of `ctc excite --for a` and identify both bags together.')
    turned = {'gravity': [0.0, 0.123, -9.81], 'degrees': 1.0, 'file': 'x.urdf'}
    assert 'along (0, 0.12, -9.8) m/s²' in words_of(
        Finding(Reason.MOUNT, Severity.CARE, values=turned), 'a').text


def test_a_verdict_has_the_sentences_of_its_worst_findings() -> None:
    worst, care = Finding(Reason.NO_CONSTANT, Severity.REFUSED, 0), Finding(
        Reason.LONG_LAG, Severity.CARE, 0, {'lag_ms': 12.0})
    assert verdict_text(Verdict('a', Severity.REFUSED, (worst, care))) == (
        'not usable: The current of a shows neither weight nor inertia of the model. Its torque '
        'constant is not known. Give --torque-constant in N*m at the joint per ampere.')
    assert verdict_text(Verdict('a', Severity.NOTE, ())) == 'usable'


def test_the_next_step_depends_on_the_verdicts() -> None:
    good = Verdict('a', Severity.NOTE, ())
    still = Verdict('b', Severity.REFUSED, (Finding(Reason.NOT_EXCITED, Severity.REFUSED, 1),))
    assert next_step([good]) == 'Usable: all joints. Next: run with identified.yaml.'
    assert next_step([good, still]) == (
        'Usable: a. Not usable: b. Next: resolve the findings below. `ctc excite --for b` makes a '
        'motion that shows more of these joints.')


def test_a_trial_names_the_robot_on_which_gains_fail() -> None:
    start = 'The gains with p = 50 rad/s '
    assert trial_text(GainTrial(50.0, 6)) == f'{start}survive on all of 6 simulated robots.'
    end = ('. This robot has delay 1, lag 0.003 s, friction at the lower end of its interval, and '
           "the model is 1.05 of the robot's.")
    for failed, cause in (
            (FailedDraw(2, DRAW, 'it diverged'), 'it diverged'),
            (FailedDraw(2, DRAW, '', 'a', 0.02, 0.01),
             'the RMS error of a is 0.02 rad, that of `compensation` 0.01 rad'),
            (FailedDraw(2, DRAW, '', 'a', 0.01, 0.02, 0.1),
             'a joint is at its torque limit for 10% of the time')):
        text = trial_text(GainTrial(50.0, 6, failed))
        assert text == f'{start}fail on robot 2 of 6: {cause}{end}'
    trial = GainTrial(50.0, 6)
    refusal = Finding(Reason.NO_GAINS, Severity.REFUSED, values={'trial': trial})
    assert 'all of 6 simulated robots. First' in str(words_of(refusal, 'a'))
