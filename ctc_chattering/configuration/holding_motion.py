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
Search for a motion that an arm can hold.

`ctc new-robot` takes it for a new parameter file. It is about the middle of the limits if the
joints can hold that. Otherwise postures are found by steps of one joint at a time, from the middle
and then from random postures. The same robot always gets the same motion.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import chain
from math import floor, inf, pi, sqrt
from typing import NamedTuple

from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.trajectory.joint_limits import JointLimits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
import numpy as np

#: Fraction of the limits of position, velocity and acceleration that a motion takes.
SHARE = 0.5
#: Fraction of the effort limits that a motion takes. The law has the remainder.
EFFORT_SHARE = 0.9
#: Largest amplitude [rad or m].
_MAX_AMPLITUDE = 0.5
#: Largest frequency [Hz].
_MAX_FREQUENCY = 0.5
#: Steps of frequencies, coarse ones first [Hz]. Multiples have a common period of up to 40 s,
#: so that the motion can be learned. A lower frequency keeps its value.
_FREQUENCY_STEPS = (0.05, 0.025)
#: Share of a step by which a frequency may fall short of it by rounding.
_STEP_ROUNDING = 1e-9
#: Factors of amplitude and frequency that are tried where joints cannot hold the full motion.
_REDUCTIONS = (0.5, 0.25)
#: Fraction of the effort limits at which the weight of a posture is small enough.
_LIGHT = 0.5
#: First step of a joint to another posture [rad or m].
_FIRST_STEP = 0.5
#: Last step of a joint to another posture [rad or m].
_LAST_STEP = 0.02
#: Random postures that are tried.
_DRAWS = 20
#: Largest distance that a posture keeps to the limits [rad or m].
_MAX_ROOM = 1.0
#: Largest distance that a posture keeps to the limits over their range.
_ROOM_SHARE = 0.25
#: Range of positions of a joint that has no limit [rad or m].
_RANGE = 2.0 * pi
#: Duration of a motion [s].
DURATION_S = 10.0
#: Duration of its smooth start [s].
START_S = 2.0
#: Time between the instants at which the torque is evaluated.
_STEP_NS = NANOSECONDS // 20
#: Significant digits of positions.
_DIGITS_OF_POSITION = 6


class HeldArm(NamedTuple):
    """An arm of n joints with friction."""

    limits: Sequence[JointLimits]
    model: Model
    #: Coulomb friction, shape (n,) [N·m or N].
    coulomb: Array
    #: Viscous friction, shape (n,) [N·m·s/rad or N·s/m].
    viscous: Array


class Load(NamedTuple):
    """Largest effort of a joint in a motion [N·m or N]."""

    joint: JointLimits
    torque: float
    #: Torque for the weight at the centre of the motion.
    weight: float
    #: Effort limit.
    limit: float

    def __str__(self) -> str:
        """Return the torque and the limit with their unit."""
        unit = 'N' if self.joint.unit == 'm' else 'N·m'
        return f'{self.torque:.3g} of {self.limit:g} {unit} ({self.weight:.3g} for the weight)'

    @property
    def share(self) -> float:
        """Fraction of the limit."""
        return self.torque / self.limit


class HoldingMotion(NamedTuple):
    """A sinusoid, and the joint that it loads most."""

    center: list[float]
    amplitude: list[float]
    frequency: list[float]
    #: Factor of the usual amplitudes and frequencies.
    size: float
    load: Load
    #: Load of the motion about the middle of the limits, if that is another and too large.
    about_middle: Load | None = None


def choose_motion(arm: HeldArm, center: Sequence[float] = ()) -> HoldingMotion:
    """
    Return a motion that every joint holds with a margin.

    Parameters
    ----------
    arm : HeldArm
        The arm.
    center : sequence of float
        Centre of the motion [rad or m]. Empty to choose it.

    Raises
    ------
    CtcError
        If a joint can hold none, or the centre is not within the limits.

    """
    motions = []
    for motion in _candidates(arm, center):
        motions.append(motion)
        if motion.load.share <= EFFORT_SHARE:
            first = motions[0]
            if motion.center != first.center:
                motion = motion._replace(about_middle=first.load)
            return motion
    lightest = min((motion.load for motion in motions), key=lambda load: load.share)
    scope = 'about --center' if len(center) else 'that was tried'
    raise CtcError(
        f'{lightest.joint.name}: the lightest motion {scope} needs {lightest}, but at most '
        f'{EFFORT_SHARE:.0%} of <limit effort> is allowed; correct the URDF, or choose other '
        '--joints, another --tip or another --center')


def middle_position(joint: JointLimits) -> float:
    """Return the middle of a joint's limits, or about 0."""
    low, high = joint.position
    if -inf < low < high < inf:
        return 0.5 * (low + high)
    return float(np.clip(0.0, *_posture_range(joint)))


def largest_speeds(limits: Sequence[JointLimits]) -> Array:
    """Return bounds of the speeds, shape (n,) [rad/s or m/s]."""
    usual = 2.0 * pi * _MAX_FREQUENCY * _MAX_AMPLITUDE
    return np.array([min(usual, SHARE * joint.velocity[1]) for joint in limits])


