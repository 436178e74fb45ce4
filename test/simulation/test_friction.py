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

"""Which joints stick and which slide, against enumeration of Coulomb's law."""

import itertools

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation import friction
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from oracles import Array, Masses, paper_c, paper_g, paper_m, random_spd
import pytest

ARM = TwoLink()
KF = [9.9, 9.9]


def modes(model: Model, q: Vector, dq: Vector, u: Vector, breakaway: Vector) -> tuple[float, ...]:
    """Return the modes; which joints stick agrees with them."""
    mode, stuck = friction.modes(model, *map(np.array, (q, dq, u, breakaway)))
    assert stuck.tolist() == [kf > 0.0 and not m for kf, m in zip(breakaway, mode)]
    return tuple(mode.tolist())


def friction_by_enumeration(mass: Array, u: Array, level: Array) -> list[tuple[int, ...]]:
    """Return every set of modes of joints at rest that obeys Coulomb's law; u less C dq and G."""
    n, found = len(u), []
    for mode in itertools.product((-1, 0, 1), repeat=n):
        side = np.array(mode)
        free = side != 0
        ddq = np.zeros(n)
        load = u - level * side
        if free.any():
            ddq[free] = np.linalg.solve(mass[np.ix_(free, free)], load[free])
        need = load - mass @ ddq  # what the joints that stick must hold
        if (ddq[free] * side[free] >= 0.0).all() and (np.abs(need[~free]) <= level[~free]).all():
            found.append(mode)
    return found


@settings(max_examples=200)
@given(st.integers(1, 4), st.integers(0, 2 ** 32 - 1), st.floats(0.0, 3.0))
def test_joints_at_rest_against_enumeration(n: int, seed: int, decades: float) -> None:
    """Check that the modes are the one set among 3^n that obeys Coulomb's law."""
    rng = np.random.default_rng(seed)
    mass = random_spd(rng, n, decades)
    u, level = rng.normal(size=n) * 3.0, rng.uniform(0.1, 5.0, n)
    found = friction_by_enumeration(mass, u, level)
    assert len(found) == 1
    zero = [0.0] * n
    assert modes(Masses(mass.tolist()), zero, zero, u.tolist(), level.tolist()) == found[0]


@pytest.mark.parametrize(('dq', 'level', 'expected'), [
    ([1.0, -1.0], KF, (1, -1)), ([5e-324, -5e-324], KF, (1, -1)), ([1.0, 1.0], [0.0, 9.9], (0, 1)),
    ([-1.0, 1.0], [0.0, 0.0], (0, 0)), ([0.0, 0.0], [0.0, 0.0], (0, 0)),
    ([-0.0, 0.0], KF, (0, 0))])
def test_a_moving_joint_slides_the_way_it_moves(
        dq: list[float], level: list[float], expected: tuple[int, ...]) -> None:
    """Check the direction whatever the load, and joints without friction."""
    assert modes(ARM, [0.0, 0.0], dq, [0.0, 0.0], level) == expected
    if 0.0 in level:  # no load makes a joint without friction slide or stick
        assert modes(ARM, [1.0, 2.0], dq, [90.0, 3.0], level) == expected
    if 0.0 not in dq:
        assert modes(ARM, [1.0, 2.0], dq, [1e3, -1e3], level) == expected


def test_joint_at_rest_beside_a_moving_one() -> None:
    """Check that the sliding friction and the Coriolis torque of joint 1 load joint 2."""
    rng = np.random.default_rng(5)
    seen = set()
    for _ in range(300):
        q, dq = rng.uniform(-3.0, 3.0, 2).tolist(), [float(rng.normal() * 5.0), 0.0]
        u = rng.uniform(-40.0, 40.0, 2)
        load = u - paper_c(q, dq) @ dq - paper_g(q) - [9.9 * np.sign(dq[0]), 0.0]
        found = []
        for m in (-1, 0, 1):
            ddq = np.linalg.solve(paper_m(q), load - [0.0, 9.9 * m])
            held = np.array([load[0] / paper_m(q)[0, 0], 0.0])
            need = load[1] - paper_m(q)[1] @ held
            if (m and ddq[1] * m >= 0.0) or (not m and abs(need) <= 9.9):
                found.append(m)
        assert modes(ARM, q, dq, u.tolist(), KF) == (int(np.sign(dq[0])), *found)
        seen.update(found)
    assert seen == {-1, 0, 1}
