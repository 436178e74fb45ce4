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

"""From recordings to timing, friction, errors of the model, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.analysis.recording import Recording, Stretch, stretches
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.regression.causes import causes
from ctc_chattering.identification.regression.delay_and_lag import Profile, Timing, timing
from ctc_chattering.identification.regression.effort_side import placed_unevenly, torque_sides
from ctc_chattering.identification.regression.error_columns import ErrorColumns
from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.estimated_bodies import judged
from ctc_chattering.identification.regression.finding import Finding
from ctc_chattering.identification.regression.held_out import left_over
from ctc_chattering.identification.regression.intervals import correlation_length
from ctc_chattering.identification.regression.joint_friction import joint_friction, JointFriction
from ctc_chattering.identification.regression.least_squares import Data
from ctc_chattering.identification.regression.model_errors import ModelError
from ctc_chattering.identification.regression.model_verdict import ModelVerdict, physical, tilted
from ctc_chattering.identification.regression.physical_causes import FittedMotion
from ctc_chattering.identification.regression.physical_consistency import ConsistentBodies
from ctc_chattering.identification.regression.residual_tests import (
    findings,
    Unexplained,
    unexplained,
    widened,
)
from ctc_chattering.identification.regression.rows import Rows
from ctc_chattering.identification.regression.selection import select, Selected
from ctc_chattering.identification.regression.sensor_noise import (
    Clock,
    clock,
    encoder_step,
    stamp_findings,
    velocity_noise,
)
from ctc_chattering.identification.regression.short_windows import ShortWindows
from ctc_chattering.identification.regression.timing_findings import (
    rate_limits,
    timing_findings,
)
from ctc_chattering.identification.regression.torque import COMMAND, EFFORT, has
from ctc_chattering.identification.regression.weak_form import TestFunction
from ctc_chattering.identification.regression.window_states import WindowStates
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

__all__ = ('Identification', 'JointFriction', 'identify')

#: How much better the effort must explain the motion than the commands to be preferred.
_BETTER = 0.5
#: Part that the weight or the inertial torque may be off by without being named.
_LEFT = 0.01
#: Part of a period by which rounding it may move the last sample.
_ROUNDED = 0.1
#: Shortest recording that is used [s].
_SHORTEST = 2.0


@dataclasses.dataclass(frozen=True)
class Identification:
    """
    All that is identified; J windows, n joints.

    Attributes
    ----------
    joints : tuple of str, length n
        Names.
    clock : Clock
        Stamps of the first recording.
    encoder, noise, velocity_lag : list of Estimate, length n
        Step of the encoder, noise of the measured velocity, and its lag.
    timing : Timing
        Delay and lag of the torque.
    friction : list of JointFriction, length n
    errors : list of (ModelError, Estimate)
        Errors of the model: those that are clear, and those that cannot be told.
    left : list of str
        What else of the torque goes with weight or acceleration, in words.
    data : Data
        The windows.
    selected : Selected
        The regression.
    base, weight : ndarray, shape (J, n)
        Torque of the model, and its weight [N·m].
    duration : float
        Of all stretches [s].
    findings : tuple of Finding
        What makes numbers doubtful.
    scale : list of Estimate, length n
        Torque at the joint per torque of the signal.
    rotor : list of Estimate, length n
        Inertia of the rotors at the joint that the model lacks [kg·m²].
    tilt : tuple of Estimate, length 3
        Gravity in the frame of the base [m/s²].
    bodies : ConsistentBodies or None
        Inertial parameters that the moved bodies can have, nearest to the data.
    rate : list of Estimate, length n
        Rate limit of each drive [N·m/s].
    side : {'', 'motor', 'link', 'current'}
        What the effort is.
    columns : ErrorColumns or None
        Errors of the model that the regression has; `selected.mixing` is about these.
    unexplained : tuple of (Unexplained or None), length n
        What the residuals depend on.
    short : ShortWindows or None
        P in short windows.
    held_out : ndarray, shape (n,)
        What the corrected bodies leave of each joint's torque on windows that they were not
        fitted to, over what the model leaves; empty where the bodies are those of the model.

    """

    joints: tuple[str, ...]
    clock: Clock
    encoder: list[Estimate]
    noise: list[Estimate]
    velocity_lag: list[Estimate]
    timing: Timing
    friction: list[JointFriction]
    errors: list[tuple[ModelError, Estimate]]
    left: list[str]
    data: Data
    selected: Selected
    base: Array
    weight: Array
    duration: float
    findings: tuple[Finding, ...] = ()
    scale: list[Estimate] = dataclasses.field(default_factory=list)
    rotor: list[Estimate] = dataclasses.field(default_factory=list)
    tilt: tuple[Estimate, ...] = ()
    bodies: ConsistentBodies | None = None
    rate: list[Estimate] = dataclasses.field(default_factory=list)
    side: str = ''
    columns: ErrorColumns | None = None
    unexplained: tuple[Unexplained | None, ...] = ()
    short: ShortWindows | None = None
    held_out: Array = dataclasses.field(default_factory=lambda: np.zeros(0))

    def windows(self, parts: Sequence[Stretch], model: Model) -> tuple[Data, Array]:
        """Return the windows of other stretches, and the model's torque there, shape (J, n)."""
        phi = TestFunction(self.clock.period, self.clock.period * sum(len(x.q) for x in parts))
        rows = [Rows.of(part, model, phi, self.columns) for part in parts]
        data = Profile(parts, rows, self.timing.source, phi).windows(self.timing)
        return (data.loaded(self.selected.levels).mixed(self.selected.mixing),
                np.concatenate([part.base for part in rows]))


