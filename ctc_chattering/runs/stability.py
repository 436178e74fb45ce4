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
A law as a linear system, taken from its own code.

The control step of a law runs with a model of constant M̂ and no C and G, in a steady motion of 1
rad/s: friction has one sign there, and nothing is at rest. Central differences of the step give::

    x⁺ = A x + B y,     τ = C x + D y,     y = (q, dq)                                    (LL1)

for deviations of everything that is remembered. Differences of two sizes must agree; those of a
law that is not linear there do not. What y does not reach, or does not reach τ, is left out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from functools import cached_property
import math
from typing import Any, NamedTuple

from ctc_chattering.analysis.tables import rounded
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.irregular_sample import REGULAR
from ctc_chattering.control.sample import Context, Models, TRANSIT_ROWS
from ctc_chattering.control.step import step
from ctc_chattering.dynamics.drive_response import discretize_drives
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, peak_gain, Rows, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
from ctc_chattering.runs.recommended import desired_points
import numpy as np
from scipy.linalg import eigh  # type: ignore[import-untyped]
from scipy.optimize import bisect, minimize_scalar  # type: ignore[import-untyped]

#: Velocity of the motion [rad/s], and its samples, besides the delay, before the one that counts.
_SPEED, _BEFORE = 1.0, 4
#: Sizes of the differences [rad], and how far they may disagree, relative to the largest.
_SIZES, _AGREE = (1e-9, 1e-8), 1e-3
#: Samples of noise of that size that show how far what is remembered moves.
_NOISY = 64
#: Below this, relative to how far that moves, a difference is rounding.
_ROUNDING = 1e-8
#: What is not linear and bounded by Ka: friction as it is known and learned.
_FRICTION = {'friction_level': 0.0, 'friction_learning': 0.0}


class LinearLaw(NamedTuple):
    """A law near a steady motion, (LL1), with m states."""

    #: Shapes (m, m), (m, 2 n), (n, m) and (n, 2 n).
    A: Array
    B: Array
    C: Array
    D: Array


class Frozen(Model):
    """
    A robot with a constant M, without C and G.

    Parameters
    ----------
    mass : array, shape (n, n)
        M [kg·m²].

    """

    def __init__(self, mass: Array) -> None:
        self.n, self._mass = len(mass), mass.tolist()

    def mass_matrix(self, q: Vector) -> Rows:  # noqa: ARG002
        """Return M, shape (n, n)."""
        return list(self._mass)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:  # noqa: ARG002
        """Return 0, shape (n, n)."""
        return [[0.0] * self.n] * self.n

    def gravity_torque(self, q: Vector) -> Vector:  # noqa: ARG002
        """Return 0, shape (n,)."""
        return [0.0] * self.n

    def potential_energy(self, q: Vector) -> float:  # noqa: ARG002
        """Return 0."""
        return 0.0


def linear_law(config: ControllerConfig, mass: Array) -> LinearLaw:
    """
    Return the law of a configuration as a linear system.

    Parameters
    ----------
    config : ControllerConfig
        Law, gains, and what it knows of the drives; effort limits count as none.
    mass : array, shape (n, n)
        M̂ of the controller [kg·m²].

    Raises
    ------
    CtcError
        If the law is not linear near a steady motion.

    """
    free = dict.fromkeys(('effort_limit', 'effort_rate_limit', 'error_limit'), np.inf)
    known = {name: x for name, x in _FRICTION.items() if config.takes(name)}
    config = config.changed({**free, **known, 'inertia_scale': 1.0, 'gravity_scale': 1.0,
                             'compiled': False})
    at = _SteadyMotion(config, mass)
    scale = at.moved()
    small, large = (at.differences(size, scale) for size in _SIZES)
    if not np.abs(small - large).max() <= _AGREE * np.abs(small).max():
        raise CtcError(f'law {config.law}{" " * bool(config.switching_in_force)}'
                       f'{config.switching_in_force} is not linear near a steady motion; its '
                       'stability is not computed')
    return _minimal(small, scale, at.states)


