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
Identification of timing, bodies and friction from recordings of one robot.

`identified_robot` calls `identify_recordings` with the repaired recordings and the model. The
steps: stretches without a gap, windows, conventions of the torque, timing of the drives, the
regression with the terms that help, and its prediction of torque that was not fitted.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.bodies import IdentifiedBodies
from ctc_chattering.identification.conventions import (
    check_order,
    check_sign,
    check_torque,
    estimate_gravity,
)
from ctc_chattering.identification.drives import Drive, known_torque
from ctc_chattering.identification.effort import (
    choose_source,
    CURRENT,
    estimate_current_constants,
    LINK,
    scale_by_payload,
)
from ctc_chattering.identification.findings import Estimate, Finding
from ctc_chattering.identification.friction import joint_friction, JointFriction
from ctc_chattering.identification.prediction import Prediction
from ctc_chattering.identification.prior import (
    assumed_rotors,
    BodyPrior,
    finite_efforts,
    URDF_UNCERTAINTY,
)
from ctc_chattering.identification.recording import Recording
from ctc_chattering.identification.regression import Fit, Observations
from ctc_chattering.identification.regressor import BodyRegressor
from ctc_chattering.identification.selection import select
from ctc_chattering.identification.sensors import (
    Clock,
    estimate_encoder_step,
    estimate_velocity_noise,
    Positions,
    VelocityNoise,
)
from ctc_chattering.identification.stretches import COMMAND, EFFORT, split_recording, Stretch
from ctc_chattering.identification.timing import (
    estimate_rate_limits,
    find_timing_doubts,
    identify_timing,
    Timing,
)
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import join_windows, Windows
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Shortest recording that is used [s].
SHORTEST_S = 2.0
#: Shortest stretch without a gap that is used [s].
SHORTEST_STRETCH_S = 1.0


@dataclasses.dataclass(frozen=True)
class TorqueSignal:
    """
    Description of the torque by the user.

    Attributes
    ----------
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort: of a `current` no torque constant is known.
    urdf_uncertainty : float
        Uncertainty of a body of the URDF, as a part of the body.

    """

    side: str = ''
    urdf_uncertainty: float = URDF_UNCERTAINTY


@dataclasses.dataclass(frozen=True)
class Identification:
    """
    Numbers that were identified of n joints in J windows.

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
        Of all recordings.
    fit : Fit
        The regression.
    friction : list of JointFriction, length n
    bodies : IdentifiedBodies or None
        Bodies, rotors and gravity, or None without a regressor.
    prediction : Prediction
        Torque of data that were not fitted.
    rate : list of Estimate, length n
        Rate limit of each drive [N·m/s].
    constant : list of Estimate, length n
        Torque at the joint per unit of the signal, where it was identified.
    duration : float
        Of all stretches [s].
    findings : tuple of Finding
        What makes numbers doubtful.

    """

    joints: tuple[str, ...]
    clock: Clock
    encoder: list[Estimate]
    noise: list[Estimate]
    timing: Timing
    positions: Positions
    fit: Fit
    friction: list[JointFriction]
    bodies: IdentifiedBodies | None
    prediction: Prediction
    rate: list[Estimate]
    constant: list[Estimate]
    duration: float
    findings: tuple[Finding, ...] = ()


def identify_recordings(recordings: Sequence[Recording], model: Model,
                        signal: TorqueSignal = TorqueSignal(), loaded: Sequence[Model] = (),
                        velocities: VelocityNoise | None = None) -> Identification:
    """
    Identify a robot from recordings of its motion.

    Parameters
    ----------
    recordings : sequence of Recording
        Checked, with the same joints and about the same period.
    model : Model
        Assumed model of the robot.
    signal : TorqueSignal
        Description of the torque by the user.
    loaded : sequence of Model
        For each recording the model with its known payload, empty without one.
    velocities : VelocityNoise, optional
        Noise of the measured velocities, where it is known, and the recordings may lack them.

    Raises
    ------
    CtcError
        If the recordings do not belong together, are too short, no joint moves, or the torque has
        another unit, sign or order of joints.

    """
    motion = _ModelledStretches.of(recordings, loaded or [model] * len(recordings), signal.side)
    joints, is_commanded = recordings[0].joints, motion.source == COMMAND
    regressor = BodyRegressor.of(model)
    windows = motion.windows(regressor)
    data = motion.observe(windows)
    if not data.moving.any():
        raise CtcError(f'{recordings[0].name}: no joint moves')
    if is_commanded:
        check_order(data, joints)
    is_current = signal.side == CURRENT and motion.source == EFFORT
    if is_current:
        conventions = estimate_current_constants(
            data, _rotor_torque(data, regressor), finite_efforts(model))
    else:
        conventions = check_sign(data, motion.source)
    if regressor is not None:
        gravity = estimate_gravity(data.scaled(conventions.constant), regressor.gravity)
        if gravity is not regressor.gravity:
            regressor = dataclasses.replace(regressor, gravity=gravity)
            windows = motion.windows(regressor)
            data = motion.observe(windows)
    units = () if is_current else check_torque(
        data.scaled(conventions.constant), motion.source)

    timing_of_torque = motion.timing(windows)
    data = motion.observe(windows, timing_of_torque).scaled(conventions.constant)
    prior = BodyPrior.of(regressor, signal.urdf_uncertainty,
                         rotors_show=is_commanded or signal.side != LINK)
    constants = list(conventions.estimates)
    if loaded:
        data, constants = scale_by_payload(data, prior)
    best, basic, curved = select(data, prior, is_commanded)
    prediction = Prediction.of(best)
    period = motion.phi.period
    noise = velocities or estimate_velocity_noise(recordings[0], period)
    return Identification(
        joints=joints, clock=Clock.of(recordings[0], period),
        encoder=[estimate_encoder_step(q) for q in recordings[0].q.T], noise=noise.estimates,
        timing=timing_of_torque, positions=Positions.of(recordings, period), fit=best,
        friction=[joint_friction(best, joint, lasting, basic, joint in curved)
                  for joint, lasting in enumerate(prediction.systematic_rms.tolist())],
        bodies=None if regressor is None else IdentifiedBodies.of(best, regressor),
        prediction=prediction, rate=estimate_rate_limits(timing_of_torque), constant=constants,
        duration=motion.duration,
        findings=(*noise.findings, *units, *conventions.findings,
                  *find_timing_doubts(timing_of_torque)))


