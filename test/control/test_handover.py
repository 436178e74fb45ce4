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

"""From any law to any other one while the arm moves, with friction."""

from __future__ import annotations

import copy
from functools import cache
import itertools
import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.laws.registry import law_class, LAWS
from ctc_chattering.control.settings import HANDOVER_DURATION_S
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
import numpy as np
from oracles import Array
import pytest

#: But for the two of the paper, between which the term comes and goes at once.
PAIRS = [pair for pair in itertools.permutations(LAWS, 2)
         if set(pair) != {'compensation', 'chattering'}]
#: Each law once before, and once after.
NEXT = list(zip(LAWS, LAWS[2:] + LAWS[:2]))
MS = 1_000_000
MOTION = Sinusoid(ReferenceConfig())
#: What a step of the torque may be besides that of the law before, in 1 ms [N·m].
MARGIN = 0.2


class Loop:
    """The arm under a law, from the reference on."""

    def __init__(self, law: str, switching: str, delay: int) -> None:
        self.plant = Plant(PlantConfig(
            input_delay=delay, initial_position=(math.pi, math.pi / 2),
            initial_velocity=(math.pi, math.pi)))
        self.law = Controller(ControllerConfig(
            law=law, switching=switching, input_delay=delay, ka=(12.0, 12.0)))
        self._delay = delay
        self.tau: list[Array] = []
        self.parts: list[Array] = []
        self.robust: list[Array] = []

    def go(self, samples: int) -> None:
        """Go on."""
        for _ in range(samples):
            k = self.plant.k
            ahead = [MOTION.at((k + 1 + j) * MS) for j in range(self._delay)]
            sample = self.law.step(*self.plant.measured, *MOTION.at(k * MS), ahead)
            self.plant.step(sample.tau)
            self.tau.append(np.array(sample.tau))
            self.robust.append(np.array(sample.robust))
            self.parts.append(np.array(sample.nominal) - sample.compensation - self.robust[-1])

    def copied(self) -> Loop:
        """Return another one that goes on from here."""
        other = copy.copy(self)
        shared = {id(x): x for x in (self.plant.config, self.law.config)}  # They never change.
        other.plant, other.law = copy.deepcopy((self.plant, self.law), shared)
        other.tau, other.parts, other.robust = [*self.tau], [*self.parts], [*self.robust]
        return other

    def change(self, law: str) -> None:
        """Name another law."""
        self.law.configure(self.law.config.changed({'law': law}))


@cache
def under_way(law: str, switching: str, delay: int) -> Loop:
    """Return the arm after 0.7 s, between two changes of sign of the friction."""
    loop = Loop(law, switching, delay)
    loop.go(700)
    return loop


def changed(before: str, after: str, switching: str, delay: int, samples: int) -> Loop:
    loop = under_way(before, switching, delay).copied()
    loop.change(after)
    loop.go(samples)
    return loop


@pytest.mark.parametrize(('switching', 'delay'), [
    ('implicit_observer', 0), pytest.param('sign', 2, marks=pytest.mark.slow)])
def test_the_torque_does_not_jump(switching: str, delay: int) -> None:
    """Check all ordered pairs against the usual step of the law before, with and without delay."""
    for before, after in PAIRS:
        loop = changed(before, after, switching, delay, 1)
        steps = np.abs(np.diff(loop.tau[-200:], axis=0))
        assert (steps[-1] <= steps[:-1].max(axis=0) + MARGIN).all(), (before, after)


# From each law, to each law: all pairs are above, at the sample of the change.
@pytest.mark.parametrize(('before', 'after'), NEXT)
def test_the_difference_fades(before: str, after: str) -> None:
    """Check the offset of the new law: straight to 0 within its time, and nothing from then on."""
    loop = changed(before, after, 'implicit_observer', 0, 220)
    count = round(HANDOVER_DURATION_S / 1e-3)
    added = np.array(loop.tau[700:]) - loop.parts[700:]
    share = np.maximum(1.0 - np.arange(220) / count, 0.0)[:, np.newaxis]
    np.testing.assert_allclose(added, share * added[0], atol=1e-9)
    assert (added[count:] == 0.0).all()


@pytest.mark.parametrize('before', ['chattering', 'super_twisting', 'momentum_observer'])
@pytest.mark.parametrize('after', ['integral', 'momentum_observer', 'slotine_li'])
def test_the_estimate_goes_on(before: str, after: str) -> None:
    """Check that a law which estimates begins with what the one before has found of friction."""
    if before == after:
        return
    loop = changed(before, after, 'implicit_observer', 0, 1)
    known, taken = loop.robust[-2:]
    assert np.abs(known).min() > 8.0
    np.testing.assert_allclose(taken, known, rtol=0.1)


@pytest.mark.parametrize('after', ['chattering', 'extended_state_observer', 'observer_feedback'])
def test_an_estimate_beyond_ka_is_taken_over_within_it(after: str) -> None:
    """What a law with bounds has found is what it may have found itself."""
    loop, ka = under_way('momentum_observer', 'implicit_observer', 0).copied(), (3.0, 2.0)
    assert np.abs(loop.robust[-1]).min() > 8.0
    loop.law.configure(loop.law.config.changed({'law': after, 'ka': ka}))
    loop.go(1)
    memory: Any = loop.law.memories.law
    taken = np.abs((memory if after == 'chattering' else memory.observed).perturbation)
    assert (taken > 0.5 * np.array(ka)).all()
    assert (taken <= ka).all()


def test_v_is_0_where_a_law_begins_to_act_on_it() -> None:
    """And it is preserved between others; those that observe have that of the observed state."""
    for before, after in PAIRS:
        loop = under_way(before, 'implicit_observer', 0).copied()
        plain = loop.copied()
        loop.change(after)
        k = loop.plant.k
        rows = (*loop.plant.measured, *MOTION.at(k * MS))
        v = loop.law.step(*rows).v
        if law_class(after).acts_on_v and not law_class(before).acts_on_v:
            assert list(v) == [0.0, 0.0]
        elif before not in ('pid_kalman', 'extended_state_observer', 'observer_feedback'):
            assert v == plain.law.step(*rows).v


def test_a_law_begins_as_new_after_a_reset() -> None:
    """Check that nothing fades, and no estimate is left, whatever was in force before."""
    for before, after in NEXT:
        loop = under_way(before, 'implicit_observer', 0).copied()
        loop.change(after)
        loop.law.reset()
        new = Controller(loop.law.config)
        for k in range(3):
            rows = (*loop.plant.measured, *MOTION.at(k * MS))
            assert loop.law.step(*rows) == new.step(*rows)
