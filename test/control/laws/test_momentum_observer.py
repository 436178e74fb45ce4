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

"""Computed torque with a disturbance observer on the momentum."""

import math

from ctc_chattering.control.controller import Controller, ControllerConfig
from laws import check_by_hand, error, H, rattles, run, Terms
import numpy as np
from oracles import Array, Masses

GAIN = 150.0


def test_by_hand() -> None:
    """Check the residual of the momentum, filtered, in the torque; C enters transposed."""
    estimate, before = np.zeros(2), None

    def step(at: Terms) -> Array:
        nonlocal estimate, before
        p, beta = at.M @ at.dq, at.C.T @ at.dq - at.G
        if before is not None:
            found = before[2] + (before[1] + beta) / 2.0 - (p - before[0]) / H
            estimate = estimate + (1.0 - math.exp(-GAIN * H)) * (found - estimate)
        tau: Array = at.computed_torque + estimate
        before = p, beta, tau
        return tau

    check_by_hand('momentum_observer', step, momentum_gain=GAIN)


def test_the_estimate_is_the_perturbation() -> None:
    """Check P̂ against a constant force on two masses: 1 - exp(-K h k) of it after k samples."""
    mass, force, h = np.array([[2.0, 0.7], [0.7, 0.5]]), np.array([3.0, -2.0]), 1e-3
    law = Controller(ControllerConfig(law='momentum_observer', momentum_gain=GAIN),
                     Masses(mass.tolist()))
    q, dq, rest = np.zeros(2), np.zeros(2), [0.0, 0.0]
    for k in range(100):
        sample = law.step(q.tolist(), dq.tolist(), rest, rest, rest)
        np.testing.assert_allclose(
            sample.robust, -force * (1.0 - math.exp(-GAIN * h * k)), atol=1e-9)
        a = np.linalg.solve(mass, np.array(sample.tau) - force)
        q, dq = q + h * dq + h * h / 2 * a, dq + h * a


def test_limits_do_not_wind_it_up() -> None:
    """Check that the estimate stays near friction while the torque is cut off for a second."""
    found = run('momentum_observer', 1.0, offset=1.0, effort_limit=[85.0, 20.0])
    law = Controller(ControllerConfig(law='momentum_observer', effort_limit=(85.0, 20.0)))
    most = 0.0
    for k in range(len(found.t)):
        rows = (x[k].tolist() for x in (found.q, found.dq, found.q_d, found.dq_d, found.ddq_d))
        most = max(most, float(np.abs(law.step(*rows).robust).max()))
    assert (np.abs(found.tau) >= [85.0, 20.0]).mean() > 0.2
    assert 5.0 < most < 15.0


def test_the_error_shrinks_under_friction() -> None:
    """Check against law (2), and that a faster observer is better."""
    plain = error(run('compensation', 4.0))
    slow, fast = (
        error(run('momentum_observer', 4.0, momentum_gain=gain)) for gain in (50.0, 300.0))
    assert (slow < 0.5 * plain).all()
    assert (fast < 0.5 * slow).all()


def test_too_large_an_inertia_makes_it_rattle() -> None:
    """Check condition (5) from both sides: with K h = 3 and M̂ = c M, c < 2.1."""
    fast = {'momentum_gain': 3000.0}
    assert rattles('momentum_observer', {'inertia_scale': 1.9, **fast},
                   {'inertia_scale': 2.3, **fast})
    assert not rattles('momentum_observer', {'inertia_scale': 1.0}, {'inertia_scale': 2.3})
