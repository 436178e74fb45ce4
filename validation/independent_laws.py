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
Laws for the two-link arm, written by hand from docs/theory.md and the laws' equations in numpy.

Nothing here is of `ctc_chattering`. A law is an object whose `step` takes what is measured and
the reference of this sample and of the next ones, and returns the command.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]


class Dynamics(NamedTuple):
    """M and C, shape (n, n), and G, shape (n,), in a state."""

    M: Array
    C: Array
    G: Array


def paper_dynamics(q: Array, dq: Array, gravity: float) -> Dynamics:
    """Return the dynamics of the paper's two-link arm."""
    c, s = np.cos(q[1]), np.sin(q[1])
    fall = 0.63 * gravity * np.sin(q[0] + q[1])
    coupling = 0.76 + 0.51 * c
    M = np.array([[8.77 + 1.02 * c, coupling], [coupling, 0.62]])
    C = 0.51 * s * np.array([[-dq[1], -dq[0] - dq[1]], [dq[0], 0.0]])
    G = np.array([7.6 * gravity * np.sin(q[0]) + fall, fall])
    return Dynamics(M, C, G)


class Known(NamedTuple):
    """Knowledge of all laws: the model with its error, and the drives, of shape (2,)."""

    scale: float = 1.0
    period: float = 1e-3
    delay: int = 1
    lag: Any = (2e-3, 2e-3)
    rate: Any = (5e3, 1e3)

    def matrices(self, q: Array, dq: Array) -> tuple[Array, Array, Array]:
        """Return M, C and G of the paper, times `scale`."""
        M, C, G = paper_dynamics(q, dq, 9.81)
        return self.scale * M, self.scale * C, self.scale * G

    def model(self, q: Array, dq: Array) -> tuple[Array, Array]:
        """Return M and C dq + G."""
        M, C, G = self.matrices(q, dq)
        return M, C @ dq + G


class Point(NamedTuple):
    """The reference at a sample."""

    q: Array
    dq: Array
    ddq: Array


def nearest(M: Array, point: Array, bound: Array) -> Array:
    """Return the point of a box that is nearest in the metric of M⁻¹: the best of four edges."""
    if (np.abs(point) <= bound).all():
        return point
    A = np.array([[M[1, 1], -M[0, 1]], [-M[0, 1], M[0, 0]]])
    best, least = point, np.inf
    for i in (0, 1):
        j = 1 - i
        for side in (bound[i], -bound[i]) if np.isfinite(bound[i]) else ():
            z = np.empty(2)
            z[i] = side
            z[j] = min(max(point[j] - A[i, j] / A[j, j] * (side - point[i]), -bound[j]), bound[j])
            way = z - point
            value = way @ A @ way
            if value < least:
                best, least = z, value
    return best


def drive_over(known: Known, torque: Array, command: Array) -> tuple[Array, Array, Array]:
    """Return the torque after a period, its mean, and its mean weighted by the time left."""
    h, found = known.period, np.empty((3, 2))
    for i, (T, R) in enumerate(zip(known.lag, known.rate)):
        c, x = command[i], torque[i] - command[i]
        r = min(max(abs(x) / R - T, 0.0), h)
        slope = -np.sign(x) * (R if np.isfinite(R) else 0.0)
        left, x1 = h - r, x + slope * r
        e = np.exp(-left / T) if T > 0.0 else 0.0
        area = r * (x + 0.5 * slope * r) + T * x1 * (1.0 - e)
        moment = r * x * (h - 0.5 * r) + slope * r * r * (0.5 * h - r / 3.0) + x1 * T * (
            left - T * (1.0 - e))
        found[:, i] = c + x1 * e if left > 0.0 or T > 0.0 else c + x1, c + area / h, (
            c + 2.0 * moment / h ** 2)
    return found[0], found[1], found[2]


class Gains(NamedTuple):
    """Gains of `ObserverFeedback`, as the package's parameters are called."""

    kp: float = 1e4
    kv: float = 200.0
    ka: Any = (60.0, 30.0)
    estimator_bandwidth: float = 200.0
    friction_learning: float = 20.0
    friction_level: Any = (0.0, 0.0)
    #: Whether it gives up bandwidth where its feedback oscillates.
    guarded: bool = False


class Seen(NamedTuple):
    """An observed state of arm and drives."""

    q: Array
    dq: Array
    torque: Array
    P: Array
    slope: Array


