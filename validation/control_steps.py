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
Torques of the laws (2) and (6), computed apart from the package, which a test compares with it.

The equations are those of the paper and of docs/theory.md, written with numpy, scipy and, for arms
of a URDF, Pinocchio. Nothing here is of `ctc_chattering`. A case is a model, a configuration,
changes of it and resets at some samples, and a motion: random states around a random reference, or
the states of a closed loop. `test/data/control_steps.npz` has cases, states and torques::

    make validate STUDY=control_steps

It computes all torques again from cases and states, prints the largest change, and writes them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, cached_property
import json
import math
from pathlib import Path
import random
from typing import Any, NamedTuple
from xml.etree import ElementTree

from independent_laws import Array, Dynamics, paper_dynamics
import numpy as np
import pinocchio as pin
from scipy.optimize import lsq_linear  # type: ignore[import-untyped]
from urdfs import PANDA, panda, two_links, UR5, ur5

Vector = list[float]
Point = tuple[Vector, Vector, Vector]
State = tuple[Vector, Vector]
#: The cases with their torques.
FILE = Path(__file__).parents[1] / 'test' / 'data' / 'control_steps.npz'
#: Samples of a case.
STEPS = 30
#: Joints of a model, in the order of its torques.
JOINTS = {'two_link': ('joint1', 'joint2'), 'swapped': ('b', 'a'), 'panda': PANDA, 'ur5': UR5}
URDFS: dict[str, Callable[[], str]] = {'swapped': two_links, 'panda': panda, 'ur5': ur5}


class PaperArm:
    """The two-link arm of the paper."""

    def __init__(self, gravity: float) -> None:
        self.effort_limits, self._gravity = np.full(2, np.inf), gravity

    def at(self, q: Array, dq: Array) -> Dynamics:
        """Return the dynamics in a state."""
        return paper_dynamics(q, dq, self._gravity)


class UrdfArm:
    """The arm of a URDF, by Pinocchio; joints that are not of the arm are locked at 0."""

    def __init__(self, name: str, gravity: float) -> None:
        text, joints = URDFS[name](), JOINTS[name]
        whole: Any = pin.buildModelFromXML(text)
        others = [k for k in range(1, whole.njoints) if whole.names[k] not in joints]
        self._model: Any = pin.buildReducedModel(whole, others, pin.neutral(whole))
        self._model.gravity.linear = np.array([0.0, 0.0, -gravity])
        self._data = self._model.createData()
        # Pinocchio's number of each joint.
        self._order = [self._model.joints[self._model.getJointId(x)].idx_v for x in joints]
        limits = {joint.get('name'): joint.find('limit')
                  for joint in ElementTree.fromstring(text).findall('joint')}
        efforts = [limits[name].get('effort') for name in joints]  # type: ignore[union-attr]
        # 0 in a URDF stands for no limit.
        self.effort_limits = np.array([float(x or 0.0) or np.inf for x in efforts])

    def _torque(self, q: Array, dq: Array) -> Array:
        """Return C dq + G."""
        at, velocity = np.zeros(len(q)), np.zeros(len(q))
        at[self._order], velocity[self._order] = q, dq
        torque = pin.nonLinearEffects(self._model, self._data, at, velocity)
        return np.array(torque[self._order])

    def at(self, q: Array, dq: Array) -> Dynamics:
        """Return the dynamics in a state; C of Christoffel's symbols, by polarisation."""
        at = np.zeros(len(q))
        at[self._order] = q
        upper = np.triu(pin.crba(self._model, self._data, at))
        M = (upper + np.triu(upper, 1).T)[np.ix_(self._order, self._order)]
        G = self._torque(q, 0.0 * dq)
        columns = [0.5 * (self._torque(q, dq + x) - self._torque(q, dq) - self._torque(q, x) + G)
                   for x in np.eye(len(q))]
        return Dynamics(M, np.transpose(columns), G)


def nearest(M: Array, point: Array, bound: Array) -> Array:
    """Return the point within ±bound that is nearest in the metric of M⁻¹, by scipy."""
    if (np.abs(point) <= bound).all():
        return point
    z, free = 0.0 * point, bound > 0.0
    if free.any():
        root = np.linalg.inv(np.linalg.cholesky(M))
        z[free] = lsq_linear(root[:, free], root @ point, (-bound[free], bound[free]),
                             method='bvls', tol=1e-15, max_iter=1000).x
    return z


class Torque(NamedTuple):
    """A torque that was sent, what it lacks of that of the law, and the clipping error."""

    sent: Array
    excess: Array
    clipped: Array


class Evaluated(NamedTuple):
    """The dynamics and the errors in a state."""

    q: Array
    dq: Array
    de: Array
    u: Array
    v: Array
    M: Array
    C: Array
    bias: Array
    N: Array


class LastSample(NamedTuple):
    """The terms of (S) at the last sample."""

    M: Array
    y: Array
    residual: Array


