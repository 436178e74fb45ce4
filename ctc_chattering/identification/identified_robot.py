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
Identification of a robot: numbers, corrected URDF, gains and files.

`ctc identify` and the Python API call `identify` with the motions of bags or tables, then
`write_identified`, which tries the gains in simulation and writes all files.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
import ctypes
import dataclasses
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import ASSUMED_ROTOR
from ctc_chattering.configuration.compilation import compile_setups, has_compiler
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.dynamics.corrected_urdf import with_rotors
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.payload import tip_of, with_payload
from ctc_chattering.dynamics.registry import DESCRIBED, locked_positions, make_model
from ctc_chattering.dynamics.urdf_model import SingularInertia
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import ParameterError, UsageError
from ctc_chattering.identification.effort import convert_effort, CURRENT, LINK, MOTOR
from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.gains import recommend
from ctc_chattering.identification.identify import (
    common_period,
    Identification,
    identify_recordings,
    TorqueSignal,
)
from ctc_chattering.identification.perturbation import measure_perturbation
from ctc_chattering.identification.prior import URDF_UNCERTAINTY
from ctc_chattering.identification.recorder_faults import repair
from ctc_chattering.identification.recording import RecordedMotion, Recording
from ctc_chattering.identification.results import IdentificationResults, write_page
from ctc_chattering.identification.sensors import estimate_velocity_noise
from ctc_chattering.identification.trial_runs import (
    COMPILED_COUNT,
    parameter_values,
    PLAIN_COUNT,
    setups_tried,
    trial_runs,
    Values,
)
from ctc_chattering.number_format import round_number
from ctc_chattering.numerics.angles import unwrapped
from ctc_chattering.output_files import check_format, write_json, write_text
from ctc_chattering.output_folder import new_folder
from ctc_chattering.parameters import check_not_empty, checked_integer, LEAST, Parameter
import numpy as np

#: Declaration of the rate of the drives.
TORQUE_RATE = Parameter(
    'torque_rate',
    'float[]',
    None,
    'rate limit of the drives',
    unit='N*m/s',
    minimum=LEAST,
    shape='n',
)
#: Declaration of torque constants.
TORQUE_CONSTANT = Parameter(
    'torque_constant',
    'float[]',
    None,
    'torque at the joint per ampere '
    'of a current [N·m/A], or per N·m of the motor: gear ratio included',
    shape='n',
)
#: Declaration of the uncertainty of the URDF.
UNCERTAINTY = Parameter(
    'urdf_uncertainty',
    'float',
    URDF_UNCERTAINTY,
    'uncertainty of a body of the URDF, as a part of its mass and size',
    minimum=LEAST,
    maximum=10.0,
)
#: Declaration of gravity.
GRAVITY = ControllerConfig.parameters()['gravity']
#: Kinds of a measured effort.
SIDES = ('', MOTOR, LINK, CURRENT)
#: Names in the directory of `write_identified`.
PAGE = 'index.html'
JSON = 'identify.json'
VALUES = 'identified.yaml'
ROBOT = 'robot.urdf'
CORRECTED = 'corrected.urdf'
FIGURES = 'figures'
#: The command that writes these.
IDENTIFY = 'ctc identify'
#: Turn of the base that needs care [rad].
MOUNT_NOTE_RAD = 0.02
#: Limits of the controller that stay those of the recording.
_LIMITS = ('error_limit', 'effort_limit', 'effort_rate_limit')
#: Acceleration of gravity where nothing says otherwise [m/s²].
USUAL_GRAVITY = 9.81


