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
Torque that is used, commanded or measured, and its constants.

`identify` asks which torque it may use. An effort becomes the torque at the joint by constants of
the user. For currents without them, the constant is that with which they carry the model. Motions
with and without a known payload show constants apart from masses.
"""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses
from typing import NamedTuple

from ctc_chattering.errors import ParameterError, UsageError
from ctc_chattering.identification.conventions import (
    Conventions,
    Factor,
    Factors,
    fit_beside_any_gravity,
    friction_columns,
)
from ctc_chattering.identification.findings import Estimate, Finding, Gap, Reason, Severity
from ctc_chattering.identification.friction_terms import FrictionTerm, TermKind
from ctc_chattering.identification.prior import BodyPrior
from ctc_chattering.identification.recording import (
    Recording,
    RecordingError,
    RecordingFault,
)
from ctc_chattering.identification.regression import fit, Observations, Unknowns
from ctc_chattering.identification.selection import basic_terms
from ctc_chattering.identification.stretches import COMMAND, EFFORT, Stretch
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import checked_vector
import numpy as np

#: Kinds of a measured effort: torque of the motor at the joint [N·m], torque of a sensor behind
#: the gear [N·m], or a current [A].
MOTOR = 'motor'
LINK = 'link'
CURRENT = 'current'


def choose_source(stretches: Sequence[Stretch], side: str, name: str) -> str:
    """
    Return the torque that is used, `COMMAND` or `EFFORT`.

    An effort is used only if the user says that it is a torque or a current.

    Parameters
    ----------
    stretches : sequence of Stretch
        Stretches of all recordings.
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort, as the user says.
    name : str
        Name of the recording, for messages.

    Raises
    ------
    CtcError
        If there are no commands, and the user does not say what the effort is.

    """
    is_commanded = any(x.command is not None for x in stretches)
    is_measured = any(x.effort is not None for x in stretches)
    if is_measured and side and not (is_commanded and side == LINK):
        return EFFORT
    if is_commanded:
        return COMMAND
    raise RecordingError(
        RecordingFault.TORQUE,
        f'{name}: the recording has no commanded torques, and does not tell what the effort is. '
        'Give --effort motor for the torque of the motors in N*m at the joint, --effort current '
        'for currents, or --effort link for a torque sensor behind the gear, which shows little '
        'of its friction')


def convert_effort(
        recordings: Sequence[Recording],
        side: str,
        torque_constant: Sequence[float] | None) -> tuple[list[Recording], str]:
    """
    Return recordings with the torque at the joint, and its kind.

    Parameters
    ----------
    recordings : sequence of Recording
        Recordings of n joints.
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort, empty where it is not known.
    torque_constant : sequence of float, length n, optional
        Torque at the joint per unit of the effort [N·m/A, or 1 for a torque].

    Raises
    ------
    CtcError
        If an argument is not allowed, or they do not go together.

    """
    if side and all(x.effort is None for x in recordings):
        raise UsageError(f'effort {side}: {recordings[0].name} has no effort')
    if torque_constant is None:
        return list(recordings), side
    if not side:
        raise UsageError('torque_constant needs --effort: motor, link or current')
    n = len(recordings[0].joints)
    factor = checked_vector('torque_constant', torque_constant, n)
    if not (np.isfinite(factor) & (factor != 0.0)).all():
        raise ParameterError('torque_constant', torque_constant, 'finite numbers that are not 0')
    converted = []
    for recording in recordings:
        if len(recording.joints) != n:
            raise RecordingError(
                RecordingFault.JOINTS,
                f'{recording.name}: {len(recording.joints)} joints; '
                f'{recordings[0].name} has {n}')
        if recording.effort is not None:
            recording = dataclasses.replace(recording, effort=recording.effort * factor)
        converted.append(recording)
    return converted, MOTOR if side == CURRENT else side


# Constants that the recording shows.

def estimate_current_constants(
        data: Observations,
        rotors: Array,
        efforts: Array) -> Conventions:
    """
    Return the torque per ampere of each joint.

    It is that with which the current carries the model. For a joint whose current does not show
    it, that of the others is taken, in proportion to the effort limits.

    Parameters
    ----------
    data : Observations
        Windows with the currents.
    rotors : ndarray, shape (J, n)
        Torque of the rotors that are assumed beside the model [N·m]. The change of the constant
        without them is part of its error.
    efforts : ndarray, shape (n,)
        Effort limits [N·m], 0 where there is none.

    """
    constant = np.ones(len(efforts))
    errors = np.full(len(efforts), np.inf)
    findings = []
    model = data.windows.model_torque
    unknown = []
    for joint in np.flatnonzero(data.moving).tolist():
        value, error = _fit_model_factor(data, joint, model + rotors)
        rigid = _fit_model_factor(data, joint, model)
        error = float(np.hypot(error, value - rigid.value))
        if error > 0.25 * abs(value):  # The model does not show it.
            unknown.append(joint)
            continue
        constant[joint] = 1.0 / value
        errors[joint] = error / value ** 2
        findings.append(Finding(Reason.URDF_CONSTANT, Severity.CARE, joint, {
            'constant': constant[joint], 'error': 2.0 * error / abs(value)}))
    is_usable = np.isfinite(errors) & (efforts > 0.0)
    per_effort = np.abs(constant[is_usable]) / efforts[is_usable]
    typical = float(np.median(per_effort)) if is_usable.any() else 0.0
    for joint in unknown:
        size = typical * efforts[joint]
        if not size:
            findings.append(Finding(Reason.NO_CONSTANT, Severity.REFUSED, joint))
            continue
        constant[joint] = size * (fit_beside_any_gravity(data, joint).factors[0].sign or 1.0)
        errors[joint] = 0.5 * size  # It is a guess.
        findings.append(Finding(
            Reason.OTHERS_CONSTANT,
            Severity.CARE,
            joint,
            {'constant': constant[joint]}))
    estimates = [
        Estimate(value, 2.0 * error) if np.isfinite(error) else
        Estimate.unknown(Gap.NOT_SHOWN)
        for value, error in zip(constant.tolist(), errors.tolist())]
    return Conventions(constant, tuple(findings), tuple(estimates))


def _fit_model_factor(data: Observations, joint: int, model_torque: Array) -> Factor:
    """Return the factor of a model's torque, shape (J, n) [N·m]."""
    used = data.used[:, joint]
    columns = np.column_stack((model_torque[used, joint], friction_columns(data, joint, used)))
    return Factors.fit(columns, data.torque[used, joint]).factors[0]


