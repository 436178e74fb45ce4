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

from ctc_chattering.bags.recording import Recording, Stretch, stretches
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.attribution import causes, Projected
from ctc_chattering.identification.bodies import ConsistentBodies, judged, left_over
from ctc_chattering.identification.drives import COMMAND, has
from ctc_chattering.identification.effort import torque_source
from ctc_chattering.identification.findings import ALL_JOINTS, Estimate, Finding, Severity
from ctc_chattering.identification.friction import (
    joint_friction,
    JointFriction,
    physical,
    select,
    Selected,
)
from ctc_chattering.identification.least_squares import Data
from ctc_chattering.identification.model_errors import ErrorColumns, ModelError
from ctc_chattering.identification.model_verdict import ModelVerdict, turned_gravity
from ctc_chattering.identification.residual_tests import findings, Unexplained, unexplained, wider
from ctc_chattering.identification.sensors import (
    Clock,
    clock,
    encoder_step,
    Noise,
    Positions,
    velocity_noise,
)
from ctc_chattering.identification.timing import (
    Profile,
    rate_limits,
    Timing,
    timing,
    timing_findings,
)
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

__all__ = ('Identification', 'JointFriction', 'identify')

#: Part of a period by which rounding it may move the last sample.
_ROUNDED = 0.1
#: Part of the joints that may be refused while the bodies of the others are corrected.
MOST_REFUSED = 0.34
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
    encoder, noise : list of Estimate, length n
        Step of the encoder, and noise of the measured velocity.
    timing : Timing
        Delay and lag of the torque.
    positions : Positions
        What is kept of those of all recordings.
    friction : list of JointFriction, length n
    errors : list of (ModelError, Estimate)
        Errors of the model: those that are clear, and those that cannot be told.
    data : Data
        The windows.
    selected : Selected
        The regression.
    duration : float
        Of all stretches [s].
    findings : tuple of Finding
        What makes numbers doubtful.
    scale : list of Estimate, length n
        Torque at the joint per torque of the signal.
    rotor : list of Estimate, length n
        Inertia of the rotors at the joint that the model lacks [kg·m²].
    dead_band : list of Estimate, length n
        Torque that each drive takes of its command; the reason says in which friction it is where
        the motion does not show it [N·m].
    tilt : tuple of Estimate, length 3
        Gravity in the frame of the base [m/s²].
    bodies : ConsistentBodies or None
        Inertial parameters that the moved bodies can have, nearest to the data.
    rate : list of Estimate, length n
        Rate limit of each drive [N·m/s].
    columns : ErrorColumns or None
        Errors of the model that the regression has; `selected.design` is about these.
    unexplained : tuple of (Unexplained or None), length n
        What the residuals depend on.
    held_out : ndarray, shape (n,)
        What the corrected bodies leave of each joint's torque on windows that they were not
        fitted to, over what the model leaves; empty where the bodies are those of the model.

    """

    joints: tuple[str, ...]
    clock: Clock
    encoder: list[Estimate]
    noise: list[Estimate]
    timing: Timing
    positions: Positions
    friction: list[JointFriction]
    errors: list[tuple[ModelError, Estimate]]
    data: Data
    selected: Selected
    duration: float
    findings: tuple[Finding, ...] = ()
    scale: list[Estimate] = dataclasses.field(default_factory=list)
    rotor: list[Estimate] = dataclasses.field(default_factory=list)
    dead_band: list[Estimate] = dataclasses.field(default_factory=list)
    tilt: tuple[Estimate, ...] = ()
    bodies: ConsistentBodies | None = None
    rate: list[Estimate] = dataclasses.field(default_factory=list)
    columns: ErrorColumns | None = None
    unexplained: tuple[Unexplained | None, ...] = ()
    held_out: Array = dataclasses.field(default_factory=lambda: np.zeros(0))


def identify(recordings: Sequence[Recording], model: Model, candidates: Sequence[ModelError],
             side: str = '', loaded: Sequence[Model] = (), velocities: Noise | None = None
             ) -> Identification:
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
    side : {'', 'motor', 'link', 'current'}
        What the effort is; empty where it is not known. Torques are taken from it if it is that
        of the motor, else from the commands.
    loaded : sequence of Model
        For each recording the model with its known payload; empty without one.
    velocities : (list of Estimate, list of Finding), optional
        Noise of the measured velocities, where they are known, and the recordings may lack them.

    Raises
    ------
    CtcError
        If the recordings do not belong together, are too short, or no joint moves.

    """
    parts, owners, phi = _parts(recordings)
    models = [loaded[k] if loaded else model for k in owners]
    columns = ErrorColumns.of(model)
    joints, stamps = recordings[0].joints, clock(recordings[0], phi.period)
    positions = Positions.of(recordings, phi.period)
    rows = _rows(parts, models, phi, columns, recordings[0].name)
    source, signal = torque_source(parts, rows, phi, joints, side)
    kept, found = _timed(parts, rows, phi, source, recordings[0].name)
    parts, rows = [parts[k] for k in kept], [rows[k] for k in kept]
    models = [models[k] for k in kept]

    def selected_with(rows: list[Rows], columns: ErrorColumns | None) -> tuple[Data, Selected]:
        data = Profile(parts, rows, found.source, phi).windows(*found.acting)
        size = np.sqrt(np.square(data.torque).mean(axis=0))
        return data, select(data, joints, columns, causes(columns, joints, candidates, size),
                            bool(loaded))

    data, selected = selected_with(rows, columns)
    gravity = turned_gravity(selected, columns)
    if gravity is not None:
        # Errors of masses under a tilted gravity: their product is in the columns about it.
        columns = ErrorColumns.of(model, gravity)
        rows = _rows(parts, models, phi, columns, recordings[0].name)
        data, selected = selected_with(rows, columns)
    noise, unlike = velocities or velocity_noise(recordings[0], phi.period)
    friction = [joint_friction(selected, i) for i in range(len(joints))]
    left = [unexplained(data, selected.fit, i) for i in range(len(joints))]
    named = ModelVerdict(selected, columns, candidates, joints)
    levels = [abs(x.coulomb.value or 0.0) for x in friction]
    bodies, impossible = judged(named.bodies(selected.projected), joints, levels)
    noticed = (*unlike, *timing_findings(found), *signal,
               *named.findings(), *physical(friction), *impossible,
               *(x for i, what in enumerate(left) if what for x in findings(i, what)))
    held_out = np.zeros(0)
    if columns is not None and bodies is not None:
        # A joint that is refused must not decide about the bodies of the others.
        refused = sorted({i for i, x in enumerate(friction) if x.coulomb.value is None} | {
            x.joint for x in noticed if x.severity == Severity.REFUSED and x.joint != ALL_JOINTS})
        others = data
        if refused and len(refused) <= MOST_REFUSED * len(joints):
            used = ~np.isin(np.arange(len(joints)), refused)
            others = dataclasses.replace(data, way=np.where(used, data.way, 0.0))
            bodies, _ = judged(named.bodies(Projected(others, selected.friction, columns)), joints,
                               levels, refused)
        if bodies is not None and bodies.differ:
            held_out = left_over(others, selected.friction, columns, selected.believed, refused)
    return Identification(
        joints, stamps, [encoder_step(x) for x in recordings[0].q.T], noise, found, positions,
        [wider(data, selected.fit, i, x, what) if what else x
         for i, (x, what) in enumerate(zip(friction, left))],
        named.errors(), data, selected, phi.period * sum(len(part.q) for part in parts), noticed,
        scale=named.scale(), rotor=named.rotor(), dead_band=named.dead_band(data, levels),
        tilt=named.gravity(), bodies=bodies, rate=rate_limits(found, joints),
        columns=columns, unexplained=tuple(left), held_out=held_out)


