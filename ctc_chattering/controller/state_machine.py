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
The modes of the controller and their transitions.

`ControlLoop` holds the present mode, and passes it each `Input`. An input that is not in the row
of a mode changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class Mode(Enum):
    """
    Mode of the controller.

    Attributes
    ----------
    text : str
        Mode for a user.
    sends_torque : bool
        Whether every joint state is answered by a torque.
    allows_torque : bool
        Whether a torque may be sent as soon as state and reference are there.

    """

    WAITING_FOR_STATE = 'waiting for joint_states', False, True
    WAITING_FOR_REFERENCE = 'waiting for reference', False, True
    RUNNING = 'running', True, True
    RESTARTING = 'running, back to the reference', True, True
    HOLDING = 'holding the position, the reference is late', True, True
    HELD = 'holding the position until a reference rests there', True, True
    GUIDED = 'guided by hand', True, True
    NO_STATE = 'no state', False, True
    TRIPPED = 'tripped', False, False
    DISABLED = 'disabled; call ~/enable', False, False
    TRIPPED_AND_DISABLED = 'tripped and disabled', False, False

    def __init__(self, text: str, sends_torque: bool, allows_torque: bool) -> None:
        self.text = text
        self.sends_torque, self.allows_torque = sends_torque, allows_torque

    __hash__ = object.__hash__  # Faster than that of Enum, which hashes the name.

    @property
    def ignores_reference(self) -> bool:
        """Return whether torques are sent, but not along the reference."""
        return self in (Mode.GUIDED, Mode.HELD)

    def after(self, event: Input) -> Mode:
        """Return the mode that an input leads to, by `TRANSITIONS`."""
        return TRANSITIONS[self].get(event, self)


class Input(Enum):
    """Event that the controller reacts to."""

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
    #: A torque is sent to hold the position until a reference rests there, or for a hand.
    HOLD_STILL = 'hold still'
    GUIDE = 'guide'
    #: The torques must end until a reset: see `controller/trips.py`.
    TRIP = 'trip'
    RESET = 'reset'
    DISABLE = 'disable'
    ENABLE = 'enable'

    __hash__ = object.__hash__


#: Rows of all modes in which torques are sent, or would be.
_ARMED = {
    Input.FOLLOW: Mode.RUNNING, Input.LEAD_BACK: Mode.RESTARTING, Input.HOLD: Mode.HOLDING,
    Input.HOLD_STILL: Mode.HELD, Input.GUIDE: Mode.GUIDED,
    Input.NO_REFERENCE: Mode.WAITING_FOR_REFERENCE, Input.SILENCE: Mode.NO_STATE,
    Input.TRIP: Mode.TRIPPED, Input.DISABLE: Mode.DISABLED}

#: The next mode, by mode and input.
TRANSITIONS: Mapping[Mode, Mapping[Input, Mode]] = {
    Mode.WAITING_FOR_STATE: {**_ARMED, Input.STATE: Mode.WAITING_FOR_REFERENCE},
    Mode.WAITING_FOR_REFERENCE: _ARMED,
    Mode.RUNNING: _ARMED,
    Mode.RESTARTING: _ARMED,
    Mode.HOLDING: _ARMED,
    Mode.HELD: _ARMED,
    Mode.GUIDED: _ARMED,
    Mode.NO_STATE: {Input.STATE: Mode.WAITING_FOR_REFERENCE, Input.TRIP: Mode.TRIPPED,
                    Input.DISABLE: Mode.DISABLED},
    Mode.TRIPPED: {Input.RESET: Mode.WAITING_FOR_STATE,
                   Input.DISABLE: Mode.TRIPPED_AND_DISABLED},
    Mode.DISABLED: {Input.ENABLE: Mode.WAITING_FOR_STATE},
    Mode.TRIPPED_AND_DISABLED: {Input.RESET: Mode.DISABLED, Input.ENABLE: Mode.TRIPPED},
}
