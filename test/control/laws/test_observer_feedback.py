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

"""Law observer_feedback against a copy by hand, and on an arm with real drives and encoders."""

from __future__ import annotations

import math
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control import oscillation
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.drive_model import drive_model
from ctc_chattering.control.state_observer import Observed, state_observer
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Run
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig
from laws import error, run, variation
from mujoco_plant import simulated_by_mujoco
import numpy as np
from oracles import Array, box_by_enumeration, paper_c, paper_g, paper_m
import pytest

H, LAG, DELAY = 1e-3, 2e-3, 1
RATE = np.array([5e3, 1e3])
KA, W, GAMMA = np.array([60.0, 30.0]), 100.0, 20.0
KP, KV = 1e4 * np.eye(2), 200.0 * np.eye(2)
#: Drives and encoders as they are: every cell of the docs has these.
REAL: dict[str, Any] = {
    'actuator_lag': [LAG, LAG], 'torque_rate_limit': RATE.tolist(), 'input_delay': DELAY,
    'encoder_resolution': [1e-5, 1e-5], 'velocity_sensor': 'difference'}
KNOWN: dict[str, Any] = {
    'actuator_lag': [LAG, LAG], 'torque_rate_limit': RATE.tolist(), 'input_delay': DELAY}
GAINS: dict[str, Any] = {
    'law': 'observer_feedback', 'kp': [1e4, 1e4], 'kv': [200.0, 200.0], 'ka': KA.tolist(),
    'estimator_bandwidth': W, 'friction_learning': GAMMA}


def nearest(mass: Array, point: Array, bound: Array) -> Array:
    inverse = np.linalg.inv(mass).astype(np.float64)
    found: Array = box_by_enumeration(inverse, -inverse @ point, bound)
    return found


def bias(q: Array, dq: Array) -> Array:
    found: Array = paper_c(q.tolist(), dq.tolist()) @ dq + paper_g(q.tolist())
    return found


def drive(torque: Array, command: Array, parts: int = 100) -> tuple[Array, Array, Array]:
    """Return end and the two means, by many small exact steps of a limited slope."""
    x, small, mean, weighted = torque.copy(), H / parts, np.zeros(2), np.zeros(2)
    for k in range(parts):
        before = x
        slope = np.clip((command - x) / LAG, -RATE, RATE)
        x = x + small * np.clip((command - x - 0.5 * small * slope) / LAG, -RATE, RATE)
        middle = 0.5 * (before + x)
        mean += middle / parts
        weighted += 2.0 * (1.0 - (k + 0.5) / parts) * middle / parts
    return x, mean, weighted


