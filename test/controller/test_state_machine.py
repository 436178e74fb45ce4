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

"""The states of the controller: every transition, and what must hold whatever happens."""

from __future__ import annotations

from ctc_chattering.controller.state_machine import Input, Mode
from hypothesis import given
from hypothesis import strategies as st
import pytest

#: By hand, a line for each state: what leads where. All else changes nothing.
ARMED = ('follow: running, lead back: restarting, hold: holding, hold still: held, '
         'guide: guided, trip: tripped, '
         'disable: disabled, silence: no state, no reference: waiting for reference')
EXPECTED = {
    'waiting for state': f'{ARMED}, state: waiting for reference',
    'waiting for reference': ARMED,
    'running': ARMED,
    'restarting': ARMED,
    'holding': ARMED,
    'held': ARMED,
    'guided': ARMED,
    'no state': 'state: waiting for reference, trip: tripped, disable: disabled',
    'tripped': 'reset: waiting for state, disable: tripped and disabled',
    'disabled': 'enable: waiting for state',
    'tripped and disabled': 'enable: tripped, reset: disabled'}


def state(name: str) -> Mode:
    return Mode[name.upper().replace(' ', '_')]


def event(name: str) -> Input:
    return Input[name.upper().replace(' ', '_')]


CASES = [(name, x) for name in EXPECTED for x in Input]


@pytest.mark.parametrize(('name', 'happens'), CASES)
def test_every_state_and_event(name: str, happens: Input) -> None:
    after = dict(pair.split(': ') for pair in EXPECTED[name].split(', '))
    found = {event(key): state(value) for key, value in after.items()}
    assert state(name).after(happens) is found.get(happens, state(name))


@given(st.booleans(), st.lists(st.sampled_from(list(Input))))
def test_what_forbids_torques_is_undone_by_its_own_request_only(
        enabled: bool, events: list[Input]) -> None:
    """Check two flags, written out, against the one state: tripped, and disabled."""
    present = Mode.WAITING_FOR_STATE if enabled else Mode.DISABLED
    tripped = False
    for x in events:
        if x is Input.TRIP and present.allows_torque:
            tripped = True
        elif x is Input.RESET:
            tripped = False
        elif x in (Input.ENABLE, Input.DISABLE):
            enabled = x is Input.ENABLE
        present = present.after(x)
        assert present.allows_torque == (enabled and not tripped)
        assert (present in (Mode.TRIPPED, Mode.TRIPPED_AND_DISABLED)) == tripped
        if not present.allows_torque:
            assert not present.sends_torque
        if x is Input.SILENCE:
            assert not present.sends_torque