class ObserverFeedback:
    """The law of docs/theory.md, "On drives and encoders"."""

    def __init__(self, known: Known, gains: Gains) -> None:
        self.known, self.gains = known, gains
        self.R, self.T = np.array(known.rate), np.array(known.lag)
        self.Ka, self.K = np.array(gains.ka), np.array(gains.friction_level)
        self.transit = [np.zeros(2)] * known.delay
        self.seen: Seen | None = None
        self.before: Array = np.zeros((2, 2))
        self.x: tuple[Array, Array] | None = None
        self.ddq: Array | None = None
        self.lags: list[Array] = [np.zeros(2)] * 3
        self.slow_sign, self.slow_P = np.zeros(2), np.zeros(2)
        # Of the hold at rest: place, time of joint and reference there, and who is held.
        self.place, self.stood, self.waited = np.zeros(2), np.zeros(2), np.zeros(2)
        self.held: Flags = np.zeros(2, bool)
        # ln s and s of (OG1), the half-waves of the feedback, the last first, its slow part, and
        # the feedback.
        self.retreat, self.part = 0.0, 1.0
        self.waves, self.slow_f, self.f = np.zeros((3, 2)), np.zeros(2), np.zeros(2)

    def ahead(self, at: Seen, M: Array, bias: Array, command: Array) -> Seen:
        """Return the state a period later, (SO1)."""
        h = self.known.period
        end, mean, weighted = drive_over(self.known, at.torque, command)
        push = M @ at.dq / h + mean - bias - at.P - 0.5 * h * at.slope
        dq: Array = h * np.linalg.solve(M, push - nearest(M, push, self.K)).astype(np.float64)
        more = weighted - mean + h / 6.0 * at.slope
        q = at.q + 0.5 * h * (at.dq + dq) + 0.5 * h * h * np.linalg.solve(M, more)
        return Seen(q, dq, end, at.P + h * at.slope, at.slope)

    def rested(self, q: Array) -> None:
        """Take a measured position for (SS1)."""
        moved = np.abs(q - self.place) > 1e-4
        self.place = np.where(moved, q, self.place)
        self.stood = np.where(moved, 0.0, self.stood + self.known.period)
        self.waited = np.where(moved & self.held, 0.0, self.waited)
        self.held = self.held & ~moved

    def hold(self, point: Point, M: Array) -> None:
        """Hold the joints that (SS1) and (SS2) say."""
        w = self.gains.estimator_bandwidth
        still = (np.abs(point.dq) <= 1e-9) & (np.abs(point.ddq) <= 1e-9)
        self.waited = np.where(still, self.waited + self.known.period, 0.0)
        long = (self.stood >= 2.0 / w) & (
            self.stood * self.waited >= (6.0 / w + self.Ka / self.R) ** 2)
        self.held = still & long & (self.K * self.stood ** 2 >= 4e-4 * M.diagonal())

    def corrected(self, q: Array, dq: Array) -> Seen:
        """Return the state with what the measured position says, (SO2)."""
        self.rested(q)
        if self.seen is None:
            return Seen(q, dq, np.zeros(2), np.zeros(2), np.zeros(2))
        h, at = self.known.period, self.seen
        w, s = np.exp(-self.gains.estimator_bandwidth * h), self.part
        e = q - at.q
        force = self.before @ e
        P = nearest(self.before, at.P - 2.0 * s * (1 - w) ** 3 * (1 + w) / h ** 2 * force,
                    np.sqrt(s) * self.Ka)
        slope = at.slope - s * s * (1 - w) ** 4 / h ** 3 * force
        slope[(np.abs(P) >= np.sqrt(s) * self.Ka) & (slope * P > 0.0)] = 0.0
        return Seen(
            at.q + (1 - w ** 4) * e,
            at.dq + (1 - w) ** 2 * (11 + 14 * w + 11 * w * w) / (6.0 * h) * e, at.torque,
            np.where(self.held, at.P, P), np.where(self.held, 0.0, slope))

    def friction(self, point: Point, later: float) -> Array:
        """Return F of (FR1)."""
        F = np.zeros(2)
        for i in (0, 1):
            T = max(self.K[i] / self.R[i], 1e-6)
            s = (point.dq[i] + (0.67 * T + later) * point.ddq[i]) / max(
                abs(point.ddq[i]) * T, 1e-12)
            size = abs(s) if abs(s) <= 1.35 else max(2.7 - abs(s), 1.0)
            F[i] = self.K[i] * np.sign(s) * size
        return F

    def back(self, M: Array, x: tuple[Array, Array]) -> Array:
        """Return -2 w dx - w² x with w of (FR4)."""
        found, limited = np.zeros(2), np.isfinite(self.R).any()
        for i in (0, 1):
            w = self.part * min(0.6 * np.sqrt(self.gains.kp), 0.5 / self.known.period)
            if limited:
                J = 0.5 * self.R[i] / M[i, i]
                w = min(w, 0.55 * self.R[i] / max(self.K[i], 1e-12),
                        np.cbrt(J / max(abs(x[0][i]), 1e-12)),
                        np.sqrt(J / max(abs(x[1][i]), 1e-12)))
            found[i] = -2.0 * w * x[1][i] - w * w * x[0][i]
        return found

    def wanted(self, at: Seen, M: Array, bias: Array, point: Point, x: tuple[Array, Array]
               ) -> Array:
        """Return τ* of (OF2) and (OF3)."""
        k = min(max(self.part, 10.0 / np.sqrt(self.gains.kp)), 1.0)
        u = k * self.gains.kv * (point.dq + x[1] - at.dq) + (
            k * k * self.gains.kp * (point.q + x[0] - at.q))
        self.f = M @ u
        z = -nearest(M, at.P + self.friction(point, 0.0), self.Ka)
        torque: Array = M @ (point.ddq + self.back(M, x) + u) + bias - z
        return torque

    def followed(self, M: Array, point: Point, x: tuple[Array, Array]) -> tuple[Array, Array]:
        """Return x and dx a period later, (FR3)."""
        h, m, back = self.known.period, M.diagonal(), self.back(M, x)
        F = self.friction(point, 0.5 * h)
        f = np.clip(m * ((point.dq + x[1]) / h + point.ddq + back) + F, -self.K, self.K)
        stands = (np.abs(point.dq) <= 1e-9) & (np.abs(point.ddq) <= 1e-9)
        ddx = np.where(stands, 0.0, (F - f) / m) + back
        return x[0] + h * x[1] + 0.5 * h * h * ddx, x[1] + h * ddx

    def relief(self) -> Array:
        """Return the divisor of (FR5)."""
        return self.gains.kv + self.T * self.gains.kp

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        """Return the command for a measured state; `points` are the reference from now on."""
        h = self.known.period
        at = now = self.corrected(q, dq)
        M, bias = mass, weight = self.known.model(at.q, at.dq)
        for command in self.transit:
            at = self.ahead(at, M, bias, command)
            M, bias = self.known.model(at.q, at.dq)
        point = points[len(self.transit)]
        x = (at.q - point.q, at.dq - point.dq) if self.x is None else self.x
        tau, feedback = self.wanted(at, M, bias, point, x), self.f
        x = self.followed(M, point, x)
        if self.T.any():
            half = 0.5 * (at.torque + tau)
            after = self.ahead(at._replace(torque=half), M, bias, half)
            step = np.zeros(2) if self.ddq is None else point.ddq - self.ddq
            then = self.wanted(after, *self.known.model(after.q, after.dq), Point(
                point.q + h * point.dq + h * h * (0.5 * point.ddq + step / 6.0),
                point.dq + h * point.ddq + 0.5 * h * step, point.ddq + step), x)
            E = np.exp(-h / np.maximum(self.T, 1e-12))
            tau = np.where(self.T > 0.0, (then - E * tau) / (1.0 - E), tau)
        sent: Array = at.torque + nearest(M, tau - at.torque, self.R * (self.T + h))
        if np.isfinite(self.R).any():
            rest = tau - sent
            rest = rest - np.clip(rest, -10e-3 * self.R, 10e-3 * self.R)
            x = x[0], x[1] - np.linalg.solve(M, rest) / self.relief()
        self.hold(point, M)
        self.x, self.ddq, self.before = x, point.ddq, mass
        self.noticed(feedback, tau - sent)
        self.K = self.learned(now)
        self.transit.append(sent)
        self.seen = self.ahead(now, mass, weight, self.transit.pop(0))
        return sent

    def noticed(self, feedback: Array, missing: Array) -> None:
        """Go on with s of (OG1)."""
        h = self.known.period
        self.waves = self.waves * np.exp(-10.0 * h)
        for i in (0, 1):
            if feedback[i] * self.waves[0, i] < 0.0:
                self.waves[:, i] = [0.0, *self.waves[:2, i]]
            if abs(feedback[i]) > abs(self.waves[0, i]):
                self.waves[0, i] = feedback[i]
        f1, f2, size = abs(self.waves[1]), abs(self.waves[2]), np.abs(feedback)
        follow = self.R / np.sqrt(self.gains.kp)
        given = np.sign(feedback) * np.maximum(size - np.abs(missing), 0.0)
        part = np.exp(self.retreat) * (1.0 - np.exp(-30.0 * h))
        self.slow_f = self.slow_f + part * (given - self.slow_f)
        known = np.where(np.isfinite(follow), follow, 0.0)
        ratio = np.max(np.maximum(
            np.abs(given - self.slow_f) / (self.Ka + known + np.abs(self.slow_f)),
            np.minimum(size, np.minimum(f1, f2)) / np.minimum(self.Ka, follow)))
        if self.gains.guarded:
            self.retreat = max(np.exp(-0.5 * h) * self.retreat - 80.0 * h * max(ratio - 0.5, 0.0),
                               np.log(0.1))
            self.part = np.exp(self.retreat) if self.retreat <= -1e-3 else 1.0

    def learned(self, at: Seen) -> Array:
        """Return K̂ of (FL1)."""
        gain, h = self.gains.friction_learning, self.known.period
        w = self.gains.estimator_bandwidth
        go, slow = self.part * (1.0 - np.exp(-w * h)), 1.0 - np.exp(-60.0 * h)
        x, lags = np.where(np.abs(at.dq) > 2e-3, np.sign(at.dq), 0.0), []
        for lag in self.lags:
            x = lag + go * (x - lag)
            lags.append(x)
        self.lags = lags
        self.slow_sign = self.slow_sign + slow * (x - self.slow_sign)
        self.slow_P = self.slow_P + slow * (at.P - self.slow_P)
        level: Array = np.clip(
            self.K + gain * h * (x - self.slow_sign) * (at.P - self.slow_P), 0.0, self.Ka)
        return level