def _candidates(arm: HeldArm, center: Sequence[float]) -> Iterator[HoldingMotion]:
    """Yield motions: large ones first, about the middle first."""
    if len(center):
        _check_center(center, arm.limits)
        postures: Iterable[Array] = [np.array(center, float)]
    else:
        middle = np.array([middle_position(joint) for joint in arm.limits])
        postures = (
            np.array([round_number(x, _DIGITS_OF_POSITION) for x in posture])
            for posture in chain([middle], _light_postures(arm, middle)))
    tried = []
    for posture in postures:
        tried.append(posture)
        yield _make_motion(arm, posture, 1.0)
    for size in _REDUCTIONS:
        for posture in tried:
            yield _make_motion(arm, posture, size)


def _check_center(center: Sequence[float], limits: Sequence[JointLimits]) -> None:
    """Raise `ParameterError` unless a centre is within the limits."""
    if len(center) != len(limits):
        raise ParameterError('center', tuple(center), f'{len(limits)} positions, one per joint')
    for value, joint in zip(center, limits):
        low, high = joint.position
        if not low < value < high:
            raise ParameterError('center', value, f'above {low:g} and below {high:g} '
                                 f'{joint.unit}, the limits of {joint.name}')


def _make_motion(arm: HeldArm, center: Array, size: float) -> HoldingMotion:
    """Return a motion with its load, friction included."""
    positions = center.tolist()
    amplitudes = [_amplitude(joint, x, size) for joint, x in zip(arm.limits, positions)]
    frequencies = [_repeatable(size * _frequency(joint, amplitude))
                   for joint, amplitude in zip(arm.limits, amplitudes)]
    names = [joint.name for joint in arm.limits]
    reference = ReferenceConfig.from_mapping({
        'joint_names': names, 'model': 'urdf', 'center': positions, 'amplitude': amplitudes,
        'frequency': frequencies, 'start_duration': START_S})
    start = {name: (x, 0.0) for name, x in zip(names, positions)}
    desired = make_motion(reference, None, start)
    instants = range(0, round(DURATION_S * NANOSECONDS), _STEP_NS)
    points = [desired.at(t) for t in instants]
    torques = np.abs([arm.model.inverse_dynamics(*point) for point in points])
    speeds = np.abs([dq for _, dq, _ in points])
    peaks = (torques + arm.coulomb + arm.viscous * speeds).max(axis=0)
    efforts = arm.model.effort_limits
    worst = int((peaks / np.array(efforts)).argmax())
    weight = abs(arm.model.gravity_torque(positions)[worst])
    load = Load(arm.limits[worst], float(peaks[worst]), weight, efforts[worst])
    return HoldingMotion(positions, amplitudes, frequencies, size, load)


def _amplitude(joint: JointLimits, center: float, size: float) -> float:
    """Return the amplitude of a joint's motion [rad or m]."""
    low, high = joint.position
    room = max(0.0, min(center - low, high - center))
    return round_number(size * min(_MAX_AMPLITUDE, SHARE * room))


def _frequency(joint: JointLimits, amplitude: float) -> float:
    """Return the frequency of a joint's motion [Hz]."""
    if amplitude == 0.0:
        return _MAX_FREQUENCY
    by_velocity = SHARE * joint.velocity[1] / amplitude
    by_acceleration = sqrt(SHARE * joint.acceleration[1] / amplitude)
    return min(_MAX_FREQUENCY, by_velocity / (2.0 * pi), by_acceleration / (2.0 * pi))


def _repeatable(frequency: float) -> float:
    """Return the highest frequency on a step that is at most this one [Hz]."""
    for step in _FREQUENCY_STEPS:
        if frequency >= step:
            return round_number(step * floor(frequency / step + _STEP_ROUNDING))
    return round_number(frequency)


def _light_postures(arm: HeldArm, middle: Array) -> Iterator[Array]:
    """Yield light postures, near the middle first."""
    low, high = np.transpose([_posture_range(joint) for joint in arm.limits])
    draws = np.random.default_rng(0).uniform(low, high, (_DRAWS, len(low)))
    for start in (middle, *draws):
        yield _find_light_posture(arm.model, start, low, high)


def _posture_range(joint: JointLimits) -> tuple[float, float]:
    """Return the range of a joint's postures [rad or m]."""
    low, high = joint.position
    room = min(_MAX_ROOM, _ROOM_SHARE * (high - low))
    low = low + room
    high = high - room
    if low == -inf and high == inf:
        return -0.5 * _RANGE, 0.5 * _RANGE
    if low == -inf:
        return high - _RANGE, high
    return low, low + _RANGE if high == inf else high


def _find_light_posture(model: Model, start: Array, low: Array, high: Array) -> Array:
    """Return a posture near `start` that weighs less."""
    posture = start
    share = _weight_share(model, start)
    step = _FIRST_STEP
    axes = np.eye(len(low))
    moves = np.concatenate((axes, -axes))
    while step >= _LAST_STEP and share > _LIGHT:
        candidates = np.clip(posture + step * moves, low, high)
        shares = [_weight_share(model, candidate) for candidate in candidates]
        lightest = int(np.argmin(shares))
        if shares[lightest] < share:
            posture = candidates[lightest]
            share = shares[lightest]
        else:
            step *= 0.5
    return posture


def _weight_share(model: Model, q: Array) -> float:
    """Return the weight over the effort limits, at most."""
    weights = np.abs(model.gravity_torque(q.tolist()))
    return float((weights / np.array(model.effort_limits)).max())