class ByHand:
    """The law for the two-link arm, written down from its equations."""

    def __init__(self) -> None:
        zero = np.zeros(2)
        self.K, self.lags, self.slow_x, self.slow_y = zero, [zero] * 3, zero, zero
        self.torque, self.transit = zero, [zero] * DELAY
        self.state: tuple[Array, ...] | None = None
        self.x: tuple[Array, Array] | None = None
        self.last: Array | None = None
        self.slow, self.ln_s = zero, 0.0
        #: Of each joint the half-waves of the feedback: the current one last.
        self.waves = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]

    def retreat(self, f: Array, missing: Array) -> None:
        """Take the torque of the feedback of a sample, and what the drives do not give."""
        given = np.copysign(np.maximum(np.abs(f) - np.abs(missing), 0.0), f)
        part, follow = math.exp(self.ln_s), RATE / np.sqrt(np.diag(KP))
        self.slow = self.slow + part * (1.0 - math.exp(-30.0 * H)) * (given - self.slow)
        ratio = max(abs(given - self.slow) / (KA + follow + abs(self.slow)))
        for i, waves in enumerate(self.waves):
            waves[:] = [x * math.exp(-10.0 * H) for x in waves]
            if f[i] * waves[-1] < 0.0:
                waves[:] = [*waves[1:], 0.0]
            waves[-1] = max(waves[-1], f[i], key=abs)
            f2, f1, size = abs(waves[0]), abs(waves[1]), abs(f[i])
            ratio = max(ratio, min(size, f1, f2) / min(KA[i], follow[i]))
        self.ln_s = max(self.ln_s * math.exp(-H / 2.0) - H * 80.0 * max(ratio - 0.5, 0.0),
                        math.log(0.1))

    @property
    def s(self) -> float:
        """Return the part of the bandwidths."""
        return math.exp(self.ln_s) if self.ln_s <= -1e-3 else 1.0

    def ahead(self, q: Array, dq: Array, torque: Array, P: Array, slope: Array, M: Array,
              b: Array, command: Array) -> tuple[Array, ...]:
        """Return (1) of the observer, one period on."""
        end, mean, weighted = drive(torque, command)
        mean, weighted = mean - P - 0.5 * H * slope, weighted - P - H / 3.0 * slope
        f = nearest(M, M @ dq / H + mean - b, self.K)
        a, a2 = (np.linalg.solve(M, x - b - f) for x in (mean, weighted))
        return q + H * dq + 0.5 * H * H * a2, dq + H * a, end, P + H * slope, slope

    def friction(self, dq: Array, ddq: Array, later: float) -> Array:
        """Return F."""
        F = np.zeros(2)
        for i in (0, 1):
            T = max(self.K[i] / RATE[i], 1e-6)
            s = (dq[i] + (0.67 * T + later) * ddq[i]) / (abs(ddq[i]) * T)
            size = abs(s)
            phi = size if size <= 1.35 else max(2.7 - size, 1.0)
            F[i] = self.K[i] * math.copysign(phi, s)
        return F

    def back(self, M: Array) -> Array:
        """Return -2 w dx - w² x."""
        assert self.x is not None
        found = np.zeros(2)
        for i in (0, 1):
            x, dx = self.x[0][i], self.x[1][i]
            J = 0.5 * RATE[i] / M[i, i]
            w = min(self.s * min(0.6 * math.sqrt(KP[i, i]), 0.5 / H),
                    0.55 * RATE[i] / max(self.K[i], 1e-12),
                    (J / max(abs(x), 1e-12)) ** (1 / 3), (J / max(abs(dx), 1e-12)) ** 0.5)
            found[i] = -2.0 * w * dx - w * w * x
        return found

    def wanted(self, q: Array, dq: Array, P: Array, point: list[Array]) -> tuple[Array, Array]:
        """Return τ* and the feedback in it."""
        assert self.x is not None
        M = paper_m(q.tolist())
        k = min(max(self.s, 10.0 / math.sqrt(max(np.diag(KP)))), 1.0)
        u = k * KV @ (point[1] + self.x[1] - dq) + k ** 2 * KP @ (point[0] + self.x[0] - q)
        bounded = nearest(M, P + self.friction(point[1], point[2], 0.0), KA)
        torque: Array = M @ (point[2] + self.back(M) + u) + bias(q, dq) + bounded
        return torque, M @ u

    def step(self, measured: Array, dq0: Array, point: list[Array]) -> Array:
        """Return τ for a measured position and the reference at arrival."""
        theta, s = math.exp(-W * H), self.s
        if self.state is None:
            q, dq, P, slope = measured, dq0, np.zeros(2), np.zeros(2)
        else:
            q, dq, P, slope, M = self.state
            e = measured - q
            q = q + (1 - theta ** 4) * e
            dq = dq + (1 - theta) ** 2 * (11 + 14 * theta + 11 * theta ** 2) / 6 / H * e
            most = s ** 0.5 * KA
            P = nearest(M, P - s * M @ e * 2 * (1 - theta) ** 3 * (1 + theta) / H ** 2, most)
            slope = slope - s ** 2 * M @ e * (1 - theta) ** 4 / H ** 3
            slope = np.where((np.abs(P) >= most) & (slope * P > 0), 0.0, slope)
        M0, b0 = paper_m(q.tolist()), bias(q, dq)
        arrive = self.ahead(q, dq, self.torque, P, slope, M0, b0, self.transit[0])
        qa, dqa, held, Pa, _ = arrive
        if self.x is None:
            self.x = qa - point[0], dqa - point[1]
        tau0, f0 = self.wanted(qa, dqa, Pa, point)
        M, b = paper_m(qa.tolist()), bias(qa, dqa)
        # The deviation a period later.
        back, F = self.back(M), self.friction(point[1], point[2], 0.5 * H)
        m = np.diag(M)
        f = np.clip(m * ((point[1] + self.x[1]) / H + point[2] + back) + F, -self.K, self.K)
        ddx = (F - f) / m + back
        self.x = (self.x[0] + H * self.x[1] + H * H / 2 * ddx, self.x[1] + H * ddx)
        # What is wanted a period later.
        half = 0.5 * (held + tau0)
        q1, dq1, _, P1, _ = self.ahead(qa, dqa, half, Pa, slope, M, b, half)
        jerk = (0.0 if self.last is None else point[2] - self.last) / H
        self.last = point[2]
        tau1, _ = self.wanted(q1, dq1, P1, [
            point[0] + H * point[1] + H ** 2 / 2 * point[2] + H ** 3 / 6 * jerk,
            point[1] + H * point[2] + H ** 2 / 2 * jerk, point[2] + H * jerk])
        E = math.exp(-H / LAG)
        asked = (tau1 - E * tau0) / (1 - E)
        tau = held + nearest(M, asked - held, RATE * (LAG + H))
        missing = asked - tau
        rest = missing - np.clip(missing, -10e-3 * RATE, 10e-3 * RATE)
        self.x = self.x[0], self.x[1] - np.linalg.solve(M, rest) / np.diag(KV + LAG * KP)
        self.retreat(f0, missing)
        self.learn(dq, P)
        state = self.ahead(q, dq, self.torque, P, slope, M0, b0, self.transit[0])
        self.state, self.torque = (*state[:2], *state[3:], M0), state[2]
        self.transit = [*self.transit[1:], tau]
        return tau

    def learn(self, dq: Array, P: Array) -> None:
        """Advance K̂."""
        x, slow = np.sign(dq) * (np.abs(dq) > 2e-3), 1 - math.exp(-0.06)
        go = self.s * (1 - math.exp(-W * H))
        lags = []
        for lag in self.lags:
            lags.append(lag + go * (x - lag))
            x = lags[-1]
        self.lags = lags
        self.slow_x = self.slow_x + slow * (x - self.slow_x)
        self.slow_y = self.slow_y + slow * (P - self.slow_y)
        self.K = np.clip(self.K + H * GAMMA * (x - self.slow_x) * (P - self.slow_y), 0.0, KA)


