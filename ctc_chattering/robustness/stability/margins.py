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
What errors of model, lag and delay the loop of a parameter file stands.

The robot is linear: M is constant, C = G = 0, no torque is at its limit, and what is estimated is
within ±Ka. Friction, its compensation, and errors of C and G that are bounded are inputs. With the
loop of `sampled_loop` and X = M̂^½ M⁻¹ M̂^½::

    X constant:    exponentially stable if and only if all poles of the loop are within the unit
                   circle; with equal settings of all joints those of one joint, for each
                   eigenvalue of X
    X(k) varying:  exponentially stable if, for one c,  ‖X(k) - c‖ ‖G_c‖∞ < 1 at all k      (MG1)

G_c is the loop with X = c, from w to z; the second line is the small-gain theorem. For symmetric X
it says that all eigenvalues of M̂ M⁻¹ stay between c ± 1 / ‖G_c‖∞.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import dataclasses
from functools import cached_property
from typing import NamedTuple

from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.peak_gain import peak_gain
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import matrix
from ctc_chattering.robustness.stability.linear_law import linear_law, LinearLaw
from ctc_chattering.robustness.stability.sampled_loop import (
    LinearRobot,
    one_joint,
    sampled_loop,
    SampledLoop,
)
from ctc_chattering.studies.recommended import desired_points
import numpy as np
from scipy.optimize import minimize_scalar  # type: ignore[import-untyped]

#: Eigenvalues of M̂ M⁻¹ that are looked at, and centres c of (MG1).
RATIOS = np.geomspace(0.01, 100.0, 200)
_CENTRES = np.geomspace(0.4, 2.5, 20)
#: s of (XL2): of no weight, as it happens.
_SCALE = 3.0
#: Lags that are looked at: so many, up to so many times lateness; and delays beyond the known one.
_LAGS, _LONGEST, _DELAYS = 200, 20.0, 20
#: Instants of the motion at which M̂ is taken, where the settings of the joints differ.
_INSTANTS = 5
#: What couples the joints of the M̂ with which a law is tried.
_COUPLING = 0.3
#: Steps of a bisection.
_HALVINGS = 40
#: Most samples of a response that are summed.
_LONG = 200_000


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
    robots : sequence of LinearRobot
        As many; lag and delay are the true ones.

    """

    laws: Sequence[LinearLaw]
    robots: Sequence[LinearRobot]

    def with_drives(self, lag: float | None = None, delay: int | None = None) -> Loops:
        """Return the loops with another true lag [s] of all drives, or delay in samples."""
        return Loops(self.laws, [x._replace(
            lag=x.lag if lag is None else np.full_like(x.lag, lag),
            delay=x.delay if delay is None else delay) for x in self.robots])

    @cached_property
    def all(self) -> list[SampledLoop]:  # noqa: A003
        """Return the loops."""
        return [sampled_loop(*x) for x in zip(self.laws, self.robots)]

    def radius(self, ratio: float = 1.0) -> float:
        """Return the largest absolute value of a pole for M̂ = `ratio` M."""
        return max(x.radius(ratio) for x in self.all)

    def ratios(self) -> StableRange | None:
        """Return for which eigenvalues of M̂ M⁻¹, around 1, all poles are stable; else None."""
        return stable(self.radius, 1.0, RATIOS)

    def guaranteed(self) -> StableRange | None:
        """Return the interval of (MG1) whose nearer end is farthest from 1, by ratio; or None."""
        loops = [x.scaled(_SCALE) for x in self.all]

        def interval(c: float) -> StableRange:
            d = min(1.0 / peak_gain(x.closed(c), x.B, x.C) for x in loops) if (
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
            return self.with_drives(lag=lag).radius(ratio)
        late = max(x.lag.max() + x.period * (1 + x.delay) for x in self.robots)
        grid = np.linspace(0.0, _LONGEST * late, _LAGS)
        own = float(self.robots[0].lag.max())
        at = next((x for x in (own, *grid.tolist()) if radius(x) < 1.0), own)
        return stable(radius, at, grid)

    def delays(self, ratio: float = 1.0) -> list[int]:
        """Return for which true delays, in samples, all poles are stable."""
        return [d for d in range(self.robots[0].delay + _DELAYS)
                if self.with_drives(delay=d).radius(ratio) < 1.0]

    def error_gain(self, ratio: float = 1.0) -> float:
        """
        Return the largest |e_i| for |M⁻¹ P|_i <= 1 rad/s², M̂ = `ratio` M [s²]; inf if unstable.

        For equal settings of all joints. P is any bounded torque, friction for example: the sum
        of the absolute values of the response to impulses of its two means over a period.
        """
        (loop,), (robot,) = self.all, self.robots
        if loop.radius(ratio) >= 1.0:
            return np.inf
        A, h, total = loop.closed(ratio), robot.period, 0.0
        x = np.zeros((len(A), 2))
        x[0, 0], x[1, 1] = 0.5 * h * h, h
        for _ in range(_LONG):
            total += np.abs(x[0]).sum()
            x = A @ x
            if np.abs(x[0]).sum() < 1e-12 * total:
                break
        return total


def stable(radius: Callable[[float], float], at: float, grid: Array) -> StableRange | None:
    """Return where a radius is below 1 around `at`, to the ends of a grid; None if not there."""
    if not radius(at) < 1.0:
        return None
    ends = []
    for side in (np.flip(grid[grid < at]), grid[grid > at]):
        inside = at
        for x in side.tolist():
            if not radius(x) < 1.0:
                outside = x
                for _ in range(_HALVINGS):
                    middle = 0.5 * (inside + outside)
                    if radius(middle) < 1.0:
                        inside = middle
                    else:
                        outside = middle
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
    robot = LinearRobot(
        seconds(period_ns(config.control_period)), eye, lags,
        plant.input_delay, plant.velocity_sensor == 'difference')
    if equal:
        return Loops([one_joint(law)], [robot._replace(mass=eye[:1, :1], lag=lags[:1])])
    masses = _masses(setup)
    return Loops([linear_law(config, mass) for mass in masses],
                 [robot._replace(mass=mass) for mass in masses])


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


def _masses(setup: Setup) -> list[Array]:
    """Return M̂ at instants of the motion."""
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    return [np.array(model.mass_matrix(q)) for q, _, _ in desired_points(
        setup, setup.plant.duration or 1.0, _INSTANTS)]
