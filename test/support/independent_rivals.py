"""Rivals of `observer_feedback` for the two-link arm, written by hand as `independent_laws` is."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

from independent_laws import Array, Known, Point
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
        self.gain, self.slide = np.array(numbers['adaptation_gain']), self.kp / self.kv

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


#: The rivals by the name that the package has for them.
RIVALS: dict[str, type[Rival]] = {
    'compensation': Compensation, 'integral': Integral,
    'friction_feedforward': FrictionFeedforward, 'slotine_li': SlotineLi}