def motion(t: float) -> list[Array]:
    """Return a reference of 3 Hz."""
    w = 6.0 * math.pi
    s, c = math.sin(w * t), math.cos(w * t)
    return [np.array([1.0 + 0.1 * s, 0.5 - 0.1 * s]), 0.1 * w * c * np.array([1.0, -1.0]),
            -0.1 * w * w * s * np.array([1.0, -1.0])]


@pytest.mark.parametrize('level', [0.0, 4.0])
def test_a_copy_by_hand(level: float) -> None:
    """Check 150 torques, on measurements with errors that reach every branch."""
    rng = np.random.default_rng(2)
    law = Controller(ControllerConfig.from_mapping({
        **GAINS, **KNOWN, 'friction_level': [level, level]}))
    copy = ByHand()
    copy.K = np.full(2, level)
    offset = np.array([0.02, -0.01])
    for k in range(150):
        now, arriving = motion(k * H), motion((k + 1) * H)
        offset = 0.98 * offset + 1e-4 * rng.normal(size=2)
        q = now[0] + offset
        sample = law.step(q, now[1], *now, ahead=[tuple(arriving)])  # type: ignore
        np.testing.assert_allclose(sample.tau, copy.step(q, now[1], arriving), rtol=1e-5,
                                   atol=2e-4)
    assert copy.s < 0.7


def poles(scale: float) -> Array:
    """Return the poles of one joint without friction, for M̂ = scale M, by unit vectors."""
    drives = drive_model(np.zeros(1), np.full(1, math.inf), H)
    observer = state_observer(drives, W, np.full(1, 1e12))
    mass, none = np.full((1, 1), scale), np.zeros(1)
    columns = []
    for q, dq, q_o, dq_o, P, slope in np.eye(6):
        at = observer.correct(Observed(*np.array([[q_o], [dq_o], [0.0], [P], [slope]])), mass,
                              np.array([q]))
        tau = scale * (-KV[0, 0] * at.dq - KP[0, 0] * at.q) + at.perturbation
        at = observer.predict(at, mass, none, none, tau)
        true = q + H * dq + 0.5 * H * H * tau[0], dq + H * tau[0]
        columns.append([*true, at.q[0], at.dq[0], at.perturbation[0], at.slope[0]])
    found: Array = np.abs(np.linalg.eigvals(np.array(columns).T))
    return found


def test_the_range_of_inertia_that_is_stable() -> None:
    """Check what the law's page says: 0.47 < c < 3.1."""
    with np.errstate(all='ignore'):
        for scale, stable in ((0.46, False), (0.47, True), (1.0, True), (3.1, True),
                              (3.2, False)):
            assert (poles(scale).max() < 1.0) == stable, scale


def real(law: dict[str, Any], scale: float, duration: float = 6.0, start: float = 0.0,
         friction: float = 9.9, **plant: Any) -> Run:
    """Simulate the arm as drives and encoders are, from rest at q = 0, with a wrong model."""
    return closed_loop.simulate(
        PlantConfig.from_mapping({'duration': duration, 'coulomb_friction': [friction] * 2,
                                  **REAL, **plant}),
        ControllerConfig.from_mapping(
            {'inertia_scale': scale, 'gravity_scale': scale, 'input_delay': DELAY, **law}),
        ReferenceConfig(start_duration=start), truth=True)