class _SteadyMotion:
    """The control step at a sample of the motion, as a function of what is remembered."""

    def __init__(self, config: ControllerConfig, mass: Array) -> None:
        made = Controller(config, Frozen(mass))
        n, self._delay, self._law = len(mass), config.input_delay, made.law
        h, one = made.settings.period, np.ones(n)
        self._settings, self._models = made.settings, Models(*(made.model,) * 3)
        before = _BEFORE + 2 * self._delay
        for k in range(-before, 0):
            made.step(*self._row(k * h * one, one), [
                self._row((k + j) * h * one, one)[2:] for j in range(1, self._delay + 1)])
        control, of_law, self._last = made.memories
        self._memories = control._replace(transit_index=0.0), of_law
        rolled = np.roll(made.transit, -TRANSIT_ROWS * int(control.transit_index), axis=0)
        self._at = np.concatenate([*_numbers(self._memories), rolled.ravel()])
        self._y = np.concatenate([0.0 * one, _SPEED * one])
        self._points = np.array([x for j in range(self._delay + 1)
                                 for x in self._row(j * h * one, one)[2:]])
        #: Number of what is remembered.
        self.states = len(self._at)

    @staticmethod
    def _row(q: Array, one: Array) -> tuple[Any, Any, Any, Any, Any]:
        """Return q, dq, q_d, dq_d and ddq_d on the motion."""
        dq = _SPEED * one
        return q, dq, q, dq, 0.0 * one

    def _stepped(self, values: Array) -> Array:
        """Return what is remembered a period later, and the torque, for what is now, and y."""
        m, n = self.states, len(self._y) // 2
        rest = values[:m].tolist()
        control, of_law = _record(self._memories, iter(rest))
        transit = values[m - TRANSIT_ROWS * self._delay * n:m].reshape(-1, n).copy()
        context = Context(self._settings, self._models, transit, control, self._points)
        output, (control, of_law, _) = step(
            context, self._law, of_law, self._last, REGULAR, values[m:m + n], values[m + n:])
        after = np.roll(transit, -TRANSIT_ROWS * int(control.transit_index), axis=0).ravel()
        return np.concatenate([
            *_numbers((control._replace(transit_index=0.0), of_law)), after, output.tau])

    def moved(self) -> Array:
        """
        Return how far noise of 1 of q and of 1 / h of dq moves all, shape (m + 2 n,).

        0 for what it does not reach.
        """
        m, n = self.states, len(self._y) // 2
        rng, at = np.random.default_rng(0), np.concatenate([self._at, self._y])
        of_y = np.repeat([1.0, 1.0 / self._settings.period], n)
        before, d, most = self._stepped(at)[:m], np.zeros(m), np.zeros(m)
        for _ in range(_NOISY):
            y = _SIZES[0] * of_y * rng.standard_normal(2 * n)
            d = self._stepped(at + np.concatenate([d, y]))[:m] - before
            most = np.maximum(most, np.abs(d) / _SIZES[0])
        reached = most > _ROUNDING * np.maximum(np.abs(self._at), 1.0)
        return np.concatenate([np.where(reached, most, 0.0), of_y])

    def differences(self, size: float, scale: Array) -> Array:
        """Return the change of all and of τ, shape (m + n, m + 2 n), for changes of 1 `scale`."""
        at = np.concatenate([self._at, self._y])
        found = np.zeros((self.states + len(self._y) // 2, len(at)))
        for k in np.flatnonzero(scale):
            d = np.zeros(len(at))
            d[k] = size * scale[k]
            found[:, k] = (self._stepped(at + d) - self._stepped(at - d)) / (2.0 * size)
        found[:self.states] /= np.where(scale, scale, np.inf)[:self.states, np.newaxis]
        return found


def _numbers(record: Any) -> Iterator[Array]:
    """Yield the numbers of a record and of those in it."""
    for x in record:
        if isinstance(x, tuple):
            yield from _numbers(x)
        else:
            yield np.ravel(x).astype(float)


def _record(like: Any, values: Iterator[float]) -> Any:
    """Return a record with the next `values`."""
    parts = [_record(x, values) if isinstance(x, tuple) else
             np.array([next(values) for _ in range(x.size)]).reshape(x.shape)
             if isinstance(x, np.ndarray) else next(values) for x in like]
    return type(like)(*parts) if hasattr(like, '_fields') else tuple(parts)


def _minimal(found: Array, scale: Array, m: int) -> LinearLaw:
    """Return the part of a system that y reaches and that reaches τ, with y unscaled."""
    largest = np.abs(found).max(axis=1, keepdims=True, initial=1e-300)
    found = np.where(np.abs(found) > _ROUNDING * largest, found, 0.0)
    A, B, C, D = found[:m, :m], found[:m, m:], found[m:, :m], found[m:, m:]
    reaches = (C != 0.0).any(axis=0)
    for _ in range(m):
        reaches = reaches | (A[reaches] != 0.0).any(axis=0)
    kept = reaches & (scale[:m] > 0.0)
    return LinearLaw(A[np.ix_(kept, kept)], B[kept] / scale[m:], C[:, kept], D / scale[m:])


class SampledLoop(NamedTuple):
    """The loop of (XL2): state⁺ = A state + B w, z = C state."""

    #: Shapes (m, m), (m, 2 n) and (2 n, m).
    A: Array
    B: Array
    C: Array

    def closed(self, ratio: float) -> Array:
        """Return the matrix of the loop for M̂ = `ratio` M, shape (m, m)."""
        return self.A + ratio * self.B @ self.C


def sampled_loop(law: LinearLaw, mass: Array, robot: Loops) -> SampledLoop:
    """Return the loop of a law and a robot of n joints with M̂ = `mass`, shape (n, n)."""
    n, h, delay, m = len(mass), robot.period, robot.delay, len(law.A)
    drives = discretize_drives(robot.lag, np.full(n, np.inf), h)
    # State: q, dq, torque of the drives, torques in transit, q a sample ago, memory of the law.
    sizes = [n, n, n, delay * n, n if robot.differenced else 0, m]
    q, dq, torque, transit, last, memory = np.split(
        np.eye(sum(sizes)), np.cumsum(np.array(sizes))[:-1])
    y = np.vstack([q, (q - last) / h if robot.differenced else dq])
    sent = law.C @ memory + law.D @ y
    command = np.vstack([transit, sent])
    gap = torque - command[:n]
    mean = command[:n] + drives.mean[:, np.newaxis] * gap
    rest = command[:n] + drives.weighted[:, np.newaxis] * gap - mean
    values, vectors = np.linalg.eigh(mass)
    root = vectors / np.sqrt(values) @ vectors.T
    B = np.zeros((sum(sizes), 2 * n))
    B[:n, :n] = B[:n, n:] = 0.5 * h * h * root
    B[n:2 * n, :n] = h * root
    scale = np.array([1.0] * n + [_SCALE] * n)
    return SampledLoop(
        np.vstack([q + h * dq, dq, command[:n] + drives.decay[:, np.newaxis] * gap, command[n:],
                   q[:len(last)], law.A @ memory + law.B @ y]),
        B / scale, scale[:, np.newaxis] * np.vstack([root @ mean, root @ rest]))


def one_joint(law: LinearLaw) -> LinearLaw:
    """Return the first joint of a law whose joints are independent and equal."""
    of_y = np.array([0, len(law.D)])
    mine = law.B[:, of_y].any(axis=1)
    for _ in range(len(law.A)):
        mine = mine | law.A[:, mine].any(axis=1)
    return LinearLaw(law.A[mine][:, mine], law.B[mine][:, of_y], law.C[:1, mine],
                     law.D[:1, of_y])


#: Eigenvalues of M̂ M⁻¹ that are looked at, and centres c of (MG1).
_GRID = np.geomspace(0.01, 100.0, 200)
_CENTRES = np.geomspace(0.4, 2.5, 20)
#: s of (XL2): of no weight, as it happens.
_SCALE = 3.0
#: Lags that are looked at: so many, up to so many times lateness; and delays beyond the known one.
_LAGS, _LONGEST, _DELAYS = 200, 20.0, 20
#: Instants of the motion at which M̂ is taken, where the settings of the joints differ.
_INSTANTS = 5
#: What couples the joints of the M̂ with which a law is tried.
_COUPLING = 0.3


class StableRange(NamedTuple):
    """An interval."""

    low: float
    high: float


@dataclasses.dataclass(frozen=True)
class Loops:
    """
    The loops of a law with a robot, one for each M̂ that counts.

    Attributes
    ----------
    laws : sequence of LinearLaw
        With each M̂.
    masses : sequence of array, shape (n, n)
        As many M̂ [kg·m²].
    period : float
        h [s].
    lag : array, shape (n,)
        True T of the drives [s].
    delay : int
        Their true delay in samples.
    differenced : bool
        Whether the velocity is the difference of positions; exact otherwise.

    """

    laws: Sequence[LinearLaw]
    masses: Sequence[Array]
    period: float
    lag: Array
    delay: int
    differenced: bool

    @property
    def joints_are_equal(self) -> bool:
        """Whether one joint stands for all, so that eigenvalues of M̂ M⁻¹ decide."""
        return self.masses[0].shape == (1, 1)

    @cached_property
    def all(self) -> list[SampledLoop]:  # noqa: A003
        """Return the loops."""
        return [sampled_loop(*x, self) for x in zip(self.laws, self.masses)]

    def radius(self, ratio: float = 1.0) -> float:
        """Return the largest absolute value of a pole for M̂ = `ratio` M."""
        return max(float(np.abs(np.linalg.eigvals(x.closed(ratio))).max()) for x in self.all)

    def ratios(self) -> StableRange | None:
        """Return for which eigenvalues of M̂ M⁻¹, around 1, all poles are stable; else None."""
        return stable(self.radius, 1.0, _GRID)

    def guaranteed(self) -> StableRange | None:
        """Return the interval of (MG1) whose nearer end is farthest from 1, by ratio; or None."""

        def interval(c: float) -> StableRange:
            d = min(1.0 / peak_gain(x.closed(c), x.B, x.C) for x in self.all) if (
                self.radius(c) < 1.0) else 0.0
            return StableRange(c - d, c + d)

        def nearer(c: float) -> float:
            """Return the factor from 1 to the nearer end, below 1 if 1 is outside."""
            low, high = interval(c)
            return min(high, 1.0 / max(low, 1e-9))

        best = int(np.argmax([nearer(c) for c in _CENTRES]))
        found = minimize_scalar(lambda c: -nearer(c), bounds=_CENTRES[[
            max(best - 1, 0), min(best + 1, len(_CENTRES) - 1)]], method='bounded',
            options={'xatol': 1e-4})
        return interval(float(found.x)) if found.fun < -1.0 else None

    def lags(self, ratio: float = 1.0) -> StableRange | None:
        """
        Return for which true lags [s] all poles are stable; None if there is none.

        Around that of the robot, or, where that is not stable, the shortest that is.
        """
        def radius(lag: float) -> float:
            return dataclasses.replace(self, lag=np.full_like(self.lag, lag)).radius(ratio)
        own = float(self.lag.max())
        grid = np.linspace(0.0, _LONGEST * (own + self.period * (1 + self.delay)), _LAGS)
        at = next((x for x in (own, *grid.tolist()) if radius(x) < 1.0), own)
        return stable(radius, at, grid)

    def delays(self, ratio: float = 1.0) -> list[int]:
        """Return for which true delays, in samples, all poles are stable."""
        return [d for d in range(self.delay + _DELAYS)
                if dataclasses.replace(self, delay=d).radius(ratio) < 1.0]


def stable(radius: Callable[[float], float], at: float, grid: Array) -> StableRange | None:
    """Return where a radius is below 1 around `at`, to the ends of a grid; None if not there."""
    if not radius(at) < 1.0:
        return None
    ends = []
    for side in (np.flip(grid[grid < at]), grid[grid > at]):
        inside = at
        for x in side.tolist():
            if not radius(x) < 1.0:
                inside = bisect(lambda y: radius(y) - 1.0, inside, x)
                break
            inside = x
        ends.append(inside)
    return StableRange(*ends)


def loops_of(setup: Setup) -> Loops:
    """
    Return the loops of a parameter file.

    Parameters
    ----------
    setup : Setup
        The law and what it knows; lag, delay and sensor of its robot.

    Raises
    ------
    CtcError
        If the law is not linear, or its torque not in proportion to M̂.

    """
    config, plant = setup.controller, setup.plant
    n, lags = len(config.joint_names), np.array(plant.actuator_lag)
    eye = np.eye(n)
    law = linear_law(config, eye)
    equal = _equal(config, lags)
    _check(config, law, eye + _COUPLING if equal else 2.0 * eye)
    if plant.velocity_sensor == 'filtered' and (law.B[:, n:].any() or law.D[:, n:].any()):
        raise CtcError(f'velocity_sensor: filtered is not allowed under law {config.law}, which '
                       'uses the velocity; allowed: exact, difference')
    loops = Loops([law], [eye], seconds(period_ns(config.control_period)), lags,
                  plant.input_delay, plant.velocity_sensor == 'difference')
    if equal:
        return dataclasses.replace(
            loops, laws=[one_joint(law)], masses=[eye[:1, :1]], lag=lags[:1])
    masses = masses_of(setup)
    return dataclasses.replace(
        loops, laws=[linear_law(config, mass) for mass in masses], masses=masses)


def _check(config: ControllerConfig, law: LinearLaw, mass: Array) -> None:
    """Refuse a law whose torque with M̂ = `mass` is not `mass` times that with M̂ = 1."""
    first, other = (x.D + sum(x.C @ np.linalg.matrix_power(x.A, k) @ x.B for k in range(9))
                    for x in (law, linear_law(config, mass)))
    if not np.abs(mass @ first - other).max() <= 1e-3 * np.abs(other).max():
        raise CtcError(f'law {config.law}: its torque is not in proportion to M of the model; its '
                       'stability is not computed')


def _equal(config: ControllerConfig, lags: Array) -> bool:
    """Return whether all joints have the same gains and lags, and no gain couples them."""
    n = len(lags)
    told = config.assumed_lag if config.takes('actuator_lag') else (0.0,)
    gains = [np.array(matrix(x, n)) for x in (config.kp, config.kv)]
    return (all((x == x[0, 0] * np.eye(n)).all() for x in gains)
            and len({*lags.tolist()}) == len({*told}) == 1
            and all(len({*getattr(config, name)}) == 1 for name in ('ki',) if config.takes(name)))


def outside(span: StableRange, assumed: Array, actual: Array) -> float:
    """Return how far the eigenvalues of M̂ M⁻¹ exceed an interval, as a ratio; below 1 inside."""
    ratios = eigh(assumed, actual, eigvals_only=True)
    return float(max(ratios[-1] / span.high, span.low / ratios[0]))


def masses_of(setup: Setup) -> list[Array]:
    """Return M̂ at instants of the motion."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    return [np.array(model.mass_matrix(q)) for q, _, _ in desired_points(
        setup, setup.plant.duration or 1.0, _INSTANTS)]


#: M̂ M⁻¹ for which lags and delays are said.
RATIOS = (1.0, 0.8, 1.25)


class Margins(NamedTuple):
    """
    Margins of a loop.

    Attributes
    ----------
    radius : float
        Largest absolute value of a pole, for M̂ = M.
    ratios, guaranteed : StableRange or None
        Of the eigenvalues of M̂ M⁻¹, constant; varying.
    lags, delays : sequence
        For each of `RATIOS`: true lags [s], true delays in samples.

    """

    radius: float
    ratios: StableRange | None
    guaranteed: StableRange | None
    lags: tuple[StableRange | None, ...]
    delays: tuple[tuple[int, ...], ...]


def stability(setup: Setup) -> Margins:
    """
    Return which errors of model, lag and delay the sampled loop stands.

    Of the loop with constant M, without limits: the poles for errors that are constant, the
    small-gain theorem for those that vary (docs/theory.md).

    Parameters
    ----------
    setup : Setup
        The law and what it knows; lag, delay and sensor of its robot.

    Returns
    -------
    Margins
        Stable if ``radius`` is below 1; ``ratios``, ``lags`` and ``delays`` say how far it is.

    Raises
    ------
    CtcError
        If the law is not linear, or its torque not in proportion to M of the model.

    Examples
    --------
    >>> from ctc_chattering import load_parameters, stability
    >>> found = stability(load_parameters('friction', {'controller': {'law': 'compensation'}}))
    >>> found.radius < 1.0, f'{found.ratios.low:.2f} to {found.ratios.high:.0f}'
    (True, '0.01 to 40')

    """
    loops = loops_of(setup)
    return Margins(
        loops.radius(), loops.ratios(), loops.guaranteed(), tuple(map(loops.lags, RATIOS)),
        tuple(tuple(loops.delays(x)) for x in RATIOS))


def rows(found: Margins, period: float) -> Iterator[tuple[str, str]]:
    """Yield rows of a table, intervals rounded inwards; `period` is h [s]."""
    if found.radius < 1.0:
        slowest = -1e3 * period / math.log(found.radius)
        yield 'slowest time constant, model exact', f'{_digits(slowest, up=True)} ms'
    else:
        yield 'model exact', f'unstable: a pole at {found.radius:.3g}'
    yield 'M of the model / M of the robot, constant', span_text(found.ratios)
    yield 'the same, varying (guaranteed)', span_text(found.guaranteed)
    for ratio, lags, delays in zip(RATIOS, found.lags, found.delays):
        at = '' if ratio == 1.0 else f', model {ratio:g} M'
        yield f'lag of the drives{at}', span_text(lags, 1e3, ' ms')
        yield f'delay{at}', f'{_counts(delays)} samples' if delays else 'none'


def span_text(found: StableRange | None, factor: float = 1.0, unit: str = '') -> str:
    """Return an interval, rounded inwards."""
    if found is None:
        return 'none'
    low, high = (_digits(factor * x, up) for x, up in zip(found, (True, False)))
    return f'{low} to {high}{unit}'


def _counts(found: Sequence[int]) -> str:
    """Return ascending numbers, as a range if none is left out."""
    if len(found) > 1 and found[-1] - found[0] == len(found) - 1:
        return f'{found[0]} to {found[-1]}'
    return ', '.join(map(str, found))


def _digits(x: float, up: bool) -> str:
    """Return a number to two digits, rounded up or down."""
    if not 0.0 < x < math.inf:
        return f'{x:g}'
    step = 10.0 ** (math.floor(math.log10(x)) - 1)
    return f'{rounded((math.ceil if up else math.floor)(x / step) * step, 2):g}'
