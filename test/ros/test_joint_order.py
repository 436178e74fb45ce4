"""Matching joints by name."""

from __future__ import annotations

import itertools

from hypothesis import given
from hypothesis import strategies as st
import pytest

from ctc_chattering.ros.joint_order import Joints

names_of = st.lists(st.text('abc', min_size=1, max_size=2), unique=True, max_size=6)


@given(st.lists(names_of, min_size=1, max_size=5), st.data())
def test_any_names_after_any_others(sequence: list[list[str]], data: st.DataObject) -> None:
    """Check one object against a dictionary, with subsets, supersets, and other orders."""
    ours = data.draw(names_of.filter(bool))
    joints = Joints(ours)
    for extra in sequence:
        theirs = data.draw(st.permutations([*ours, *(x for x in extra if x not in ours)]))
        for names in (tuple(theirs), tuple(extra), (*theirs,)):
            pick = joints.pick(names)
            if set(ours) <= set(names):
                values = {name: float(i) for i, name in enumerate(names)}
                assert pick is not None
                assert list(pick(list(values.values()))) == [values[name] for name in ours]
            else:
                assert pick is None


@pytest.mark.parametrize('order', list(itertools.permutations(range(3))))
def test_orders(order: tuple[int, ...]) -> None:
    """Check all orders of three joints."""
    ours = ('x', 'y', 'z')
    pick = Joints(ours).pick(tuple(ours[i] for i in order))
    assert pick is not None
    assert list(pick([float(i) for i in order])) == [0.0, 1.0, 2.0]


@pytest.mark.parametrize('names', [
    (), ('x',), ('x', 'z'), ('x', 'y', 'y'), ('x', 'y', 'z', 'z'), ('x', 'x'), ('X', 'Y')])
def test_refused(names: tuple[str, ...]) -> None:
    """Check missing joints and any name that stands there twice."""
    assert Joints(('x', 'y')).pick(names) is None


def test_one_joint() -> None:
    """Check that a row comes out, not a number."""
    joints = Joints(('y',))
    for names, row in ((('y',), [5.0]), (('x', 'y'), [1.0, 5.0]), (('y', 'x'), [5.0, 1.0])):
        pick = joints.pick(names)
        assert pick is not None
        assert list(pick(row)) == [5.0]


def test_remembers_until_names_change() -> None:
    """Check that equal names are not looked up again, others are, and a refusal does not last."""
    joints = Joints(('x', 'y'))
    first = joints.pick(('y', 'x'))
    assert first is not None
    assert joints.pick((*['y'], 'x')) is first
    assert joints.pick(('y', 'q')) is None
    assert joints.pick(('y', 'q')) is None
    again = joints.pick(('q', 'y', 'x'))
    assert again is not None
    assert list(again([1.0, 2.0, 3.0])) == [3.0, 2.0]