@pytest.mark.parametrize('scale', [pytest.param(0.9, marks=pytest.mark.slow), 1.1])
def test_on_an_arm_as_drives_and_encoders_are(scale: float) -> None:
    """Check error and variation, after a start 3 rad off that costs bandwidth for 6 s."""
    found = real({**GAINS, **KNOWN}, scale, duration=8.0)
    assert (error(found, 2.0) < [3.5e-5, 1.6e-4]).all()
    assert (variation(found, 2.0) < [1300.0, 230.0]).all()


@pytest.mark.slow
@pytest.mark.parametrize(('friction', 'rate'), [
    (3.0, RATE), (9.9, 100.0 * RATE), (0.0, RATE)])
def test_another_friction_and_rate(friction: float, rate: Array) -> None:
    """Check that nothing is made for one case."""
    limits = {'torque_rate_limit': rate.tolist()}
    found = real({**GAINS, **KNOWN, **limits}, 1.1, friction=friction, **limits)
    assert (error(found, 2.0) < 5e-5).all()


def test_default_parameters_on_a_clean_arm() -> None:
    """Check the defaults with drives that are known to have no lag, from the reference on."""
    found = run('observer_feedback', ka=[15.0, 15.0], actuator_lag=[0.0, 0.0])
    assert (error(found) < [2e-4, 1e-3]).all()
    assert (variation(found) < [1100.0, 220.0]).all()


@pytest.mark.parametrize(('told', 'wrong'), [('rate', 3.0), ('rate', math.inf), ('lag', 0.0)])
def test_drives_that_are_not_as_told(told: str, wrong: float) -> None:
    """Check that the law loses bandwidth and not the robot; `test_without_the_guard` diverges."""
    law = {**GAINS, **KNOWN, 'estimator_bandwidth': 200.0, 'error_limit': [3.0, 3.0]}
    plant: dict[str, Any] = {}
    if told == 'rate':
        law['torque_rate_limit'] = (wrong * RATE).tolist()
    else:
        law['actuator_lag'], plant = [0.0, 0.0], {'actuator_lag': [5e-3, 5e-3]}
    assert (error(unaware(law, plant), 1.0) < [0.02, 0.15]).all()


def unaware(law: dict[str, Any], plant: dict[str, Any]) -> Run:
    """Simulate a smooth start under a controller whose model of the drives is wrong."""
    return closed_loop.simulate(
        PlantConfig.from_mapping({'duration': 2.5, 'coulomb_friction': [9.9] * 2, **REAL,
                                  **plant}),
        ControllerConfig.from_mapping({'inertia_scale': 1.1, 'gravity_scale': 1.1, **law}),
        ReferenceConfig(start_duration=2.0), truth=True)


def test_without_the_guard(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the test above has a bound that bites."""
    monkeypatch.setattr(oscillation, '_RETREAT', 0.0)
    law = {**GAINS, **KNOWN, 'estimator_bandwidth': 200.0, 'error_limit': [3.0, 3.0],
           'torque_rate_limit': (3.0 * RATE).tolist(), 'compiled': False}
    with pytest.raises(CtcError, match='exceeds error_limit'):
        unaware(law, {})


#: Drives of other robots: limits of the rate [N·m/s], and half the rated torque [N·m].
DRIVES = {'panda': ([1e3] * 7, [43.5] * 4 + [6.0] * 3),
          'ur5': ([2e3, 2e3, 1e3, 5e2, 5e2, 5e2], [75.0] * 3 + [14.0] * 3)}


def robot(name: str, **law: Any) -> Array:
    """Return the RMS errors of a robot on MuJoCo under realistic conditions, 2.5 s ≤ t ≤ 4 s."""
    rate, _ = DRIVES[name]
    n = len(rate)
    known: dict[str, Any] = {'input_delay': DELAY}
    setup = parameter_file.load(config_directory() / f'{name}.yaml', {
        'plant': {'duration': 4.0, 'torque_rate_limit': rate,
                  'actuator_lag': [LAG] * n, 'encoder_resolution': [1e-5] * n,
                  'velocity_sensor': 'difference', **known},
        'controller': {'inertia_scale': 0.9, 'gravity_scale': 0.9, **known, **law}})
    return error(simulated_by_mujoco(setup, truth=True).run, 1.5)


@pytest.mark.slow
@pytest.mark.parametrize('name', DRIVES)
def test_the_settings_of_the_docs_on_other_robots(name: str) -> None:
    """Check a twentieth of the error of compensation on each joint, and friction unknown."""
    rate, ka = DRIVES[name]
    n = len(rate)
    before = robot(name, law='compensation')
    after = robot(name, law='observer_feedback', kp=[1e4] * n, kv=[200.0] * n, ka=ka,
                  estimator_bandwidth=200.0, actuator_lag=[LAG] * n, torque_rate_limit=rate)
    assert (after < before / 20.0).all()
