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

"""What a torque depends on is found with its cause, and chance is none."""

from __future__ import annotations

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from ctc_chattering.identification.findings import Estimate, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.least_squares import Term, TermKind
from ctc_chattering.identification.residual_tests import (
    findings,
    unexplained,
    wider,
)
from ctc_chattering.identification.windows import BUILD_UP, reversals, way_since_reversal
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest

TERMS = tuple(Term(kind, 0) for kind in (
    TermKind.FORWARDS, TermKind.BACKWARDS, TermKind.VISCOUS))
#: Friction of the joint [N·m, N·m·s/rad], and noise of its torque [N·m].
COULOMB, VISCOUS, NOISE = 5.0, 1.0, 0.02
Torque = Callable[[Any], Array]


def motion(seed: int, torque: Torque | None = None, noise: float = NOISE) -> tuple[Any, Any]:
    """Return windows of two joints in 20 s, the first with a further torque, and their fit."""
    rng = np.random.default_rng(seed)
    t = 0.025 * np.arange(800)
    q = np.column_stack([sum(rng.normal() * np.sin(w * t + rng.uniform(0.0, 6.0))
                             for w in rng.uniform(0.3, 2.5, 4)) for _ in range(2)])
    dq, ddq = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    way = np.where(np.abs(dq) > 0.02, np.sign(dq), 0.0)
    weight = 20.0 * np.sin(q)
    base = weight + 3.0 * ddq + ddq[:, ::-1]
    since = np.stack([way_since_reversal(x, reversals(x, y), np.arange(len(x)))
                      for x, y in zip(q.T, way.T)], axis=1)
    x = SimpleNamespace(q=q[:, 0], dq=dq[:, 0], ddq=ddq[:, 0], way=way[:, 0], t=t,
                        since=since[:, 0], base=base[:, 0], other=base[:, 1])
    used = way[:, 0] != 0.0
    design = np.zeros((len(t), 2, 3))
    design[:, 0] = np.column_stack((np.maximum(way[:, 0], 0.0), np.minimum(way[:, 0], 0.0),
                                    dq[:, 0] * used))
    y = used * (design[:, 0] @ (COULOMB, COULOMB, VISCOUS) + noise * rng.normal(size=len(t)))
    y += used * torque(x) if torque else 0.0
    value = np.linalg.lstsq(design[:, 0], y, rcond=None)[0]
    rest = np.zeros((len(t), 2))
    rest[:, 0] = y - design[:, 0] @ value
    residual = np.column_stack((y, np.zeros(len(t))))
    data = SimpleNamespace(
        t=t, velocity=dq, way=way, residual=residual, base=base, gravity=weight, position=q,
        acceleration=ddq, build_up=np.stack([way * np.exp(-since / d) for d in BUILD_UP], axis=2))
    return data, SimpleNamespace(
        terms=TERMS, columns=lambda i: design[:, i], value=value, residual=rest)


CAUSES: dict[str, Torque] = {
    'position': lambda x: 1.5 * np.sin(x.q + 0.4),
    'position and direction': lambda x: 1.5 * x.way * np.sin(x.q),
    'speed': lambda x: 3.0 * x.way * np.sqrt(np.abs(x.dq)),
    'acceleration': lambda x: 0.7 * x.ddq,
    'the way since a reversal': lambda x: -5.0 * x.way * np.exp(-x.since / 5e-3),
    'time': lambda x: -1.5 * x.way * x.t / 20.0,
    'the load': lambda x: 0.1 * x.way * np.abs(x.base),
    'the torques of other joints': lambda x: 0.05 * x.other}


@pytest.mark.parametrize('against', CAUSES)
def test_a_torque_is_found_with_its_cause_and_intervals_hold(against: str) -> None:
    for seed in range(3):
        found = motion(seed, CAUSES[against])
        left = unexplained(*found, 0)
        assert left is not None
        assert left.effects[0].cause.against == against
        named = list(findings(0, left))
        assert named[0].severity >= Severity.CARE
        assert against in named[0].reason and '%' in named[0].reason
        forwards, backwards, viscous = found[1].value
        narrow = Estimate(0.5 * (forwards + backwards), 1e-3)
        wide = wider(*found, 0, JointFriction(
            narrow, Estimate(forwards, 1e-3), Estimate(backwards, 1e-3), narrow,
            Estimate(viscous, 1e-3), *[Estimate.none('')] * 3), left)
        assert wide.coulomb.value == narrow.value
        off = abs(narrow.number() - COULOMB)
        assert off < wide.coulomb.half or against == 'time'
        assert abs(viscous - VISCOUS) < wide.viscous.half or against == 'speed'


def test_chance_is_no_cause() -> None:
    for seed in range(40):
        left = unexplained(*motion(seed), 0)
        assert left is not None
        assert not left.effects and left.off == 0.0, (seed, left.effects)


def test_small_effects_widen_intervals_and_need_no_care() -> None:
    left = unexplained(*motion(1, lambda x: 0.02 * np.sin(x.q), 1e-3), 0)
    assert left is not None and left.effects
    assert 0.01 < left.off < 0.1
    assert not list(findings(0, left))


def test_large_effects_refuse() -> None:
    left = unexplained(*motion(1, lambda x: 4.0 * np.sin(x.q)), 0)
    assert left is not None
    assert next(findings(0, left)).severity == Severity.REFUSED


@pytest.mark.parametrize('torque', [lambda x: 0.5 * np.sin(5.0 * x.t),
                                    lambda x: 0.5 * np.sin(17.0 * x.q)])
def test_what_depends_on_nothing_known_but_is_not_white_is_found(torque: Torque) -> None:
    """A vibration, and the ripple of a motor."""
    left = unexplained(*motion(2, torque), 0)
    assert left is not None
    assert left.rest > 0.1
    assert 'correlates in time' in list(findings(0, left))[-1].reason


def test_the_way_since_a_reversal() -> None:
    q = np.array([0.0, 1.0, 2.0, 3.0, 2.5, 2.0, 2.0, 1.0, 1.5])
    slide = np.array([0.0, 1.0, 1.0, 1.0, -1.0, 0.0, -1.0, -1.0, 1.0])
    assert way_since_reversal(q, reversals(q, slide), np.arange(len(q))).tolist() == [
        np.inf, np.inf, np.inf, np.inf, 0.5, 1.0, 1.0, 2.0, 0.5]