def identify(recordings: Sequence[Recording], model: Model, candidates: Sequence[ModelError],
             source: str = '', side: str = '') -> Identification:
    """
    Identify a robot from recordings of its motion.

    Parameters
    ----------
    recordings : sequence of Recording
        Checked, with the same joints and about the same period.
    model : Model
        To be corrected.
    candidates : sequence of ModelError
        Errors of it that are looked for.
    source : {'', 'command', 'effort'}
        Where torques are taken from; empty for the one that explains the motion better.
    side : {'', 'motor', 'link', 'current'}
        What the effort is; empty for what it looks like.

    Raises
    ------
    CtcError
        If the recordings do not belong together, are too short, or no joint moves.

    """
    parts, phi = _parts(recordings)
    columns = ErrorColumns.of(model)
    joints = recordings[0].joints
    rows = _rows(parts, model, phi, columns, recordings[0].name)
    sides = torque_sides(parts, rows, phi, joints, side, source)
    parts = placed_unevenly(parts)
    parts, rows, found = _timed(parts, rows, phi, sides.source, recordings[0].name)

    def selected_with(rows: list[Rows], columns: ErrorColumns | None) -> tuple[Data, Selected]:
        data = Profile(parts, rows, found.source, phi).windows(found)
        size = np.sqrt(np.square(data.torque).mean(axis=0))
        return data, select(data, joints, columns, causes(columns, len(joints), candidates, size))

    data, selected = selected_with(rows, columns)
    gravity = tilted(selected, columns)
    if gravity is not None:
        # Errors of masses under a tilted gravity: their product is in the columns about it.
        columns = ErrorColumns.of(model, gravity)
        rows = [Rows.of(part, model, phi, columns) for part in parts]
        data, selected = selected_with(rows, columns)
    noise, lag, velocities = velocity_noise(recordings[0], phi.period)
    base, weight = (np.concatenate([getattr(part, name) for part in rows])
                    for name in ('base', 'gravity'))
    friction = [joint_friction(selected, i) for i in range(len(joints))]
    whole = data.loaded(selected.levels)
    data = whole.mixed(selected.mixing)
    named = ModelVerdict(selected, columns, candidates, joints)
    bodies, impossible = judged(
        named.bodies(), joints, [abs(x.coulomb.value or 0.0) for x in friction])
    held_out = np.zeros(0)
    if bodies is not None and bodies.differ and columns is not None:
        held_out = left_over(whole, selected.friction, columns, selected.scales)
    noticed = (*stamp_findings(recordings), *velocities,
               *timing_findings(found, joints, parts[0].late),
               *sides.findings, *named.findings(), *physical(friction, joints),
               *impossible)
    return _tested(Identification(
        joints, dataclasses.replace(clock(recordings[0]), period=phi.period),
        [encoder_step(x) for x in recordings[0].q.T], noise, lag,
        found, friction, named.errors(), _left(selected, base, weight, data, joints), data,
        selected, base, weight, phi.period * sum(len(part.q) for part in parts), noticed,
        scale=named.scale(), rotor=named.rotor(), tilt=named.gravity(), bodies=bodies,
        rate=rate_limits(found, joints), side=sides.side, columns=columns,
        short=ShortWindows.of(parts, rows, model, found), held_out=held_out),
        WindowStates.of(parts, rows, phi))


def _parts(recordings: Sequence[Recording]) -> tuple[list[Stretch], TestFunction]:
    """Return the stretches without a gap; raise `CtcError` if they are too short."""
    period = _common_period(recordings)
    parts = [part for recording in recordings for part in stretches(recording, period)
             if len(part.q) * period > 1.0]
    duration = period * sum(len(part.q) for part in parts)
    if duration < _SHORTEST:
        raise CtcError(f'{recordings[0].name}: {duration:.2g} s without a gap; at least '
                       f'{_SHORTEST:g} s are needed')
    return parts, TestFunction(period, duration)