class Law:
    """The laws (2) and (6), sampled."""

    def __init__(self, config: Mapping[str, Any], model: PaperArm | UrdfArm) -> None:
        self._config, self._model = dict(config), model
        self._n = len(model.effort_limits)
        self._last: LastSample | None = None
        self.reset(False)

    def configure(self, changes: Mapping[str, Any]) -> None:
        """Take other parameters; another law begins with no estimate."""
        if changes.get('law', self._config['law']) != self._config['law']:
            self._P = np.zeros(self._n)
        self._last = None
        self._config |= changes

    def reset(self, bumpless: bool, held: Sequence[float] | None = None) -> None:
        """Begin with v = 0 (bumpless) or ξ = 0, and with the torque that is held."""
        zero = np.zeros(self._n)
        self._P, self._xi, self._begins = zero, zero, bumpless
        self._held = zero if held is None else np.array(held)
        self._transit = [Torque(zero, zero, zero)] * self._config['input_delay']
        self._last = None

    def _vector(self, name: str, default: float) -> Array:
        return np.array(self._config.get(name, [default] * self._n), float)

    def _gain(self, name: str) -> Array:
        """Return Kp or Kv, shape (n, n)."""
        values = np.array(self._config[name], float)
        return np.diag(values) if len(values) == self._n else values.reshape(self._n, self._n)

    @property
    def _b(self) -> float:
        return float(self._config['b'])

    @property
    def _h(self) -> float:
        return float(self._config['control_period'])

    @property
    def _decay(self) -> float:
        return math.exp(-self._config['lambda'] * self._h)

    @property
    def _c(self) -> float:
        return self._b * (1.0 - self._decay) / float(self._config['lambda'])

    @property
    def _has_observer(self) -> bool:
        return bool(self._config['law'] == 'chattering'
                    and self._config['switching'] == 'implicit_observer')

    def _evaluated(self, q: Array, dq: Array, point: Point, xi: Array) -> Evaluated:
        """Return N and v of (3) in a state."""
        q_d, dq_d, ddq_d = np.array(point)
        M, C, G = self._model.at(q, dq)
        scale = self._config.get('inertia_scale', 1.0)
        M, C, G = scale * M, scale * C, self._config.get('gravity_scale', 1.0) * G
        e, de = q_d - q, dq_d - dq
        u = self._gain('kv') @ de + self._gain('kp') @ e
        bias = C @ dq + G
        return Evaluated(q, dq, de, u, xi - self._b * de, M, C, bias, M @ (ddq_d + u) + bias)

    def _next_xi(self, s: Evaluated, xi: Array, excess: Array) -> Array:
        """Return ξ a period later; anti-windup takes the excess out."""
        xi = self._decay * xi + self._c * (self._config['lambda'] * s.de - s.u)
        if self._config['anti_windup']:
            xi = xi + self._b * self._h * np.linalg.solve(s.M, excess)
        return xi

    def _predicted(self, s: Evaluated, torque: Array) -> tuple[Array, Array]:
        """Return q and dq a period later by the midpoint rule."""
        h = self._h
        middle = s.dq + 0.5 * h * np.linalg.solve(s.M, torque - s.bias)
        half_way = self._evaluated(s.q + 0.5 * h * s.dq, middle, ([0.0] * self._n,) * 3, s.v)
        return s.q + h * middle, s.dq + h * np.linalg.solve(half_way.M, torque - half_way.bias)

    def _y(self, s: Evaluated) -> Array:
        """Return y of (S)."""
        return self._decay * s.v + (self._b * self._h - self._c) * s.u

    def _observe(self, s: Evaluated) -> None:
        """Improve P̂ by what v has become since the last sample, (S)."""
        if self._last is None:
            return
        M, y, residual = self._last
        P = M @ (y - s.v) / (self._b * self._h) - residual
        gain = 1.0 - math.exp(-self._config['observer_bandwidth'] * self._h)
        self._P = nearest(M, self._P + gain * (P - self._P), self._vector('ka', 0.0))

    def _chattering(self, s: Evaluated) -> tuple[Array, Array]:
        """Return z, and what ±Ka has clipped off it."""
        ka, zero, kind = self._vector('ka', 0.0), np.zeros(self._n), self._config['switching']
        if kind == 'sign':
            return ka * np.sign(s.v), zero
        if kind == 'boundary_layer':
            return ka * np.clip(s.v / self._config['boundary_layer'], -1.0, 1.0), zero
        w = s.M @ self._y(s) / (self._b * self._h) - s.C @ s.v
        if kind == 'implicit':
            return nearest(s.M, w, ka), zero
        z = nearest(s.M, w - self._P, ka)
        return z, w - self._P - z

    def step(self, q: Vector, dq: Vector, points: Sequence[Point]) -> Array:
        """Return the torque; `points` are the reference of this sample and of the delay."""
        if self._begins:
            self._xi = self._b * (np.array(points[0][1]) - np.array(dq))
            self._begins = False
        now = s = self._evaluated(np.array(q), np.array(dq), points[0], self._xi)
        if self._has_observer:
            self._observe(now)
        P, xi = self._P if self._has_observer else 0.0 * self._P, self._xi
        for torque, point in zip(self._transit, points[1:]):
            xi = self._next_xi(s, xi, torque.excess)
            s = self._evaluated(*self._predicted(s, torque.sent - P), point, xi)
        own, clipped = s.N - s.C @ s.v, np.zeros(self._n)
        if self._config['law'] == 'chattering':
            z, clipped = self._chattering(s)
            own = own - z
        sent = self._limited(own)
        self._transit.append(Torque(sent, own - sent, clipped))
        applied = self._transit.pop(0)
        self._xi = self._next_xi(now, self._xi, applied.excess)
        excess = applied.excess if self._config['anti_windup'] else 0.0 * applied.excess
        made_good = np.where(np.abs(applied.clipped) < self._vector('ka', 0.0),
                             0.5 * applied.clipped, 0.0)
        self._last = LastSample(
            now.M, self._y(now), now.N - applied.sent - excess + made_good)
        self._held = sent
        return sent

    def _limited(self, torque: Array) -> Array:
        """Return a torque within the limits of its rate and size; those of the URDF if not set."""
        effort = self._vector('effort_limit', np.inf)
        effort = np.where(np.isinf(effort), self._model.effort_limits, effort)
        change = self._h * self._vector('effort_rate_limit', np.inf)
        near = np.clip(torque, self._held - change, self._held + change)
        return np.clip(near, -effort, effort)


