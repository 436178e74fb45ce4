"""The states of the controller: every transition, and what must hold whatever happens."""

from __future__ import annotations

from ctc_chattering.monitoring.controller_state import Event, State, TRANSITIONS
from hypothesis import given
from hypothesis import strategies as st
import pytest

#: By hand, a line for each state: what leads where. All else changes nothing.
ARMED = ('follow: running, lead back: restarting, hold: holding, error limit: tripped, '
         'disable: disabled, silence: no state, no reference: waiting for reference')
EXPECTED = {
    'waiting for state': f'{ARMED}, state: waiting for reference',
    'waiting for reference': ARMED,
    'running': ARMED,
    'restarting': ARMED,
    'holding': ARMED,
    'no state': 'state: waiting for reference, disable: disabled',
    'tripped': 'reset: waiting for state, disable: tripped and disabled',
    'disabled': 'enable: waiting for state',
    'tripped and disabled': 'enable: tripped, reset: disabled'}


def state(name: str) -> State:
    return State[name.upper().replace(' ', '_')]


def event(name: str) -> Event:
    return Event[name.upper().replace(' ', '_')]


CASES = [(name, x) for name in EXPECTED for x in Event]


@pytest.mark.parametrize(('name', 'happens'), CASES)
def test_every_state_and_event(name: str, happens: Event) -> None:
    after = dict(pair.split(': ') for pair in EXPECTED[name].split(', '))
    found = {event(key): state(value) for key, value in after.items()}
    assert state(name).after(happens) is found.get(happens, state(name))


def test_the_table_has_all_states_and_all_can_be_reached() -> None:
    assert set(TRANSITIONS) == set(State) == {state(name) for name in EXPECTED}
    reached: set[State] = set()
    ring = {State.WAITING_FOR_STATE}
    while ring:
        reached |= ring
        ring = {x for row in map(TRANSITIONS.__getitem__, ring) for x in row.values()} - reached
    assert reached == set(State)


@given(st.booleans(), st.lists(st.sampled_from(list(Event))))
def test_what_forbids_torques_is_undone_by_its_own_request_only(
        enabled: bool, events: list[Event]) -> None:
    """Check two flags, written out, against the one state: tripped, and disabled."""
    present = State.WAITING_FOR_STATE if enabled else State.DISABLED
    tripped = False
    for x in events:
        if x is Event.ERROR_LIMIT and present.allows_torque and present is not State.NO_STATE:
            tripped = True
        elif x is Event.RESET:
            tripped = False
        elif x in (Event.ENABLE, Event.DISABLE):
            enabled = x is Event.ENABLE
        present = present.after(x)
        assert present.allows_torque == (enabled and not tripped)
        assert (present in (State.TRIPPED, State.TRIPPED_AND_DISABLED)) == tripped
        if not present.allows_torque:
            assert not present.sends_torque
        if x is Event.SILENCE:
            assert not present.sends_torque
