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

"""What the tests of all laws share: states to answer, and runs of the two-link arm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.closed_loop import Event, Run, run_closed_loop
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np
from oracles import Array, paper_c, paper_g, paper_m

Inputs = tuple[list[float], list[float], list[float], list[float], list[float]]
#: Gains with coupling, and values of their own wherever 1 or the default would hide a mistake.
GAINS: dict[str, Any] = {
    'kp': [90.0, 20.0, 20.0, 130.0], 'kv': [40.0, -8.0, -8.0, 55.0], 'lambda': 7.0, 'b': 1.3,
    'control_period': 0.002}
KP, KV, LAMBDA, B, H = (
    np.array(GAINS['kp']).reshape(2, 2), np.array(GAINS['kv']).reshape(2, 2), 7.0, 1.3, 0.002)


def inputs(rng: np.random.Generator, size: float) -> Inputs:
    """Return a random q, dq, q_d, dq_d, ddq_d with errors of about `size`."""
    q, dq, a = (s * rng.normal(size=2) for s in (2.0, 3.0, 20.0))
    q_d, dq_d = q + size * rng.normal(size=2), dq + size * rng.normal(size=2)
    return q.tolist(), dq.tolist(), q_d.tolist(), dq_d.tolist(), a.tolist()


class Terms:
    """The terms of the textbooks at a sample, from the paper's matrices."""

    def __init__(self, rows: Inputs) -> None:
        self.q, self.dq, self.q_d, self.dq_d, self.ddq_d = (np.array(row) for row in rows)
        self.e, self.de = self.q_d - self.q, self.dq_d - self.dq
        self.M, self.C, self.G = paper_m(rows[0]), paper_c(rows[0], rows[1]), paper_g(rows[0])

    @property
    def computed_torque(self) -> Array:
        """M (ddq_d + Kv de + Kp e) + C dq + G."""
        torque: Array = (self.M @ (self.ddq_d + KV @ self.de + KP @ self.e)
                         + self.C @ self.dq + self.G)
        return torque


def run(law: str, duration: float = 4.0, friction: float = 9.9, offset: float = 0.0,
        amplitude: float = 0.5, plant: dict[str, Any] | None = None,
        events: Sequence[Event] = (), **values: Any) -> Run:
    """Simulate the two-link arm from the reference on, `offset` [rad] beside it."""
    start = [math.pi + offset, math.pi / 2 - offset]
    speed = [2.0 * math.pi * amplitude] * 2
    return run_closed_loop(
        PlantConfig.from_mapping({
            'duration': duration, 'coulomb_friction': [friction] * 2, 'initial_position': start,
            'initial_velocity': speed, **(plant or {})}),
        ControllerConfig.from_mapping({'law': law, **values}),
        ReferenceConfig(amplitude=(amplitude,) * 2), events, truth=True)


def error(found: Run, last: float = 1.0) -> Array:
    """Return the RMS error of each joint over the last second [rad]."""
    late = found.t >= found.t[-1] - last
    squares: Array = np.mean(np.square(found.q_d - found.q)[late], axis=0)
    return np.sqrt(squares)


def variation(found: Run, last: float = 1.0) -> Array:
    """Return the torque variation of each joint over the last second [N·m/s]."""
    late = found.t >= found.t[-1] - last
    way: Array = np.abs(np.diff(found.tau[late], axis=0)).sum(axis=0)
    return way / last


def rattles(law: str, calm: dict[str, Any], wild: dict[str, Any], **more: Any) -> bool:
    """Return whether the second values, not the first, diverge or multiply the variation."""
    quiet = variation(run(law, **more, **calm))
    try:
        loud = variation(run(law, **more, **wild))
    except CtcError:
        return True
    return bool((loud > 10.0 * quiet).any())


def check_windup(law: str, **values: Any) -> None:
    """Check the error after a second at the limit: without anti-windup it is far larger."""
    good, bad = (error(run(
        law, 3.0, 0.0, 0.5, 0.0, anti_windup=on, kv=60.0, kp=1200.0, ki=8000.0,
        effort_limit=[60.0, 10.0], **values)) for on in (True, False))
    assert (good < 0.05 * bad).all()


def check_delay(law: str) -> None:
    """Check that a known delay costs little error and variation, under friction."""
    values: dict[str, Any] = {'switching': 'implicit_observer', 'ka': [12.0] * 2}
    prompt = run(law, 1.2, **values)
    late = run(law, 1.2, plant={'input_delay': 2}, input_delay=2, **values)
    assert (variation(late) < 1.5 * variation(prompt)).all()
    assert (error(late) < 1.5 * error(prompt) + 1e-3).all()
    assert np.isfinite(late.tau).all()


#: Limits of the torque [N·m].
MOST = np.array([150.0, 20.0])


class FilterByHand:
    """The filter (3), as the paper has it, exact for its pole."""

    def __init__(self) -> None:
        self.xi = np.zeros(2)

    def output(self, x: Terms) -> Array:
        """Return v."""
        v: Array = self.xi - B * x.de
        return v

    def advance(self, x: Terms) -> None:
        """Go on by a period."""
        decay = math.exp(-LAMBDA * H)
        bracket = B * ((LAMBDA * np.eye(2) - KV) @ x.de - KP @ x.e)
        self.xi = decay * self.xi + (1.0 - decay) / LAMBDA * bracket


def check_by_hand(law: str, step: Callable[[Terms], Array], size: float = 0.3, **values: Any
                  ) -> None:
    """Compare 200 torques with those of `step`, which is called once a sample, to 1e-10."""
    rng = np.random.default_rng(5)
    controller = Controller(ControllerConfig.from_mapping({'law': law, **GAINS, **values}))
    for _ in range(200):
        rows = inputs(rng, size)
        np.testing.assert_allclose(
            controller.step(*rows).tau, step(Terms(rows)), rtol=1e-10, atol=1e-10)
