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

"""Rivals of `observer_feedback` for the two-link arm, written by hand as `independent_laws` is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from independent_laws import Array, drive_over, Gains, Known, ObserverFeedback, Point
import numpy as np


class At(NamedTuple):
    """A state with the model and the reference there."""

    M: Array
    C: Array
    G: Array
    e: Array
    de: Array
    point: Point


class Rival:
    """Computed torque at the state predicted for the arrival; its subclasses add a term."""

    def __init__(self, known: Known, numbers: Mapping[str, Any]) -> None:
        self.known = known
        self.kp, self.kv = (np.array(numbers.get(x, y)) for x, y in (('kp', 100.), ('kv', 50.)))
        self.transit = [np.zeros(2)] * known.delay
        self.start(numbers)

    def start(self, numbers: Mapping[str, Any]) -> None:
        """Begin."""

    def term(self, at: At) -> Array:
        """Return what is added to M (ddq_d + Kv de + Kp e) + C dq + G."""
        raise NotImplementedError

    def estimate(self, at: At) -> Array:
        """Return the perturbation, for the prediction; 0 for none."""
        return 0.0 * at.e

    def passed(self, e: Array, de: Array) -> None:
        """Go on by a period on the way to the arrival."""

    def limited(self, at: At, tau: Array) -> Array:
        """Return the command for a wanted torque."""
        del at
        return tau

    def advance(self, at: At) -> None:
        """Go on by a period from the measured state."""

    def at(self, q: Array, dq: Array, point: Point) -> At:
        """Return a state with what belongs to it."""
        return At(*self.known.matrices(q, dq), point.q - q, point.dq - dq, point)

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        """Return the command for a measured state; `points` are the reference from now on."""
        h, now = self.known.period, self.at(q, dq, points[0])
        P = self.estimate(now)
        for point, command in zip(points, self.transit):
            self.passed(point.q - q, point.dq - dq)
            M, bias = self.known.model(q, dq)
            middle = dq + 0.5 * h * np.linalg.solve(M, command - P - bias)
            M, bias = self.known.model(q + 0.5 * h * dq, middle)
            q, dq = q + h * middle, dq + h * np.linalg.solve(M, command - P - bias)
        at = self.at(q, dq, points[len(self.transit)])
        tau: Array = at.M @ (at.point.ddq + self.kv * at.de + self.kp * at.e) + (
            at.C @ dq + at.G + self.term(at))
        tau = self.limited(at, tau)
        self.advance(now)
        self.transit = [*self.transit, tau][1:]
        return tau


class Compensation(Rival):
    """Law (2): - C v with the filter (3)."""

    def start(self, numbers: Mapping[str, Any]) -> None:
        self.lam, self.b = numbers.get('lambda', 10.0), numbers.get('b', 1.0)
        self.xi = self.later = np.zeros(2)

    def filtered(self, xi: Array, e: Array, de: Array) -> Array:
        """Return ξ a period later."""
        keeps = np.exp(-self.lam * self.known.period)
        driven: Array = (self.lam - self.kv) * de - self.kp * e
        after: Array = keeps * xi + (1.0 - keeps) / self.lam * self.b * driven
        return after

    def passed(self, e: Array, de: Array) -> None:
        self.later = self.filtered(self.later, e, de)

    def term(self, at: At) -> Array:
        torque: Array = -at.C @ (self.later - self.b * at.de)
        return torque

    def advance(self, at: At) -> None:
        self.xi = self.later = self.filtered(self.xi, at.e, at.de)


class Integral(Rival):
    """Computed torque with an integral."""

    def start(self, numbers: Mapping[str, Any]) -> None:
        self.ki = np.array(numbers['ki'])
        self.x: Array = np.zeros(2)

    def term(self, at: At) -> Array:
        torque: Array = at.M @ self.x
        return torque

    def estimate(self, at: At) -> Array:
        torque: Array = at.M @ self.x
        return torque

    def advance(self, at: At) -> None:
        self.x = self.x + self.known.period * self.ki * at.e


class FrictionFeedforward(Rival):
    """Computed torque with the friction of the desired velocity."""

    def start(self, numbers: Mapping[str, Any]) -> None:
        self.level: Array = np.array(numbers['friction_level'])
        self.width = numbers['friction_velocity']

    def term(self, at: At) -> Array:
        torque: Array = self.level * np.tanh(at.point.dq / self.width)
        return torque

    def estimate(self, at: At) -> Array:
        torque: Array = self.level * np.tanh(at.point.dq / self.width)
        return torque


class SlotineLi(FrictionFeedforward):
    """The passivity-based adaptive law with the level of friction as its parameter."""

    def start(self, numbers: Mapping[str, Any]) -> None:
        super().start(numbers)
        self.gain, self.slide = np.array(numbers.get('adaptation_gain', 100.0)), self.kp / self.kv

    def term(self, at: At) -> Array:
        # In place of M (ddq_d + u) + C dq + G: M ddq_r + C dq_r + G + D u.
        u, s = self.kv * at.de + self.kp * at.e, at.de + self.slide * at.e
        alone = 1.0 / np.linalg.inv(at.M).diagonal()
        torque: Array = (at.M @ (self.slide * at.de - u) + at.C @ s + alone * u
                         + self.level * self.direction(at))
        return torque

    def direction(self, at: At) -> Array:
        """Return the smoothed sign of dq_r."""
        way: Array = np.tanh((at.point.dq + self.slide * at.e) / self.width)
        return way

    def estimate(self, at: At) -> Array:
        torque: Array = self.level * self.direction(at)
        return torque

    def advance(self, at: At) -> None:
        s = at.de + self.slide * at.e
        self.level = np.maximum(
            self.level + self.known.period * self.gain * self.direction(at) * s, 0.0)


class ExtendedState(ObserverFeedback):
    """Active disturbance rejection on the same observer, with a friction that is known."""

    def __init__(self, known: Known, numbers: Mapping[str, Any]) -> None:
        super().__init__(known, Gains(
            float(np.ravel(numbers['kp'])[0]), float(np.ravel(numbers['kv'])[0]), numbers['ka'],
            numbers['estimator_bandwidth'], 0.0))
        self.level = np.array(numbers['friction_level'])
        self.width, self.lead = numbers['friction_velocity'], numbers.get('friction_lead', 0.0)
        self.last = np.zeros(2)

    def fed(self, point: Point) -> Array:
        """Return the friction that is fed forward."""
        F: Array = self.level * np.tanh((point.dq + self.lead * point.ddq) / self.width)
        return F

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        h = self.known.period
        at = now = self.corrected(q, dq)
        M, bias = mass, weight = self.known.model(at.q, at.dq)
        for point, command in zip(points, self.transit):
            at = self.ahead(at, M, bias + self.fed(point), command)
            M, bias = self.known.model(at.q, at.dq)
        point, held = points[len(self.transit)], at.torque
        at = self.ahead(at, M, bias + self.fed(point), self.last)
        M, bias = self.known.model(at.q, at.dq)
        jerk = np.zeros(2) if self.ddq is None else (point.ddq - self.ddq) / h
        then = Point(point.q + h * point.dq + h * h / 2 * point.ddq + h ** 3 / 6 * jerk,
                     point.dq + h * point.ddq + h * h / 2 * jerk, point.ddq + h * jerk)
        u = self.gains.kv * (then.dq - at.dq) + self.gains.kp * (then.q - at.q)
        tau = M @ (then.ddq + u) + bias + at.P + self.fed(then)
        E, most = np.exp(-h / np.maximum(self.T, 1e-12)), self.R * (self.T + h)
        sent: Array = np.clip((tau - E * held) / (1.0 - E), held - most, held + most)
        self.ddq, self.last, self.before = point.ddq, sent, mass
        self.transit.append(sent)
        self.seen = self.ahead(now, mass, weight + self.fed(points[0]), self.transit.pop(0))
        return sent


class PidKalman(Integral):
    """PID with inverse dynamics on a Kalman velocity, with lead and friction fed forward."""

    def start(self, numbers: Mapping[str, Any]) -> None:
        super().start(numbers)
        h = self.known.period
        self.level, self.width = np.array(numbers['friction_level']), numbers['friction_velocity']
        self.early = numbers.get('friction_lead', 0.0)
        lag = np.maximum(np.array(self.known.lag), 1e-12)
        self.E, self.D = np.exp(-h / lag), np.exp(-h / (numbers.get('lead_ratio', 0.5) * lag))
        self.gains = kalman(numbers['estimator_bandwidth'] * h) / np.array([1.0, h, h * h])
        self.hat: Array | None = None
        self.torque, self.asked = np.zeros(2), np.zeros(2)
        self.sent: Array | None = None
        self.back = 1.0 - np.exp(-h * self.ki / self.kp)

    def term(self, at: At) -> Array:
        F: Array = self.level * np.tanh((at.point.dq + self.early * at.point.ddq) / self.width)
        return at.M @ self.x + F

    def estimate(self, at: At) -> Array:
        return self.term(at)

    def limited(self, at: At, tau: Array) -> Array:
        h, held = self.known.period, self.torque
        for command in self.transit:
            held = drive_over(self.known, held, command)[0]
        command = tau if self.sent is None else self.D * self.sent + (1.0 - self.D) / (
            1.0 - self.E) * (tau - self.E * self.asked)
        most = np.array(self.known.rate) * (np.array(self.known.lag) + h)
        sent: Array = np.clip(command, held - most, held + most)
        self.x = self.x - self.back * np.linalg.solve(at.M, command - sent)
        self.asked, self.sent = tau, sent
        return sent

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        h = self.known.period
        hat = np.array([q, dq, 0.0 * q])
        if self.hat is not None:
            hat = self.hat + np.outer(self.gains, q - self.hat[0])
        first = [*self.transit]
        sent = super().step(q, hat[1], points)
        self.hat = np.array([hat[0] + h * hat[1] + h * h / 2 * hat[2], hat[1] + h * hat[2],
                             hat[2]])
        self.torque = drive_over(self.known, self.torque, [*first, sent][0])[0]
        return sent


def kalman(bandwidth: float) -> Array:
    """Return the steady gains of a random jerk, by running the filter until it is steady."""
    A = np.array([[1.0, 1.0, 0.5], [0.0, 1.0, 1.0], [0.0, 0.0, 1.0]])
    g = bandwidth ** 3 * np.array([1.0 / 6.0, 0.5, 1.0])
    P = np.eye(3)
    for _ in range(200_000):
        k = P[:, 0] / (P[0, 0] + 1.0)
        after = A @ (P - np.outer(k, P[0])) @ A.T + np.outer(g, g)
        if np.abs(after - P).max() < 1e-15 * np.abs(P).max():
            break
        P = after
    gains: Array = P[:, 0] / (P[0, 0] + 1.0)
    return gains


#: The rivals by the name that the package has for them.
RIVALS: dict[str, type[Rival | ExtendedState]] = {
    'compensation': Compensation, 'integral': Integral,
    'friction_feedforward': FrictionFeedforward, 'slotine_li': SlotineLi,
    'pid_kalman': PidKalman, 'extended_state_observer': ExtendedState}