class Sliding(ObserverFeedback):
    """
    Law (6) on the state that `observer_feedback` observes: see docs/paper.md.

    z ∈ Ka Sgn(v̂), v̂ = y - H M⁻¹ (C v + z + P̂ + F): v after a step of H, as it is estimated, and
    b = 1.
    """

    def __init__(self, known: Known, gains: Gains, horizon: float, pole: float = 10.0) -> None:
        super().__init__(known, gains)
        h = known.period
        self.horizon, self.pole, self.decay = horizon, pole, np.exp(-pole * h)
        self.gain = (1.0 - self.decay) / pole
        #: ξ of the filter (3) at the arrival, and after every further period.
        self.xi = [np.zeros(2)]
        #: v̂ and z of the last evaluation, and y.
        self.ahead_of: tuple[Array, Array] = np.zeros(2), np.zeros(2)
        self.nominal: Array = np.zeros(2)

    def step(self, q: Array, dq: Array, points: list[Point]) -> Array:
        """Return the command, and advance the filter."""
        sent = super().step(q, dq, points)
        self.xi = [self.xi[1]]
        return sent

    def relief(self) -> Array:
        """Return the divisor of (FR5), with what z adds to Kv."""
        return super().relief() + 1.0 / self.horizon

    def wanted(self, at: Seen, M: Array, bias: Array, point: Point, x: tuple[Array, Array]
               ) -> Array:
        """Return τ* of law (6)."""
        h, C = self.known.period, self.known.matrices(at.q, at.dq)[1]
        de = point.dq + x[1] - at.dq
        u = self.gains.kv * de + self.gains.kp * (point.q + x[0] - at.q)
        v = self.xi[-1] - de
        y = self.nominal = self.decay * v + (h - self.gain) * u
        self.xi.append(self.decay * self.xi[-1] + self.gain * (self.pole * de - u))
        load = C @ v + at.P + self.friction(point, 0.0)
        z = nearest(M, M @ y / self.horizon - load, self.Ka)
        if np.isfinite(self.horizon):
            self.ahead_of = y - self.horizon * np.linalg.solve(M, z + load), z
        torque: Array = M @ (point.ddq + self.back(M, x) + u) + bias - C @ v - z
        return torque