def _parts(recordings: Sequence[Recording]) -> tuple[list[Stretch], list[int], TestFunction]:
    """
    Return the stretches without a gap, and the recording of each.

    Raises
    ------
    CtcError
        If they are too short.

    """
    period = common_period(recordings)
    pairs = [(part, k) for k, recording in enumerate(recordings)
             for part in stretches(recording, period) if len(part.q) * period > 1.0]
    parts, owners = [part for part, _ in pairs], [k for _, k in pairs]
    duration = period * sum(len(part.q) for part in parts)
    if duration < _SHORTEST:
        raise CtcError(f'{recordings[0].name}: {duration:.2g} s without a gap; at least '
                       f'{_SHORTEST:g} s are needed')
    return parts, owners, TestFunction(period, duration)


def _rows(parts: Sequence[Stretch], models: Sequence[Model], phi: TestFunction,
          columns: ErrorColumns | None, name: str) -> list[Rows]:
    """Return the rows of each stretch; raise `CtcError` if no joint moves."""
    rows = [Rows.of(part, model, phi, columns) for part, model in zip(parts, models)]
    if not any((part.way != 0.0).sum() for part in rows):
        raise CtcError(f'{name}: no joint moves for longer than '
                       f'{2 * phi.half * phi.period:g} s in one direction')
    return rows


def common_period(recordings: Sequence[Recording]) -> float:
    """Return the period of recordings; raise `CtcError` if they do not belong together."""
    first, period = recordings[0], recordings[0].period
    for other in recordings[1:]:
        if other.joints != first.joints:
            raise CtcError(f'{other.name}: joints {list(other.joints)}; those of {first.name}: '
                           f'{list(first.joints)}')
        if abs(other.period - period) > 0.02 * period:
            raise CtcError(f'{other.name}: a period of {other.period:.4g} s; that of '
                           f'{first.name}: {period:.4g} s')
    nearest = round(period * 1e6) * 1e-6
    # Rounded only where the grid does not drift from the stamps by that.
    return nearest if abs(nearest - period) * len(first.t) < _ROUNDED * period else period


def _timed(parts: Sequence[Stretch], rows: Sequence[Rows], phi: TestFunction, source: str,
           name: str) -> tuple[list[int], Timing]:
    """Return which stretches have the torque of a source, and its timing."""
    kept, of = [], {}
    for kind in dict.fromkeys((COMMAND, source)):
        kept = [k for k, part in enumerate(parts) if has(part, kind) is not None]
        if kept:
            of[kind] = timing([parts[k] for k in kept], [rows[k] for k in kept], kind, phi)
    if source not in of:
        raise CtcError(f'{name}: no torque of the source {source}')
    commands = of.get(COMMAND)
    if source == COMMAND or commands is None:
        return kept, of[source]
    return kept, dataclasses.replace(of[source], delays=commands.delays, commands=commands)
