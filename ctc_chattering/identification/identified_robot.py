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

"""The corrected URDF, and the identification with it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import ctypes
import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.compilation import compile_setups, has_compiler
from ctc_chattering.bags.recording import RecordedMotion, Recording
from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.corrected_urdf import corrected_urdf, tip_of, with_payload
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import DESCRIBED, locked_positions, make_model
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError, UsageError
from ctc_chattering.identification import identify as regression
from ctc_chattering.identification.attribution import CauseKind
from ctc_chattering.identification.effort import CURRENT, in_torques, LINK, MOTOR
from ctc_chattering.identification.findings import ALL_JOINTS, Finding, Kind, Severity
from ctc_chattering.identification.gains import recommend
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.model_errors import candidates
from ctc_chattering.identification.model_verdict import lean
from ctc_chattering.identification.perturbation import perturbation
from ctc_chattering.identification.results import IdentificationResults, write_page
from ctc_chattering.identification.sensors import Noise, velocity_noise
from ctc_chattering.identification.trial_runs import (
    COUNT,
    COUNT_PLAIN,
    parameter_values,
    setups_tried,
    trial_runs,
    Values,
)
from ctc_chattering.numerics.angles import unwrapped
from ctc_chattering.output_files import check_format, new_folder, write_json, write_text
from ctc_chattering.parameters import check_some, LEAST, Parameter, whole

#: By how much the corrected model may explain the torque of a joint worse.
_WORSE = 1.02
#: Torque scale that is one, and no trifle.
_SCALE = 0.01
#: Part of a joint's torque, with friction, below which a correction is none.
_LEAST = 0.01
#: What is given of the drives: of `identify`, and of its command.
TORQUE_RATE = Parameter('torque_rate', 'float[]', None, 'rate limit of the drives', unit='N*m/s',
                        minimum=LEAST, shape='n')
TORQUE_CONSTANT = Parameter('torque_constant', 'float[]', None, 'torque at the joint per ampere '
                            'of a current [N·m/A], or per N·m of the motor: gear ratio included',
                            shape='n')
_SIDES = ('', MOTOR, LINK, CURRENT)


def corrected_description(found: Identification, description: str,
                          locked: Mapping[str, float] | None = None) -> str:
    """
    Return the corrected URDF; empty where the model is right, or something is refused.

    Parameters
    ----------
    found : Identification
        With the bodies that fit.
    description : str
        The URDF of the model; empty for another model.
    locked : mapping of str to float, optional
        As the model has it.

    """
    bodies, refused = found.bodies, _refused(found)
    if not description or bodies is None or not bodies.differ or ALL_JOINTS in refused or (
            len(refused) > regression.MOST_REFUSED * len(found.joints)):
        return ''
    size = bodies.torque(bodies.found - bodies.estimate.known)
    whole = bodies.torque(bodies.found) + [abs(x.coulomb.value or 0.0) for x in found.friction]
    # On data that it was not fitted to, it must be better, and on no joint worse.
    held_out = found.held_out
    if not (size > _LEAST * whole).any() or not len(held_out) or (
            held_out > _WORSE).any() or _scale_in_doubt(found):
        return ''
    return corrected_urdf(description, found.joints, bodies.parameters, bodies.rotor.tolist(),
                          bodies.tilt.tolist(), locked)


def _refused(found: Identification) -> set[int]:
    """Return the joints that are refused."""
    return {x.joint for x in found.findings if x.severity == Severity.REFUSED}


def _scale_in_doubt(found: Identification) -> bool:
    """Return whether a torque scale explains as much as what is in the bodies."""
    chosen = found.selected.explanation
    mine = [] if chosen is None else chosen.causes
    return any(cause.kind == CauseKind.SCALE and abs(value[0]) > _SCALE and not any(
        cause is x for x in mine) for other in found.selected.alike
        for cause, value in zip(other.causes, other.values))


def with_correction(before: Identification, after: Identification, name: str
                    ) -> Identification | None:
    """
    Return the identification with a corrected model, with what was wrong; None if it is no better.

    Parameters
    ----------
    before, after : Identification
        With the model as it was, and corrected.
    name : str
        Of the file that has the correction.

    """
    if _refused(after) - _refused(before):
        return None
    assert before.bodies is not None
    change = before.bodies.torque(before.bodies.found - before.bodies.estimate.known)
    text = ', '.join(f'{x:.2g}' for x in change)
    turn = lean(before.bodies.estimate.known[-3:], before.bodies.tilt)
    return dataclasses.replace(
        after, errors=before.errors, rotor=before.rotor, tilt=before.tilt, bodies=before.bodies,
        findings=(*(x._replace(reason=f'relative to {name}: {x.reason}') if 'base is turned' in
                    x.reason else x for x in after.findings), Finding(
            Kind.NOTE, ALL_JOINTS, f'the URDF is corrected in {name}, which changes the '
            f'torque by {text} N*m RMS in this motion'
            + f', and turns the base by {turn:.2g} degrees' * bool(turn > 0.0))))


#: Names in the directory of `write_identified`.
PAGE, JSON, VALUES, ROBOT, CORRECTED, FIGURES = (
    'index.html', 'identify.json', 'identified.yaml', 'robot.urdf', 'corrected.urdf', 'figures')
#: The command that writes it.
IDENTIFY = 'ctc identify'
#: Acceleration of gravity where nothing says otherwise [m/s²].
_GRAVITY = 9.81
#: What is allowed of it.
GRAVITY = ControllerConfig.parameters()['gravity']


@dataclasses.dataclass(frozen=True)
class RobotModel:
    """
    The model, and values of all nodes.

    `files` are descriptions by name; the last one is that of the model.
    """

    model: Model
    files: dict[str, str]
    locked: dict[str, float]
    shared: dict[str, Any]
    gains: tuple[Any, Any] | None

    def described(self, text: str, joints: tuple[str, ...]) -> Model:
        """Return the model of a description in the place of its own."""
        return make_model('urdf', self.shared['gravity'], joints, text, self.locked)

    def identified(self, recordings: Sequence[Recording], side: str,
                   payloads: Sequence[tuple[float, str]], velocities: Noise
                   ) -> Identification:
        """Return what is identified with the model; arguments as of `identify` of both modules."""
        text, joints = ['', *self.files.values()][-1], recordings[0].joints
        loaded = [self.described(with_payload(text, joints, mass, link) if mass else text, joints)
                  for mass, link in payloads] if any(mass for mass, _ in payloads) else []
        return regression.identify(recordings, self.model, candidates(
            self.model, text, self.locked), side, loaded, velocities)


@dataclasses.dataclass(frozen=True)
class IdentifiedRobot:
    """
    A robot as `identify` has found it.

    Attributes
    ----------
    results : IdentificationResults
        All numbers with their intervals: ``results.found`` has ``friction``, ``timing`` and
        ``errors`` of the model, ``results.recommended`` law and gains, ``results.verdicts`` what
        they are good for. ``results.text()`` is what ``ctc identify`` prints, and
        ``results.as_mapping()`` what ``identify.json`` has.
    robot : RobotModel
        The model, corrected where that is better.

    """

    results: IdentificationResults
    robot: RobotModel

    @property
    def missing(self) -> list[str]:
        """Return the joints that are not usable: of these there are no gains."""
        return [x.joint for x in self.results.verdicts if not x.usable]

    def parameters(self, directory: Path) -> Values:
        """Return the values of the parameter file, by node; `directory` has the description."""
        shared = dict(self.robot.shared)
        if self.robot.files:
            shared['description'] = str((directory / list(self.robot.files)[-1]).resolve())
        return parameter_values(
            self.results.found, self.results.recommended, self.robot.model, shared,
            self.robot.gains)


def identify(motions: Sequence[RecordedMotion], model: str = '', urdf: str = '',
             gravity: float | None = None, side: str = '', torque_rate: Sequence[float] = (),
             torque_constant: Sequence[float] | None = None,
             payloads: Sequence[tuple[float, str]] = ()) -> IdentifiedRobot:
    """
    Identify friction, drives and errors of the model from recorded motions, with gains.

    Parameters
    ----------
    motions : sequence of RecordedMotion
        As `read_motion` returns them, of one robot.
    model : str
        ``two_link``, ``urdf`` or ``package.module:Name``; empty for that of the recording.
    urdf : str
        Text of the URDF in place of that of the recording.
    gravity : float, optional
        In place of that of the recording, or 9.81 [m/s²].
    side : {'', 'motor', 'link', 'current'}
        What the effort is: torque of the motor, torque of a sensor behind the gear, or a current;
        empty where it is not used.
    torque_rate : sequence of float, length n
        Rate that the drives allow [N·m/s]; empty where it is not known.
    torque_constant : sequence of float, length n, optional
        Torque at the joint per unit of the effort, of a current [N·m/A] or a torque of the motor:
        the motor's times the gear ratio.
    payloads : sequence of (float, str)
        For each motion the mass of a known payload [kg], 0 for none, and the link that has it at
        its origin. A motion with one beside a motion without tells torque constants from masses.

    Returns
    -------
    IdentifiedRobot
        For `write_identified`.

    Raises
    ------
    CtcError
        If an argument is not allowed, the recordings do not belong together, are too short, or no
        joint moves.

    """
    check_some('motions', motions)
    if side not in _SIDES:
        raise ParameterError('side', side, ' | '.join(map(repr, _SIDES)))
    joints = motions[0].recording.joints
    constant, rate = (
        x if x is None or not len(x) else spec.checked(x, len(joints))
        for spec, x in ((TORQUE_CONSTANT, torque_constant), (TORQUE_RATE, torque_rate)))
    recordings, side = in_torques([x.recording for x in motions], side, constant)
    robot = _robot(motions[0], model, urdf, gravity)
    recordings = [_turning_on(x, motions[0].controller, robot.model) for x in recordings]
    if not all(0.0 <= mass < inf for mass, _ in payloads):
        raise ParameterError('payloads', payloads, 'pairs of a mass >= 0 [kg] and a link')
    if payloads and (len(payloads) != len(motions) or not robot.files):
        raise ParameterError('payloads', payloads, f'{len(motions)} pairs, one for each motion, '
                             'with mass 0 for none, of a URDF')
    payloads = [(mass, link or tip_of(Tree(robot.files[ROBOT]), joints))
                for mass, link in payloads]
    notes = [note for x in motions for note in x.notes] + [
        f'{x.recording.name}: a ball of {mass:g} kg, radius 5 cm, at the origin of {link}'
        for x, (mass, link) in zip(motions, payloads) if mass]
    # Velocities are needed no more: long ones are large.
    velocities = velocity_noise(recordings[0], regression.common_period(recordings))
    recordings = [dataclasses.replace(x, dq=None) for x in recordings]
    del motions
    found = robot.identified(recordings, side, payloads, velocities)
    # Where the URDF is clearly wrong, all again with a corrected one.
    if text := corrected_description(found, robot.files.get(ROBOT, ''), robot.locked):
        other = dataclasses.replace(robot, model=robot.described(text, joints),
                                    files={**robot.files, CORRECTED: text})
        better = with_correction(
            found, other.identified(recordings, side, payloads, velocities), CORRECTED)
        found, robot = (found, robot) if better is None else (better, other)
    found = dataclasses.replace(found, findings=(*found.findings, *(
        Finding(Kind.NOTE, ALL_JOINTS, note) for note in notes)))
    name = ', '.join(x.name for x in recordings)
    del recordings
    with suppress(AttributeError, OSError):  # The C library of Linux keeps freed memory.
        ctypes.CDLL(None).malloc_trim(0)
    perturbed = perturbation(found)
    return IdentifiedRobot(IdentificationResults(
        name, found, perturbed, recommend(found, perturbed, robot.model, rate or ())), robot)


def _turning_on(recording: Recording, controller: ControllerConfig | None, model: Model
                ) -> Recording:
    """Return a recording whose continuous joints count their turns, as a driver may not."""
    described = dict(zip(recording.joints, model.continuous))
    named = (DESCRIBED,) if controller is None else controller.continuous_joints
    continuous = [name in named or (DESCRIBED in named and described.get(name, False))
                  for name in recording.joints]
    q = unwrapped(recording.t, recording.q, None, continuous)
    return recording if q is recording.q else dataclasses.replace(recording, q=q)


def _robot(motion: RecordedMotion, model: str, urdf: str, gravity: float | None) -> RobotModel:
    """Return the model for a motion, from arguments, the recording, or both."""
    controller, description = motion.controller, urdf or motion.description
    name = model or ('urdf' if urdf else controller.model if controller else
                     'urdf' if description else '')
    if not name:
        raise UsageError(f'{motion.recording.name} has no robot description: give --urdf FILE, or '
                         '--model; in Python urdf, or model')
    if gravity is None:
        gravity = controller.gravity if controller else _GRAVITY
    gravity = GRAVITY.checked(gravity)
    locked = controller.locked if controller else ('',)
    positions = locked_positions(locked)
    made = make_model(name, gravity, motion.recording.joints, description, positions)
    shared: dict[str, Any] = {'model': name, 'gravity': gravity}
    if any(locked):
        shared['locked'] = list(locked)
    if controller and controller.joint_names == motion.recording.joints and (
            controller.continuous_joints != (DESCRIBED,)):
        shared['continuous_joints'] = list(controller.continuous_joints)
    return RobotModel(made, {ROBOT: description} if name == 'urdf' else {}, positions, shared,
                      (controller.kp, controller.kv) if controller else None)


def write_identified(identified: IdentifiedRobot, out: str | Path, trials: int | None = None,
                     show: Callable[[str], None] = print, extra: str = 'svg',
                     command: str = '', overwrite: bool = False) -> IdentifiedRobot:
    """
    Try the gains in simulation, and write parameter file, numbers, figures and page.

    Parameters
    ----------
    identified : IdentifiedRobot
        What `identify` has found.
    out : str or Path
        Directory for ``identified.yaml``, which `simulate` and all nodes take, ``identify.json``,
        ``figures``, ``index.html`` and the URDF. The parameter file is not written if a joint is
        not usable (`IdentifiedRobot.missing`).
    trials : int, optional
        Robots within the intervals on which the gains are tried; by default 24, or 8 without
        numba; 0 for none.
    show : callable
        Takes lines about what is compiled for them.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        What was run, for the page.
    overwrite : bool
        Replace what an earlier call has written there.

    Returns
    -------
    IdentifiedRobot
        With the law and gains that survive the trials.

    Raises
    ------
    CtcError
        If an argument is not allowed, there are files already, or one cannot be written.

    """
    check_format(extra)
    if trials is None:
        trials = COUNT if has_compiler() else COUNT_PLAIN
    whole('trials', trials, 0)
    with new_folder(Path(out), IDENTIFY, overwrite) as folder:
        for name, text in identified.robot.files.items():
            write_text(folder / name, text)
        tried = _tried(identified, folder, trials, show)
        if not tried.missing:
            parameter_file.dump(tried.parameters(folder), folder / VALUES)
            parameter_file.load(folder / VALUES)
            parameter_file.dump(tried.parameters(Path(out)), folder / VALUES)
        write_json(tried.results.as_mapping(), folder / JSON)
        _write_page(tried, folder, extra, command)
    return tried


def _tried(identified: IdentifiedRobot, folder: Path, trials: int, show: Callable[[str], None]
           ) -> IdentifiedRobot:
    """Return the robot with the gains that survive the trials; its URDF is in a folder."""
    if not trials or identified.missing:
        return identified
    results = identified.results
    setups = setups_tried(
        results.recommended, identified.parameters(folder), identified.robot.gains)
    compile_setups(setups, show)
    return dataclasses.replace(identified, results=dataclasses.replace(
        results, recommended=trial_runs(
            results.found, results.run, results.recommended, setups, trials)))


def _write_page(identified: IdentifiedRobot, folder: Path, extra: str, command: str) -> None:
    """Write figures and page."""
    from ctc_chattering.analysis.drawing import save  # Takes time.
    from ctc_chattering.identification.figures import friction_figure

    results = identified.results
    files = {name: what for name, what in (
        (VALUES, 'parameter file'), (JSON, 'all numbers'), (CORRECTED, 'corrected URDF'))
        if (folder / name).exists()}
    figures = save([friction_figure(results.found, results.verdicts)], folder / FIGURES,
                   ('svg', extra))
    write_page(results, figures, folder / PAGE, files, command)