class ScaledTorque(NamedTuple):
    """Windows with the torque at the joints, and its constants."""

    data: Observations
    constant: list[Estimate]


def scale_by_payload(data: Observations, prior: BodyPrior) -> ScaledTorque:
    """
    Return windows with the torque that a known payload shows.

    The payload is in the torque of the model, and the bodies are the same in all motions.

    Parameters
    ----------
    data : Observations
        Windows of motions with and without a known payload.
    prior : BodyPrior
        Prior of the bodies.

    """
    moving = np.flatnonzero(data.moving).tolist()
    terms = [term for joint in moving for term in basic_terms(data, joint)]
    # A constant deviates by 0.3 before any data.
    scales = [FrictionTerm(TermKind.SCALE, joint, 0.3) for joint in moving]
    solution = fit(data, Unknowns(prior, (*terms, *scales)))
    constant = np.ones(data.joint_count)
    estimates = [Estimate.unknown(Gap.HARDLY_MOVES)] * data.joint_count
    for joint in moving:
        row = solution.unknowns.row(joint, TermKind.SCALE)
        # The signal is 1 + x times the torque.
        constant[joint] = 1.0 / (1.0 + float(row @ solution.value))
        half = float(solution.half_interval(row)) * constant[joint] ** 2
        estimates[joint] = Estimate(float(constant[joint]), half)
    return ScaledTorque(data.scaled(constant), estimates)