@dataclasses.dataclass(frozen=True)
class _ModelledStretches:
    """
    Stretches that have a torque, each with its model.

    Attributes
    ----------
    stretches : list of Stretch
        Without gaps.
    models : list of Model
        Model of each stretch, with its payload.
    phi : TestFunction
        φ.
    source : str
        `COMMAND` or `EFFORT`.

    """

    stretches: list[Stretch]
    models: list[Model]
    phi: TestFunction
    source: str

    @classmethod
    def of(cls, recordings: Sequence[Recording], models: Sequence[Model], side: str
           ) -> _ModelledStretches:
        """
        Return the motion of recordings, each with its model.

        Raises
        ------
        CtcError
            If they are too short, do not belong together, or have no torque.

        """
        period = common_period(recordings)
        pairs = [(stretch, model) for recording, model in zip(recordings, models)
                 for stretch in split_recording(recording, period)
                 if len(stretch.q) * period > SHORTEST_STRETCH_S]
        duration = period * sum(len(stretch.q) for stretch, _ in pairs)
        name = recordings[0].name
        if duration < SHORTEST_S:
            raise CtcError(f'{name}: {duration:.2g} s without a gap; at least {SHORTEST_S:g} s '
                           'are needed')
        source = choose_source([stretch for stretch, _ in pairs], side, name)
        with_torque = [pair for pair in pairs if pair[0].torque(source) is not None]
        return cls([stretch for stretch, _ in with_torque], [model for _, model in with_torque],
                   TestFunction(period, duration), source)

    @property
    def duration(self) -> float:
        """Duration of all stretches [s]."""
        return self.phi.period * sum(len(stretch.q) for stretch in self.stretches)

    def windows(self, regressor: BodyRegressor | None) -> list[Windows]:
        """Return the windows of each stretch with the regressor's gravity."""
        windows = [Windows.of(stretch, model, self.phi, regressor)
                   for stretch, model in zip(self.stretches, self.models)]
        if regressor is None:
            return windows
        change = regressor.gravity - regressor.parameters[-3:]
        return [rows.with_gravity(change) for rows in windows] if change.any() else windows

    def observe(self, windows: list[Windows], acting: Timing | None = None) -> Observations:
        """Return the windows with their torque, recorded or delayed."""
        n = self.stretches[0].q.shape[1]
        drive = Drive.ideal(n) if acting is None else acting.acting
        torque = [known_torque(stretch, rows.centres, self.source, self.phi, drive)
                  for stretch, rows in zip(self.stretches, windows)]
        return Observations.of(join_windows(windows), np.concatenate(torque))

    def timing(self, windows: list[Windows]) -> Timing:
        """Return the timing of the torque, with that of the commands."""
        of_torque = identify_timing(self.stretches, windows, self.source, self.phi)
        commanded = [pair for pair in zip(self.stretches, windows)
                     if pair[0].torque(COMMAND) is not None]
        if self.source == COMMAND or not commanded:
            return of_torque
        commands = identify_timing(
            [stretch for stretch, _ in commanded], [rows for _, rows in commanded], COMMAND,
            self.phi)
        return dataclasses.replace(of_torque, delays=commands.delays, commands=commands)


def _rotor_torque(data: Observations, regressor: BodyRegressor | None) -> Array:
    """Return the torque of assumed rotors, shape (J, n) [N·m]."""
    if regressor is None:
        return np.zeros_like(data.torque)
    accelerations = data.windows.bodies[:, :, regressor.inertial_count:-3]
    return np.asarray(accelerations @ assumed_rotors(regressor))


def common_period(recordings: Sequence[Recording]) -> float:
    """
    Return the period of recordings.

    Raise `CtcError` if they do not belong together.
    """
    first, period = recordings[0], recordings[0].period
    for recording in recordings[1:]:
        if recording.joints != first.joints:
            raise CtcError(
                f'{recording.name} has the joints {list(recording.joints)}, and {first.name} '
                f'{list(first.joints)}; recordings of one robot have the same joints')
        # Clocks of one robot differ by less than 2 %.
        if abs(recording.period - period) > 0.02 * period:
            raise CtcError(
                f'{recording.name} has a period of {recording.period:.4g} s, and {first.name} of '
                f'{period:.4g} s; at most 2 % of difference is allowed')
    nearest = round(period * 1e6) * 1e-6
    # Rounded only where this moves the last sample by less than a tenth of a period.
    return nearest if abs(nearest - period) * len(first.t) < 0.1 * period else period
