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

"""
States that are lost, off the grid or late: the package's laws on a plant of its own.

The plant (`independent_plant`) shares no code with the package. Its sticking friction, rate limit,
lag and delay are those of `real_arm`; its encoders have 1e-5 rad. Errors are RMS over the second
half of 6 s, joint by joint, relative to those of a run with regular states.
"""

from __future__ import annotations

from functools import cache
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.controller.loop import ControlLoop
from ctc_chattering.controller.positions import JointSample
import independent_plant
from machine_code import compile_step
import numpy as np
from oracles import Array
import pytest
from rigid_bodies import PAPER, planar

H = 1_000_000
COUNT = 6_000
DELAY = 1
CENTRE = np.array([np.pi, np.pi / 2.0])
ROBOT = {'input_delay': DELAY, 'actuator_lag': 2e-3, 'torque_rate_limit': [5e3, 1e3]}
#: Gains by rule, as far as the default ones are not for this robot.
GAINS: dict[str, dict[str, Any]] = {
    'observer_feedback': {
        'kp': 1e4, 'kv': 200.0, 'ka': [30.0, 30.0], 'estimator_bandwidth': 200.0},
    'extended_state_observer': {
        'kp': 1e4, 'kv': 200.0, 'ka': [30.0, 30.0], 'estimator_bandwidth': 200.0,
        'friction_level': 9.0, 'friction_lead': 3e-3},
    'pid_kalman': {'kp': 5e3, 'kv': 93.0, 'ki': 9e4, 'estimator_bandwidth': 336.0,
                   'friction_level': 9.0, 'friction_lead': 7e-3},
    'chattering': {'switching': 'implicit_observer', 'ka': 12.0, 'observer_bandwidth': 100.0},
    'momentum_observer': {'momentum_gain': 50.0},
    'super_twisting': {'effort_rate_limit': [5e3, 1e3]}}


def reference(t: float, w: float = 1.0) -> tuple[list[float], list[float], list[float]]:
    """Return a sinusoid of 0.5 rad that begins smoothly within 2 s; `w` [rad/s]."""
    s = min(t / 2.0, 1.0)
    a, da = s ** 3 * (10.0 - 15.0 * s + 6.0 * s * s), 15.0 * (s * (1.0 - s)) ** 2
    dda = 15.0 * s * (1.0 - s) * (1.0 - 2.0 * s)
    size = 0.5 / w ** 0.4
    x, dx = size * np.sin(w * t), size * w * np.cos(w * t)
    return ((CENTRE + a * x).tolist(), [da * x + a * dx] * 2,
            [dda * x + 2.0 * da * dx - a * w * w * x] * 2)


class Deaf(Controller):
    """A controller that goes on by a period at every state."""

    def step(self, *arguments: Any) -> Sample:
        return super().step(*arguments[:6])


def controller(law: str, kind: type[Controller] = Controller) -> Controller:
    known = {**ROBOT, **GAINS.get(law, {})}
    config = ControllerConfig.from_mapping({'law': law, 'control_period': 1e-9 * H, **{
        name: [x, x] if name in ('actuator_lag', 'friction_level', 'ka', 'kp', 'kv', 'ki') and
        not isinstance(x, list) else x for name, x in known.items()}})
    made = kind(config)
    if law == 'observer_feedback':  # Of others two runs take less time than to compile them.
        compile_step(made)
    return made


