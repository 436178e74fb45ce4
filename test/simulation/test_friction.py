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

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation import friction
from hypothesis import given, settings
from hypothesis import strategies as st
import numpy as np
from oracles import friction_by_enumeration, Masses, paper_c, paper_g, paper_m, random_spd
import pytest

ARM = TwoLink()
REST = [0.0, 0.0]
KF = [9.9, 9.9]


def modes(model: Model, q: Vector, dq: Vector, u: Vector, breakaway: Vector) -> tuple[float, ...]:
    """Return the modes; which joints stick agrees with them."""
    mode, stuck = friction.modes(model, *map(np.array, (q, dq, u, breakaway)))
    assert stuck.tolist() == [kf > 0.0 and not m for kf, m in zip(breakaway, mode)]
    return tuple(mode.tolist())


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


def test_arm_at_rest_against_enumeration() -> None:
    """Check the arm under gravity, where all nine sets of modes occur."""
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(500):
        q = rng.uniform(-3.0, 3.0, 2).tolist()
        u = paper_g(q) + rng.uniform(-25.0, 25.0, 2)
        found = friction_by_enumeration(paper_m(q), u - paper_g(q), np.array(KF))
        assert [modes(ARM, q, REST, u.tolist(), KF)] == found
        seen.update(found)
    assert len(seen) == 9


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


def test_the_level_bites_at_exactly_kf() -> None:
    """Check the largest load that holds, and one just above it."""
    above = 9.9 * (1.0 + 1e-9)
    for sign in (1, -1):
        assert modes(ARM, REST, REST, [sign * 9.9, 0.0], KF) == (0, 0)
        assert modes(ARM, REST, REST, [0.0, sign * 9.9], KF) == (0, 0)
        assert modes(ARM, REST, REST, [sign * above, 0.0], KF)[0] == sign
        assert modes(ARM, REST, REST, [0.0, sign * above], KF)[1] == sign
    assert modes(ARM, REST, REST, [9.9, 0.0], [9.8, 9.9])[0] == 1


@pytest.mark.parametrize('stuck', [[0], [1], [0, 1]])
def test_what_holds_is_the_reaction_below_kf(stuck: list[int]) -> None:
    """Check against the reduced equations in numpy, with gravity, velocity and coupling."""
    rng = np.random.default_rng(len(stuck))
    for _ in range(50):
        q = rng.uniform(-3.0, 3.0, 2).tolist()
        dq = [0.0 if i in stuck else float(rng.normal()) for i in range(2)]
        load = rng.uniform(-80.0, 80.0, 2)
        bias = paper_c(q, dq) @ dq + paper_g(q)
        ddq = np.zeros(2)
        for i in set(range(2)) - set(stuck):
            ddq[i] = (load - bias)[i] / paper_m(q)[i, i]
        need = paper_m(q) @ ddq + bias
        still = np.isin(range(2), stuck)
        found = friction.margin_of_rest(
            *ARM.mass_and_bias(np.array(q), np.array(dq)), load, np.array(KF), still)
        assert found == pytest.approx(
            min(9.9 - abs(load[i] - need[i]) for i in stuck), abs=1e-11)
