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

"""Columns that effects would have which the regression lacks: on what a torque then depends."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ctc_chattering.identification.regression.least_squares import Data, Fit
from ctc_chattering.identification.regression.weak_form import HALF
from ctc_chattering.identification.regression.window_states import BUILD_UP, WindowStates
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
from scipy.special import gamma, jv  # type: ignore[import-untyped]

#: On what friction depends that drifts.
TIME = 'time'
#: Fewest and most periods in a turn of the joint that are looked for.
_LEAST, _PERIODS = 3.0, 500.0
#: Distance of positions that count as one [rad].
_SPACING = 2.0 * np.pi / 2048.0
#: Part of an amplitude that must be left by the window, and fewest windows which have that.
_LEFT, _WINDOWS = 0.1, 40
#: Transform of the test function of `weak_form.py`.
_PHASES = np.linspace(1e-3, 25.0, 2000)
_AMPLITUDES = gamma(5.5) * (2.0 / _PHASES) ** 4.5 * jv(4.5, _PHASES)


class FittedMotion(NamedTuple):
    """
    A fit and the motion that it is of; J windows, n joints.

    Attributes
    ----------
    data, fit
        Windows, and the regression.
    base, weight : ndarray, shape (J, n)
        Torque of the model, and its weight [N·m].
    states : WindowStates
        Motion in the windows.

    """

    data: Data
    fit: Fit
    base: Array
    weight: Array
    states: WindowStates


class Guess(NamedTuple):
    """
    Columns that a physical effect would have.

    Attributes
    ----------
    against : str
        What the torque then depends on.
    points_to : str
        The effect.
    cure : str
        What to record or to give.
    columns : ndarray, shape (K, p)
        In the windows in which the joint slides.
    variable : ndarray, shape (K,)
        What a figure shows the torque against.
    unit : str
        Of that.

    """

    against: str
    points_to: str
    cure: str
    columns: Array
    variable: Array
    unit: str


def causes(found: FittedMotion, i: int) -> Iterator[Guess]:
    """Yield what the torque of joint i may depend on besides the model."""
    data, states, used = found.data, found.states, found.data.way[:, i] != 0.0
    way, t, q = data.way[used, i], data.t[used], states.position[used, i]
    speed, load = np.abs(data.velocity[used, i]), np.abs(found.base[used, i])
    turn = np.column_stack((np.sin(q), np.cos(q), np.sin(2.0 * q), np.cos(2.0 * q), q, q * q))
    yield Guess('position', 'a weight, spring, cable or cogging that the model lacks',
                'correct the model', turn, q, 'rad')
    yield Guess('position and direction', 'friction that depends on the position',
                'record the positions that you will use', turn * way[:, None], q, 'rad')
    yield Guess('speed', 'a law of friction that is not Coulomb, viscous and Stribeck',
                'record the speeds that you will use', _kinks(speed) * way[:, None],
                way * speed, 'rad/s')
    yield Guess('acceleration', 'an inertia of rotor or link that the model lacks, or a lag of '
                'the drive', 'correct the inertia in the model',
                np.column_stack((states.acceleration[used, i],
                                 (found.base - found.weight)[used, i])),
                states.acceleration[used, i], 'rad/s²')
    yield Guess('the way since a reversal', 'backlash, an elastic joint, or friction that builds '
                f'up over a way (looked for up to {BUILD_UP[-1]:g} rad)',
                'reduce the backlash, or measure behind the elasticity', states.build_up[used, i],
                states.way[used, i], 'rad')
    late = (t - t.min()) / max(float(np.ptp(t)), 1e-9)
    thirds = np.eye(3)[np.minimum((3.0 * late).astype(int), 2)]
    yield Guess(TIME, 'friction that drifts, with temperature say',
                'warm the robot up, and record a shorter run',
                np.column_stack((thirds, thirds * way[:, None])), t, 's')
    yield Guess('the load', 'friction that depends on the load',
                'record the load that you will have',
                np.column_stack((way * load, way * load * speed)), load, 'N·m')
    others = [k for k in range(data.way.shape[1]) if k != i]
    if others:
        torque = (found.base + data.residual)[used][:, others]
        largest = int(np.argmax(np.square(torque).sum(axis=0)))
        yield Guess('the torques of other joints', 'coupled joints, or sensors of torque that '
                    'mix axes', 'check --joints and the calibration of the torques',
                    np.column_stack((torque, states.acceleration[used][:, others])),
                    torque[:, largest], 'N·m')


def _kinks(speed: Array) -> Array:
    """Return columns that are 0 up to a speed and linear above it."""
    knots = np.quantile(speed, (0.1, 0.25, 0.5, 0.75))
    return np.column_stack([np.maximum(speed - knot, 0.0) for knot in knots])


def periodic(found: FittedMotion, i: int, residual: Array) -> tuple[Guess | None, int]:
    """
    Return the periodic torque that explains most of a residual, and how many were looked for.

    Parameters
    ----------
    found, i
        Fit with its motion, and the joint.
    residual : ndarray, shape (K,)
        In the windows in which the joint slides [N·m].

    """
    data, used = found.data, found.data.way[:, i] != 0.0
    q, way = found.states.position[used, i], data.way[used, i]
    speed = np.abs(data.velocity[used, i])
    place = ((q - q.min()) / _SPACING).astype(int)
    size = 1 << (int(place.max(initial=0)) + 1).bit_length() + 2
    orders = 2.0 * np.pi / (_SPACING * size) * np.arange(size // 2 + 1)
    best, most, low = 0.0, 0.0, _LEAST
    while low < _PERIODS:
        # A window leaves more of a wave the slower the joint is.
        part = _left(1.5 * low, speed)
        if (part > _LEFT).sum() < _WINDOWS:
            break
        inside = (orders >= low) & (orders < 2.0 * low)
        power = sum(np.square(np.abs(np.fft.rfft(np.bincount(place, x, size), size)))[inside]
                    for x in (part * residual, part * way * residual)) / part.dot(part)
        if power.max(initial=0.0) > most:
            best, most = float(orders[inside][np.argmax(power)]), float(power.max())
        low *= 2.0
    tried = int(low * np.ptp(q) / np.pi) + 1
    return Guess('the angle of the joint, periodically', f'ripple of motor or gear with about '
                 f'{best:.3g} periods in a turn', 'compensate the ripple',
                 _waves(best, q, speed, way), q, 'rad') if best else None, tried


def _left(order: float, speed: Array) -> Array:
    """Return the part of a wave's amplitude that a window leaves."""
    return np.asarray(np.interp(order * speed * HALF, _PHASES, _AMPLITUDES), float)


def _waves(order: float, q: Array, speed: Array, way: Array) -> Array:
    """Return the mean of sine and cosine of an order over windows, and those by direction."""
    waves = _left(order, speed)[:, None] * np.column_stack((np.sin(order * q), np.cos(order * q)))
    return np.column_stack((waves, waves * way[:, None]))