class Plant:
    """The arm, its encoders, and its error at the instants of the samples."""

    def __init__(self, w: float = 1.0) -> None:
        physics = independent_plant.ideal(planar(*PAPER)).changed(
            coulomb=9.9, lag=2e-3, rate=(5e3, 1e3))
        self._plant = independent_plant.Plant(
            physics, CENTRE, 1e-9 * H, DELAY, held=False, encoder=1e-5, longest=5e-5)
        self.t, self._errors, self._w = 0, list[Array](), w

    def measured(self) -> tuple[list[float], list[float]]:
        """Return what the encoders show, and the difference quotient of it."""
        q, dq = self._plant.measured()
        self._errors.append(np.array(reference(1e-9 * self.t, self._w)[0]) - self._plant.q)
        return q.tolist(), dq.tolist()

    def go_on(self, torque: list[float], t: int) -> None:
        self._plant.step(torque, 1e-9 * (t - self.t))
        self.t = t

    def rms(self) -> Array:
        e = np.array(self._errors)[len(self._errors) // 2:]
        result: Array = np.sqrt((e * e).mean(axis=0))
        return result


def run(law: str, stamped: bool = True, loss: float = 0.0, jitter: float = 0.0,
        drift: float = 0.0) -> Array:
    """Return RMS errors under a law that is called with what comes; `jitter` in periods."""
    made, plant, rng = controller(law), Plant(), np.random.default_rng(32)
    instants = np.rint(H * ((1.0 + drift) * np.arange(COUNT + 1) + rng.uniform(
        -jitter, jitter, COUNT + 1) * (np.arange(COUNT + 1) > 0))).astype(int).tolist()
    tau: Any = [0.0, 0.0]
    lost = 0
    for k, t in enumerate(instants[:-1]):
        q, dq = plant.measured()
        lost = lost + 1 if k > 0 and lost < 3 and rng.random() < loss else 0
        if not lost:
            points = [reference(1e-9 * (t + j * H)) for j in range(DELAY + 1)]
            tau = made.step(q, dq, *points[0], points[1:], t=t if stamped else None).tau
        plant.go_on(tau, instants[k + 1])
    return plant.rms()


@cache
def regular(law: str) -> Array:
    return run(law)


@pytest.mark.parametrize('irregular', [{'loss': 0.17}, {'drift': -2e-3, 'jitter': 0.05}], ids=str)
def test_the_error_stays(irregular: dict[str, Any]) -> None:
    """Without the stamps 0.1 % of lost states cost a factor of 100."""
    law = 'observer_feedback'
    most = 1.3 if 'drift' not in irregular else 2.0
    assert (run(law, **irregular) < most * regular(law)).all()
    if 'loss' in irregular:
        assert run(law, False, **irregular).max() > 20.0 * regular(law).max()


# What a step of a law remembers, an observer, a filter or an integral, goes by the stamps.
@pytest.mark.parametrize('law', [
    'chattering', *(
        pytest.param(law, marks=pytest.mark.slow) for law in (
            'extended_state_observer', 'integral', 'momentum_observer', 'pid_kalman',
            'slotine_li', 'super_twisting'))])
def test_no_law_is_worse_for_lost_states_and_jitter(law: str) -> None:
    assert (run(law, loss=0.1, jitter=0.2) < 1.15 * regular(law)).all()


class RealTime:
    """A loop in real time: states and torques take time, and some states are lost in bursts."""

    #: Time on the way, either way, and in the controller [ns].
    LEAST = 150_000

    def __init__(self, periods: int, stamped: bool = True, w: float = 1.0) -> None:
        law = controller('observer_feedback', Controller if stamped else Deaf)
        self._plant = Plant(w)
        self._loop = ControlLoop(law.config, 0.02, 0.1, True, self._send, self)
        self._loop.law, self._loop.lost_states.predicted_periods = law, periods
        times = list(range(0, (COUNT + 100) * H, H))
        self._loop.take_reference(times, [reference(1e-9 * t, w) for t in times])
        #: 8 of 73.
        self._lost = np.arange(COUNT) % 73 > 64
        self._torques: list[tuple[int, list[float]]] = []
        self._now = self.predicted = 0

    def info(self, _message: str, /, **_filters: float) -> None:
        """Log nothing."""

    warning = error = info

    def _send(self, tau: Any) -> None:
        self._torques.append((self._now + 2 * self.LEAST, list(tau)))

    def _predict(self, until: int) -> None:
        while (due := self._loop.due()) is not None and max(due, self._now) < until:
            self._now, before = max(due, self._now), len(self._torques)
            self._loop.predict(self._now)
            self.predicted += len(self._torques) - before
            self._now += self.LEAST

    def run(self) -> Array:
        """Return the RMS errors."""
        tau = [0.0, 0.0]
        for k in range(COUNT):
            state = JointSample(k * H, *self._plant.measured())
            if not self._lost[k]:
                self._now = k * H + self.LEAST
                self._loop.take_state(state, self._now, False)
                self._loop.answer(True, self._now)
                self._loop.computing_times.append(H // 10)
            self._predict((k + 1) * H)
            # What arrives during a period is applied from the next one on.
            for at, torque in self._torques:
                tau = torque if at <= (k + 1) * H else tau
            self._torques = [x for x in self._torques if x[0] > (k + 1) * H]
            self._plant.go_on(tau, (k + 1) * H)
        return self._plant.rms()


def test_in_real_time_predicted_torques_help_where_states_are_lost_for_long() -> None:
    """Check a factor of 3 of lockstep, and more without the stamps or without predictions."""
    lockstep = regular('observer_feedback')
    assert (RealTime(5).run() < 3.0 * lockstep).all()
    assert RealTime(0, stamped=False).run().max() > 3.0 * lockstep.max()
    found, without = RealTime(5, w=10.0), RealTime(0, w=10.0)
    assert (found.run() < 0.5 * without.run()).all()
    assert found.predicted > 100 > without.predicted == 0