def _rows(parts: Sequence[Stretch], model: Model, phi: TestFunction, columns: ErrorColumns | None,
          name: str) -> list[Rows]:
    """Return the rows of each stretch; raise `CtcError` if no joint moves."""
    rows = [Rows.of(part, model, phi, columns) for part in parts]
    if not any((part.way != 0.0).sum() for part in rows):
        raise CtcError(f'{name}: no joint moves for longer than '
                       f'{2 * phi.half * phi.period:g} s in one direction')
    return rows


def _tested(found: Identification, states: WindowStates) -> Identification:
    """Return an identification with what its residuals show, and intervals that have it."""
    motion = FittedMotion(found.data, found.selected.fit, found.base, found.weight, states)
    left = [unexplained(motion, i) for i in range(len(found.joints))]
    return dataclasses.replace(
        found, unexplained=tuple(left), findings=(*found.findings, *(
            x for i, what in enumerate(left) if what for x in findings(i, what))),
        friction=[widened(motion, i, x, what) if what else x
                  for i, (x, what) in enumerate(zip(found.friction, left))])


def _common_period(recordings: Sequence[Recording]) -> float:
    """Return the period of recordings; raise `CtcError` if they do not belong together."""
    first = recordings[0]
    for other in recordings[1:]:
        if other.joints != first.joints:
            raise CtcError(f'{other.name}: joints {list(other.joints)}; those of {first.name}: '
                           f'{list(first.joints)}')
        if abs(other.period - first.period) > 0.02 * first.period:
            raise CtcError(f'{other.name}: a period of {other.period:.4g} s; that of '
                           f'{first.name}: {first.period:.4g} s')
    period = first.period
    nearest = round(period * 1e6) * 1e-6
    # Rounded only where the grid does not drift from the stamps by that.
    return nearest if abs(nearest - period) * len(first.t) < _ROUNDED * period else period


def _timed(parts: list[Stretch], rows: list[Rows], phi: TestFunction, source: str, name: str
           ) -> tuple[list[Stretch], list[Rows], Timing]:
    """Return the stretches that have the torque of the better source, and its timing."""
    options = []
    for kind in (COMMAND, EFFORT):
        mine = [(part, row) for part, row in zip(parts, rows) if has(part, kind) is not None]
        if mine and source in ('', kind):
            with_it, their_rows = [x for x, _ in mine], [x for _, x in mine]
            options.append((with_it, their_rows, timing(with_it, their_rows, kind, phi)))
    if not options:
        raise CtcError(f'{name}: no torque of the source {source}')
    if len(options) == 2:
        command, effort = (option[2].misfit for option in options)
        moving = np.isfinite(command) & (command > 0.0)
        if np.median(effort[moving] / command[moving]) < _BETTER:
            commands = options[0][2]
            chosen = dataclasses.replace(options[1][2], delays=commands.delays, commands=commands)
            return options[1][0], options[1][1], chosen
    return options[0]


def _left(selected: Selected, base: Array, weight: Array, data: Data, joints: Sequence[str]
          ) -> list[str]:
    """Return in words which part of weight or inertial torque is left, joint by joint."""
    found = []
    for i, name in enumerate(joints):
        used = data.way[:, i] != 0.0
        if used.sum() < 50:
            continue
        mine = [k for k, term in enumerate(selected.fit.terms) if term.joint == i]
        x = np.column_stack((weight[used, i], (base - weight)[used, i],
                             selected.fit.design[used, i][:, mine]))
        y = selected.fit.residual[used, i]
        length = np.sqrt(np.square(x).sum(axis=0))
        if min(length[:2]) <= 1e-9 * max(length[:2]):
            x[:, int(np.argmin(length[:2]))] = 0.0
        value = np.linalg.lstsq(x, y, rcond=1e-9)[0]
        rest = y - x @ value
        variance = float(rest.dot(rest)) / len(y) * correlation_length(rest)
        errors = np.sqrt(variance * np.linalg.pinv(x.T @ x).diagonal())
        for k, what in ((0, 'weight'), (1, 'inertial torque')):
            if abs(value[k]) > max(_LEFT, 4.0 * errors[k]) and errors[k] > 0.0:
                found.append(f'{name}: {value[k]:+.1%} ± {2.0 * errors[k]:.1%} of the '
                             f"model's {what} is left, which no mass above explains")
    return found
