"""
The states of the controller node, and what leads from one to another.

An event that is not in the row of a state changes nothing.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum


class State(Enum):
    """What the controller does; the value is the text for a user."""

    # The hash of Enum, computed from the name each time, takes as long as a product of matrices.
    __hash__ = object.__hash__

    WAITING_FOR_STATE = 'waiting for a state'
    WAITING_FOR_REFERENCE = 'waiting for the reference'
    RUNNING = 'running'
    RESTARTING = 'running, back to the reference'
    HOLDING = 'holding the position, the reference is late'
    NO_STATE = 'no state'
    TRIPPED = 'tripped'
    DISABLED = 'disabled'
    TRIPPED_AND_DISABLED = 'tripped and disabled'

    @property
    def sends_torque(self) -> bool:
        """Whether every joint state is answered by a torque."""
        return self in (State.RUNNING, State.RESTARTING, State.HOLDING)

    @property
    def allows_torque(self) -> bool:
        """Whether a torque may be sent as soon as state and reference are there."""
        return self not in (State.TRIPPED, State.DISABLED, State.TRIPPED_AND_DISABLED)

    def after(self, event: Event) -> State:
        """Return the state that an event leads to: this one, where the table has no other."""
        return TRANSITIONS[self].get(event, self)


class Event(Enum):
    """What happens to the controller."""

    __hash__ = object.__hash__

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
    #: The position error exceeds `error_limit`.
    ERROR_LIMIT = 'error limit'
    RESET = 'reset'
    DISABLE = 'disable'
    ENABLE = 'enable'


#: Rows of all states in which torques are sent, or would be.
_ARMED = {
    Event.FOLLOW: State.RUNNING, Event.LEAD_BACK: State.RESTARTING, Event.HOLD: State.HOLDING,
    Event.NO_REFERENCE: State.WAITING_FOR_REFERENCE, Event.SILENCE: State.NO_STATE,
    Event.ERROR_LIMIT: State.TRIPPED, Event.DISABLE: State.DISABLED}

#: The next state, by state and event.
TRANSITIONS: Mapping[State, Mapping[Event, State]] = {
    State.WAITING_FOR_STATE: {**_ARMED, Event.STATE: State.WAITING_FOR_REFERENCE},
    State.WAITING_FOR_REFERENCE: _ARMED,
    State.RUNNING: _ARMED,
    State.RESTARTING: _ARMED,
    State.HOLDING: _ARMED,
    State.NO_STATE: {Event.STATE: State.WAITING_FOR_REFERENCE, Event.DISABLE: State.DISABLED},
    State.TRIPPED: {Event.RESET: State.WAITING_FOR_STATE,
                    Event.DISABLE: State.TRIPPED_AND_DISABLED},
    State.DISABLED: {Event.ENABLE: State.WAITING_FOR_STATE},
    State.TRIPPED_AND_DISABLED: {Event.RESET: State.DISABLED, Event.ENABLE: State.TRIPPED},
}