@dataclasses.dataclass(frozen=True)
class RobotModel:
    """
    A model with the values that all nodes share.

    Attributes
    ----------
    model : Model
        Of the robot.
    files : dict of str to str
        Descriptions by name. The last one is that of the model.
    locked : dict of str to float
        Positions of joints that the model fixes [rad].
    shared : dict
        Values of all nodes.
    gains : (kp, kv) or None
        Of the recorded run.
    limits : dict
        Finite limits of the controller of the recorded run, by parameter.

    """

    model: Model
    files: dict[str, str]
    locked: dict[str, float]
    shared: dict[str, Any]
    gains: tuple[Any, Any] | None
    limits: dict[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def description(self) -> str:
        """Text of the URDF, empty for another model."""
        return ['', *self.files.values()][-1]

    def described(self, text: str, joints: tuple[str, ...]) -> Model:
        """Return the model of another description."""
        return make_model('urdf', self.shared['gravity'], joints, text, self.locked)

    def loaded(
        self, payloads: Sequence[tuple[float, str]], joints: tuple[str, ...]
    ) -> list[Model]:
        """Return the model with each payload, empty without any."""
        if not any(mass for mass, _ in payloads):
            return []
        return [
            self.described(with_payload(self.description, joints, mass, link), joints)
            if mass
            else self.model
            for mass, link in payloads
        ]

    def corrected(self, identified: Identification) -> RobotModel:
        """Return it with the identified bodies, if they differ."""
        text = corrected_description(identified, self.files.get(ROBOT, ''), self.locked)
        if not text:
            return self
        return dataclasses.replace(
            self,
            model=self.described(text, identified.joints),
            files={**self.files, CORRECTED: text},
        )


def corrected_description(
    identified: Identification, description: str, locked: Mapping[str, float] | None = None
) -> str:
    """
    Return the URDF with the identified bodies, empty for no change.

    Parameters
    ----------
    identified : Identification
        With the bodies.
    description : str
        The URDF of the model, empty for another model.
    locked : mapping of str to float, optional
        Positions of joints that the model fixes [rad].

    """
    bodies = identified.bodies
    if not description or bodies is None or not (bodies.differ() or bodies.turn):
        return ''
    return bodies.description(description, identified.joints, locked)


def correction_findings(identified: Identification, file: str) -> Iterator[Finding]:
    """Yield the differences of a corrected URDF from the given one."""
    bodies = identified.bodies
    assert bodies is not None
    yield Finding(
        Reason.CORRECTED,
        Severity.NOTE,
        values={'file': file, 'change': bodies.change_rms().tolist()},
    )
    if bodies.turn > MOUNT_NOTE_RAD:
        yield Finding(
            Reason.MOUNT,
            Severity.CARE,
            values={
                'file': file,
                'gravity': bodies.gravity.tolist(),
                'degrees': float(np.degrees(bodies.turn)),
            },
        )
    for joint, rotor in enumerate(bodies.rotors):
        if rotor.value is not None and rotor.value - rotor.half > 0.0:
            yield Finding(Reason.ROTOR, Severity.NOTE, joint, {'file': file, 'rotor': rotor})


@dataclasses.dataclass(frozen=True)
class IdentifiedRobot:
    """
    A robot with its identified numbers and its model.

    Attributes
    ----------
    results : IdentificationResults
        All numbers with their intervals: ``results.found`` has ``friction``, ``timing`` and
        ``bodies`` of the model, ``results.recommended`` law and gains, ``results.verdicts`` what
        they are good for. ``results.text()`` is what ``ctc identify`` prints, and
        ``results.as_mapping()`` what ``identify.json`` has.
    robot : RobotModel
        The model, corrected where that is better.

    """

    results: IdentificationResults
    robot: RobotModel

    @property
    def missing(self) -> list[str]:
        """Return the joints without gains: they are not usable."""
        return [x.joint for x in self.results.verdicts if not x.usable]

    def parameters(self, directory: Path) -> Values:
        """
        Return the values of the parameter file, by node.

        The description is in `directory`.
        """
        shared = dict(self.robot.shared)
        if self.robot.files:
            shared['description'] = str((directory / list(self.robot.files)[-1]).resolve())
        return parameter_values(
            self.results.found,
            self.results.recommended,
            self.robot.model,
            shared,
            self.robot.gains,
        )


def identify(
    motions: Sequence[RecordedMotion],
    model: str = '',
    urdf: str = '',
    gravity: float | None = None,
    side: str = '',
    torque_rate: Sequence[float] = (),
    torque_constant: Sequence[float] | None = None,
    payloads: Sequence[tuple[float, str]] = (),
    urdf_uncertainty: float = URDF_UNCERTAINTY,
) -> IdentifiedRobot:
    """
    Identify friction, drives, errors of the model, and gains.

    Parameters
    ----------
    motions : sequence of RecordedMotion
        As `read_motion` returns them, of one robot.
    model : str
        ``two_link``, ``urdf`` or ``package.module:Name``, empty for that of the recording.
    urdf : str
        Text of the URDF in place of that of the recording.
    gravity : float, optional
        In place of that of the recording, or 9.81 [m/s²].
    side : {'', 'motor', 'link', 'current'}
        Kind of the effort: torque of the motor, torque of a sensor behind the gear, or a current.
        It is empty where the effort is not used.
    torque_rate : sequence of float, length n
        Rate that the drives allow [N·m/s], empty where it is not known.
    torque_constant : sequence of float, length n, optional
        Torque at the joint per unit of the effort, of a current [N·m/A] or a torque of the motor:
        the motor's times the gear ratio.
    payloads : sequence of (float, str)
        For each motion the mass of a known payload [kg], 0 for none, and the link that has it at
        its origin. A motion with one beside a motion without tells torque constants from masses.
    urdf_uncertainty : float
        Uncertainty of a body of the URDF, as a part of the body.

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
    check_not_empty('motions', motions)
    if side not in SIDES:
        raise ParameterError('side', side, ' | '.join(map(repr, SIDES)))
    joints = motions[0].recording.joints
    constant, rate = (
        x if x is None or not len(x) else spec.checked(x, len(joints))
        for spec, x in ((TORQUE_CONSTANT, torque_constant), (TORQUE_RATE, torque_rate))
    )
    uncertainty = UNCERTAINTY.checked(urdf_uncertainty)
    recordings, side = convert_effort([x.recording for x in motions], side, constant)
    findings = [
        Finding(Reason.RECORDING, Severity.NOTE, values={'text': text})
        for x in motions
        for text in x.notes
    ]
    controller = motions[0].controller
    robot = _robot(motions[0], model, urdf, gravity, findings)
    del motions  # Long ones are large.
    payloads = _checked_payloads(payloads, len(recordings), robot, joints)
    findings += [
        Finding(
            Reason.PAYLOAD,
            Severity.NOTE,
            values={'recording': recording.name, 'mass': mass, 'link': link},
        )
        for recording, (mass, link) in zip(recordings, payloads)
        if mass
    ]
    name = ', '.join(x.name for x in recordings)
    for k in range(len(recordings)):
        recordings[k], repairs = repair(recordings[k])
        recordings[k] = _count_turns(recordings[k], controller, robot.model)
        findings += repairs
    # Velocities are needed no more after this.
    velocities = estimate_velocity_noise(recordings[0], common_period(recordings))
    recordings = [dataclasses.replace(x, dq=None) for x in recordings]
    identified = identify_recordings(
        recordings,
        robot.model,
        TorqueSignal(side, uncertainty),
        robot.loaded(payloads, joints),
        velocities,
    )
    del recordings
    robot = robot.corrected(identified)
    is_corrected = CORRECTED in robot.files
    corrections = correction_findings(identified, CORRECTED) if is_corrected else ()
    identified = dataclasses.replace(
        identified, findings=(*findings, *identified.findings, *corrections)
    )
    with suppress(AttributeError, OSError):  # The C library of Linux keeps freed memory.
        ctypes.CDLL(None).malloc_trim(0)
    run = measure_perturbation(identified, is_corrected)
    recommended = recommend(identified, run, robot.model, rate or (), is_corrected)
    return IdentifiedRobot(IdentificationResults(name, identified, run, recommended), robot)


def _checked_payloads(
    payloads: Sequence[tuple[float, str]], count: int, robot: RobotModel, joints: tuple[str, ...]
) -> list[tuple[float, str]]:
    """
    Return the payload of each motion, empty for none.

    It is at the tip where no link is named.
    """
    if not all(0.0 <= mass < inf for mass, _ in payloads):
        raise ParameterError('payloads', payloads, 'pairs of a mass >= 0 [kg] and a link')
    if payloads and (len(payloads) != count or not robot.files):
        raise ParameterError(
            'payloads',
            payloads,
            f'{count} pairs, one for each motion, with mass 0 for none, of a URDF',
        )
    return [(mass, link or tip_of(Tree(robot.description), joints)) for mass, link in payloads]


def _count_turns(
    recording: Recording, controller: ControllerConfig | None, model: Model
) -> Recording:
    """Return a recording that counts turns also over pauses."""
    described = dict(zip(recording.joints, model.continuous))
    named = (DESCRIBED,) if controller is None else controller.continuous_joints
    continuous = [
        name in named or (DESCRIBED in named and described.get(name, False))
        for name in recording.joints
    ]
    q = unwrapped(recording.t, recording.q, None, continuous)
    return recording if q is recording.q else dataclasses.replace(recording, q=q)


def _robot(
    motion: RecordedMotion, model: str, urdf: str, gravity: float | None, findings: list[Finding]
) -> RobotModel:
    """Return the model by arguments, the recording, or both."""
    controller, description = motion.controller, urdf or motion.description
    name = model or (
        'urdf' if urdf else controller.model if controller else 'urdf' if description else ''
    )
    if not name:
        raise UsageError(
            f'{motion.recording.name} has no robot description: give --urdf FILE, or '
            '--model; in Python urdf, or model'
        )
    if gravity is None:
        gravity = controller.gravity if controller else USUAL_GRAVITY
    gravity = GRAVITY.checked(gravity)
    locked = controller.locked if controller else ('',)
    positions, joints = locked_positions(locked), motion.recording.joints
    try:
        dynamics = make_model(name, gravity, joints, description, positions)
    except SingularInertia as refusal:
        rotors = _usual_rotors(description, refusal.joints)
        if len(rotors) < len(refusal.joints):
            raise
        description = with_rotors(description, rotors)
        dynamics = make_model(name, gravity, joints, description, positions)
        findings.append(
            Finding(
                Reason.ASSUMED_ROTORS,
                Severity.NOTE,
                values={
                    'rotors': {
                        joint: round_number(inertia, 2) for joint, inertia in rotors.items()
                    }
                },
            )
        )
    shared: dict[str, Any] = {'model': name, 'gravity': gravity}
    if any(locked):
        shared['locked'] = list(locked)
    if (
        controller
        and controller.joint_names == joints
        and (controller.continuous_joints != (DESCRIBED,))
    ):
        shared['continuous_joints'] = list(controller.continuous_joints)
    return RobotModel(
        dynamics,
        {ROBOT: description} if name == 'urdf' else {},
        positions,
        shared,
        (controller.kp, controller.kv) if controller else None,
        _recorded_limits(controller, joints),
    )


def _recorded_limits(
    controller: ControllerConfig | None, joints: Sequence[str]
) -> dict[str, Any]:
    """Return the limits that the controller of a recording had, by parameter."""
    if controller is None or controller.joint_names != joints:
        return {}
    limits = {name: getattr(controller, name) for name in _LIMITS}
    return {name: list(values) for name, values in limits.items() if min(values) < inf}


def _usual_rotors(description: str, joints: Sequence[str]) -> dict[str, float]:
    """Return usual rotor inertias, by the effort limits [kg·m²]."""
    described = Tree(description).joints
    return {
        name: ASSUMED_ROTOR * described[name].effort
        for name in joints
        if described[name].effort < inf
    }


def write_identified(
    identified: IdentifiedRobot,
    out: str | Path,
    trials: int | None = None,
    show: Callable[[str], None] = print,
    extra: str = 'svg',
    command: str = '',
    overwrite: bool = False,
) -> IdentifiedRobot:
    """
    Try the gains in simulation, and write all files.

    Parameters
    ----------
    identified : IdentifiedRobot
        As `identify` returns it.
    out : str or Path
        Directory for ``identified.yaml``, which `simulate` and all nodes take, ``identify.json``,
        ``figures``, ``index.html`` and the URDF. The parameter file is not written if a joint is
        not usable (`IdentifiedRobot.missing`).
    trials : int, optional
        Robots within the intervals on which the gains are tried, by default 24, or 8 without
        numba. With 0 none are tried.
    show : callable
        Takes lines about what is compiled for them.
    extra : {'svg', 'pdf', 'png'}
        A second format for each figure.
    command : str
        The command, for the page.
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
        trials = COMPILED_COUNT if has_compiler() else PLAIN_COUNT
    checked_integer('trials', trials, 0)
    with new_folder(Path(out), IDENTIFY, overwrite) as folder:
        for name, text in identified.robot.files.items():
            write_text(folder / name, text)
        tried = _tried(identified, folder, trials, show)
        if not tried.missing:
            for directory in (folder, Path(out)):  # The first one is there to be read.
                values = tried.parameters(directory)
                values['controller'] |= tried.robot.limits
                parameter_file.dump(values, folder / VALUES)
                if directory is folder:
                    parameter_file.load(folder / VALUES)
        write_json(tried.results.as_mapping(), folder / JSON)
        _write_page(tried, folder, extra, command)
    return tried


def _tried(
    identified: IdentifiedRobot, folder: Path, trials: int, show: Callable[[str], None]
) -> IdentifiedRobot:
    """
    Return the robot with the gains that survive the trials.

    Its URDF is in a folder.
    """
    if not trials or identified.missing:
        return identified
    results = identified.results
    setups = setups_tried(
        results.recommended, identified.parameters(folder), identified.robot.gains
    )
    compile_setups(setups, show)
    return dataclasses.replace(
        identified,
        results=dataclasses.replace(
            results,
            recommended=trial_runs(
                results.found, results.run, results.recommended, setups, trials
            ),
        ),
    )


def _write_page(identified: IdentifiedRobot, folder: Path, extra: str, command: str) -> None:
    """Write figures and page."""
    from ctc_chattering.analysis.drawing import save  # Takes time.
    from ctc_chattering.identification.figures import friction_figure, torque_figure

    results = identified.results
    words = {VALUES: 'parameter file', JSON: 'all numbers', CORRECTED: 'corrected URDF'}
    files = {name: content for name, content in words.items() if (folder / name).exists()}
    figures = save(
        [
            torque_figure(results.found, results.verdicts),
            friction_figure(results.found, results.verdicts),
        ],
        folder / FIGURES,
        ('svg', extra),
    )
    write_page(results, figures, folder / PAGE, files, command)
