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

"""
The modes of the controller, and what leads from one to another.

An input that is not in the row of a mode changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class Mode(Enum):
    """What the controller does; the value is what is said to a user."""

    WAITING_FOR_STATE = 'waiting for joint_states'
    WAITING_FOR_REFERENCE = 'waiting for reference'
    RUNNING = 'running'
    RESTARTING = 'running, back to the reference'
    HOLDING = 'holding the position, the reference is late'
    NO_STATE = 'no state'
    TRIPPED = 'tripped'
    DISABLED = 'disabled; call ~/enable'
    TRIPPED_AND_DISABLED = 'tripped and disabled'

    @property
    def sends_torque(self) -> bool:
        """Whether every joint state is answered by a torque."""
        return self in (Mode.RUNNING, Mode.RESTARTING, Mode.HOLDING)

    @property
    def allows_torque(self) -> bool:
        """Whether a torque may be sent as soon as state and reference are there."""
        return self not in (Mode.TRIPPED, Mode.DISABLED, Mode.TRIPPED_AND_DISABLED)

    def after(self, event: Input) -> Mode:
        """Return the mode that an input leads to: this one, where the table has no other."""
        return TRANSITIONS[self].get(event, self)


class Input(Enum):
    """What happens to the controller."""

    #: A joint state was accepted.
    STATE = 'state'
    #: No joint state for `state_timeout`.
    SILENCE = 'silence'
    #: The state cannot be answered yet: no reference, or its readers are not matched.
    NO_REFERENCE = 'no reference'
    #: A torque is sent: along the reference, on the way back to it, or to hold the position.
    FOLLOW = 'follow'
    LEAD_BACK = 'lead back'
    HOLD = 'hold'
    #: What `trips` finds.
    TRIP = 'trip'
    RESET = 'reset'
    DISABLE = 'disable'
    ENABLE = 'enable'


#: Rows of all modes in which torques are sent, or would be.
_ARMED = {
    Input.FOLLOW: Mode.RUNNING, Input.LEAD_BACK: Mode.RESTARTING, Input.HOLD: Mode.HOLDING,
    Input.NO_REFERENCE: Mode.WAITING_FOR_REFERENCE, Input.SILENCE: Mode.NO_STATE,
    Input.TRIP: Mode.TRIPPED, Input.DISABLE: Mode.DISABLED}

#: The next mode, by mode and input.
TRANSITIONS: Mapping[Mode, Mapping[Input, Mode]] = {
    Mode.WAITING_FOR_STATE: {**_ARMED, Input.STATE: Mode.WAITING_FOR_REFERENCE},
    Mode.WAITING_FOR_REFERENCE: _ARMED,
    Mode.RUNNING: _ARMED,
    Mode.RESTARTING: _ARMED,
    Mode.HOLDING: _ARMED,
    Mode.NO_STATE: {Input.STATE: Mode.WAITING_FOR_REFERENCE, Input.TRIP: Mode.TRIPPED,
                    Input.DISABLE: Mode.DISABLED},
    Mode.TRIPPED: {Input.RESET: Mode.WAITING_FOR_STATE,
                   Input.DISABLE: Mode.TRIPPED_AND_DISABLED},
    Mode.DISABLED: {Input.ENABLE: Mode.WAITING_FOR_STATE},
    Mode.TRIPPED_AND_DISABLED: {Input.RESET: Mode.DISABLED, Input.ENABLE: Mode.TRIPPED},
}