@cache
def model_of(name: str, gravity: float) -> PaperArm | UrdfArm:
    """Return a model by its name in the cases."""
    return PaperArm(gravity) if name == 'two_link' else UrdfArm(name, gravity)


class Case:
    """A case of the file, with the states that its torques answer."""

    def __init__(self, values: dict[str, Any], recorded: Array | None) -> None:
        #: ``model``, ``config``, ``actions`` by sample, and ``scale``, the largest term [N·m].
        self.values = values
        self.n = len(JOINTS[values['model']])
        self._recorded = recorded

    @cached_property
    def motion(self) -> tuple[list[State], list[Point]]:
        """States, and a reference that is five samples longer."""
        if self._recorded is None:
            return random_motion(self.values, self.n)
        return ([(q, dq) for q, dq in self._recorded.tolist()],
                smooth_motion(self.values, self.n))

    def torques(self) -> Array:
        """Return the torques, shape (STEPS, n)."""
        config, actions = self.values['config'], self.values['actions']
        law = Law(config, model_of(self.values['model'], config['gravity']))
        torques, (states, points) = [], self.motion
        for k, (q, dq) in enumerate(states):
            action = actions.get(str(k), {})
            if 'configure' in action:
                law.configure(action['configure'])
            if 'reset' in action:
                law.reset(action['reset'], action.get('held'))
            torques.append(law.step(q, dq, points[k:k + 1 + config['input_delay']]))
        return np.array(torques)


def random_motion(case: dict[str, Any], n: int) -> tuple[list[State], list[Point]]:
    """Return states around a reference that is different at every sample."""
    dice = random.Random(case['seed'])

    def near(row: Vector, span: float) -> Vector:
        return [x + span * dice.uniform(-1.0, 1.0) for x in row]

    points: list[Point] = [
        (near([0.0] * n, 3.0), near([0.0] * n, 3.0), near([0.0] * n, 20.0))
        for _ in range(STEPS + 5)]
    size = case['size']
    return [(near(q, size), near(dq, size)) for q, dq, _ in points[:STEPS]], points


def smooth_motion(case: dict[str, Any], n: int) -> list[Point]:
    """Return the reference of a recorded closed loop."""
    h, w, center = case['config']['control_period'], [3.0 + i for i in range(n)], case['center']
    return [([c + 0.2 * (1.0 - math.cos(x * k * h)) for c, x in zip(center, w)],
             [0.2 * x * math.sin(x * k * h) for x in w],
             [0.2 * x ** 2 * math.cos(x * k * h) for x in w]) for k in range(STEPS + 5)]


def cases() -> Iterator[tuple[Case, Array]]:
    """Yield the cases of the file, each with its torques, shape (STEPS, n)."""
    data = np.load(FILE)
    torques, states = data['torques'], data['states'].astype(float)
    at = since = 0
    for values in json.loads(data['cases'].tobytes()):
        n, recorded = len(JOINTS[values['model']]), None
        if values['closed']:
            recorded = states[since:since + STEPS * 2 * n].reshape(STEPS, 2, n)
            since += STEPS * 2 * n
        yield Case(values, recorded), torques[at:at + STEPS * n].reshape(STEPS, n)
        at += STEPS * n


def main() -> None:
    """Compute the torques of all cases, and write the file."""
    torques, largest = [], 0.0
    for case, before in cases():
        torques.append(case.torques())
        gap = np.abs(torques[-1] - before).max() / case.values['scale']
        largest = max(largest, gap)
        if gap > 1e-10:
            print(f'{case.values["model"]} {case.values["seed"]}: {gap:.2g}')
    print(f'largest change: {largest:.2g} of the largest term of a case')
    data = np.load(FILE)
    np.savez_compressed(FILE, cases=data['cases'], states=data['states'],
                        torques=np.concatenate([x.ravel() for x in torques]))


if __name__ == '__main__':
    main()
