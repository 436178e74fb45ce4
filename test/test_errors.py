"""What is said of a wrong name, and what counts as a wrong command line."""

from __future__ import annotations

from ctc_chattering.errors import given_by_user, near, ParameterError, UsageError
import pytest


@pytest.mark.parametrize(('value', 'said'), [
    ('chatering', '; did you mean chattering?'), ('CHATTERING', '; did you mean chattering?'),
    ('chattering', ''), ('xyz', ''), ('', ''), (6, ''), (None, ''), (['chatering'], '; did you')])
def test_the_nearest_name_is_named(value: object, said: str) -> None:
    assert near(value, ('chattering', 'compensation')).startswith(said)
    assert bool(near(value, ('chattering', 'compensation'))) == bool(said)


@pytest.mark.parametrize(('name', 'usage'), [
    ('law', True), ('controller: law', True), ('spec.yaml: tune.law', True), ('outlaw', False),
    ('ka', False)])
def test_only_what_stands_on_the_command_line_is_its_fault(name: str, usage: bool) -> None:
    kind = UsageError if usage else ParameterError
    with pytest.raises(kind, match='allowed: that'), given_by_user(['law', 'switching']):
        raise ParameterError(name, 'this', 'that')
