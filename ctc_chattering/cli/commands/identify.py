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

"""`ctc identify`: from bags to friction, delays, errors of the model and gains."""

from __future__ import annotations

import argparse
from collections.abc import Callable
import dataclasses
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.analysis.output import prepare, write_text, writing
from ctc_chattering.analysis.result import write_json
from ctc_chattering.analysis.tables import paragraph
from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.effort_options import add_effort_options, declared, in_torques
from ctc_chattering.cli.options import add_format, add_output, numbers
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.robot_description import read_description
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import locked_positions, make_model
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.identification.regression.model_errors import candidates, ModelError
import numpy as np

if TYPE_CHECKING:
    from ctc_chattering.bags.motion import RecordedMotion
    from ctc_chattering.identification.regression.identify import Identification
    from ctc_chattering.identification.report.recommendation import Recommendation
    from ctc_chattering.identification.report.results import IdentificationResults

DETAILS = ('From bags of any recorder, with intervals of 95 %. Write identified.yaml, '
           'identify.json, figures and index.html.')
#: Names in the output directory.
_PAGE, _JSON, _VALUES, _ROBOT, _CORRECTED, _FIGURES = (
    'index.html', 'identify.json', 'identified.yaml', 'robot.urdf', 'corrected.urdf', 'figures')
#: Acceleration of gravity where nothing says otherwise [m/s²].
_GRAVITY = 9.81


@dataclasses.dataclass(frozen=True)
class _IdentifiedRobot:
    """
    The model, its errors that are looked for, and values of all nodes.

    `files` are descriptions by name; the last one is that of the model.
    """

    model: Model
    candidates: list[ModelError]
    files: dict[str, str]
    locked: dict[str, float]
    shared: dict[str, Any]
    gains: tuple[Any, Any] | None


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc identify`."""
    parser.add_argument('bags', nargs='+', type=Path, metavar='BAG', help='bag of the robot')
    parser.add_argument('--validate', type=Path, metavar='BAG',
                        help='bag that is not used for the fit, and predicted')
    parser.add_argument('--urdf', metavar='FILE',
                        help="the URDF, a path or package://NAME/PATH; by default the bag's")
    parser.add_argument('--model', metavar='NAME',
                        help="two_link, urdf, or package.module:Class; by default the bag's")
    parser.add_argument('--joints', metavar='A,B,C',
                        help="joints in the order of the commands; by default the bag's")
    parser.add_argument('--gravity', type=float, metavar='G',
                        help="by default the bag's, or 9.81 [m/s²]")
    parser.add_argument('--torque', choices=('command', 'effort'),
                        help='where torques are taken from; by default what explains more')
    add_effort_options(parser)
    parser.add_argument('--states', default='joint_states', metavar='TOPIC',
                        help='topic of the joint states, joint_states by default, or the only '
                             'one that fits')
    parser.add_argument('--commands', default='effort_controller/commands', metavar='TOPIC',
                        help='topic of the commanded torques, effort_controller/commands by '
                             'default, or the only one that fits; TOPIC:FIELD for a field of any '
                             'message')
    parser.add_argument('--torque-rate', metavar='R',
                        help='rate that the drives allow, one number or one for each joint '
                             '[N·m/s]')
    parser.add_argument('--trials', type=int, metavar='N',
                        help='robots within the intervals on which gains are tried in '
                             'simulation, 24 by default, or 8 without numba; 0 for none')
    parser.add_argument('--seed', type=int, default=1, help='of the trials, 1 by default')
    add_format(parser)
    add_output(parser, 'identified')


def run(options: argparse.Namespace) -> int:
    """Run `ctc identify`."""
    from ctc_chattering.bags.motion import read_motion
    from ctc_chattering.identification.regression.identify import identify
    from ctc_chattering.identification.report.perturbation import perturbation
    from ctc_chattering.identification.report.recommendation import recommend
    from ctc_chattering.identification.report.results import IdentificationResults
    from ctc_chattering.identification.report.validation import validate

    for name in ('trials', 'seed'):
        if (getattr(options, name) or 0) < 0:
            raise UsageError(f'--{name}: {getattr(options, name)} is not allowed; allowed: 0 or '
                             'more')
    side = declared(options)
    description = read_description(options.urdf) if options.urdf else ''
    joints = tuple(filter(None, (options.joints or '').split(',')))
    motions = [read_motion(bag, joints, description, options.states, options.commands)
               for bag in (*options.bags, *filter(None, [options.validate]))]
    notes = [note for motion in motions for note in motion.notes]
    for note in notes:
        say(note)
    *recordings, last = in_torques([motion.recording for motion in motions], options)
    recordings += [] if options.validate else [last]
    robot = _robot(options, motions[0], description)
    rate = _rates(options.torque_rate, len(recordings[0].joints))
    names = (_PAGE, _JSON, _VALUES, _ROBOT, _CORRECTED, _FIGURES)
    out = prepare(options.out, names, options.overwrite)
    found = identify(recordings, robot.model, robot.candidates, options.torque or '', side)
    found, robot = _corrected(found, robot, lambda x: identify(
        recordings, x.model, x.candidates, options.torque or '', side))
    found = dataclasses.replace(found, findings=(*found.findings, *(
        Finding(Severity.NOTE, ALL_JOINTS, note) for note in notes)))
    perturbed = perturbation(found)
    q = recordings[0].q if len(recordings) == 1 else np.concatenate([x.q for x in recordings])
    recommended = recommend(found, perturbed, robot.model, q, rate)
    validation = validate(found, last, robot.model) if options.validate else None
    results = IdentificationResults(', '.join(bag.resolve().name for bag in options.bags), found,
                                    perturbed, recommended, validation, rate)
    return _written(results, robot, q, out, options)


def _written(results: IdentificationResults, robot: _IdentifiedRobot, q: Any, out: Path,
             options: argparse.Namespace) -> int:
    """Try the gains, write all files, and print what was found."""
    for name, text in robot.files.items():
        write_text(out / name, text)
    if not _missing(results):
        results = _tried(results, robot, q, out, options)
    missing = _missing(results)
    _write(results, robot, q, bool(missing), options)
    print(results.text())
    print()
    if missing:
        print(f'{_VALUES} is not written, since it would have no gains of all joints:')
        for line in missing:
            print('\n'.join(paragraph(line)))
        print_page(out / _PAGE)
    else:
        print_page(out / _PAGE, f'ctc simulate --params-file {out / _VALUES}')
    if not any(x.usable for x in results.verdicts):
        raise CtcError(f'no joint is usable: why, and what to record, is in {out / _PAGE}')
    return 0


def _missing(report: IdentificationResults) -> list[str]:
    """Return for each joint that is not usable which gains are missing, and what to record."""
    from ctc_chattering.identification.report.parameter_values import missing_gains

    return missing_gains(report.verdicts)


def _tried(report: IdentificationResults, robot: _IdentifiedRobot, q: Any, out: Path,
           options: argparse.Namespace) -> IdentificationResults:
    """Return the results with gains that survive trial runs, which are compiled if they can be."""
    from ctc_chattering.analysis.compilation import compile_setups, has_compiler
    from ctc_chattering.identification.report.trial_runs import (
        COUNT,
        COUNT_PLAIN,
        setups_tried,
        trial_runs,
    )

    count = options.trials
    if count is None:
        count = COUNT if has_compiler() else COUNT_PLAIN
    if not count:
        return report

    def values(recommended: Recommendation) -> dict[str, dict[str, Any]]:
        return _values(report.found, recommended, robot, q, out)
    compile_setups(setups_tried(report.recommended, values), say)
    tried = trial_runs(report.found, report.run, report.recommended, values, robot.gains,
                       count, options.seed)
    return dataclasses.replace(report, recommended=tried)


def _values(found: Identification, recommended: Recommendation, robot: _IdentifiedRobot, q: Any,
            out: Path) -> dict[str, dict[str, Any]]:
    """Return the values of the parameter file."""
    from ctc_chattering.identification.report.parameter_values import parameter_values

    shared = dict(robot.shared)
    if robot.files:
        shared['description'] = str((out / list(robot.files)[-1]).resolve())
    return parameter_values(found, recommended, robot.model, q, shared, robot.gains)


def _robot(options: argparse.Namespace, motion: RecordedMotion, description: str
           ) -> _IdentifiedRobot:
    """Return the model for a motion, from the options, the bag, or both."""
    controller = motion.controller
    description = description or motion.description
    name = options.model or ('urdf' if options.urdf else controller.model if controller else
                             'urdf' if description else '')
    if not name:
        raise UsageError('the bag has no robot description: give --urdf FILE, or --model')
    gravity = options.gravity
    if gravity is None:
        gravity = controller.gravity if controller else _GRAVITY
    locked = controller.locked if controller else ('',)
    joints = motion.recording.joints
    positions = locked_positions(locked)
    model = make_model(name, gravity, joints, description, positions)
    shared: dict[str, Any] = {'model': name, 'gravity': gravity}
    if any(locked):
        shared['locked'] = list(locked)
    used = description if name == 'urdf' else ''
    return _IdentifiedRobot(model, candidates(model, used, positions),
                            {_ROBOT: used} if used else {}, positions, shared,
                            (controller.kp, controller.kv) if controller else None)


def _corrected(found: Identification, robot: _IdentifiedRobot,
               again: Callable[[_IdentifiedRobot], Identification]
               ) -> tuple[Identification, _IdentifiedRobot]:
    """Return both with a corrected URDF, if the model is clearly wrong and this is better."""
    from ctc_chattering.identification.report.corrected_model import (
        corrected_description,
        with_correction,
    )

    text = corrected_description(found, robot.files.get(_ROBOT, ''), robot.locked)
    if not text:
        return found, robot
    model = make_model('urdf', robot.shared['gravity'], found.joints, text, robot.locked)
    other = dataclasses.replace(
        robot, model=model, candidates=candidates(model, text, robot.locked),
        files={**robot.files, _CORRECTED: text})
    better = with_correction(found, again(other), _CORRECTED)
    return (found, robot) if better is None else (better, other)


def _rates(text: str | None, n: int) -> tuple[float, ...]:
    """Return the allowed rate of each joint [N·m/s] from the option; empty without."""
    if text is None:
        return ()
    return numbers('--torque-rate', text, n, 'above 0', lambda x: x > 0.0)


def _write(report: IdentificationResults, robot: _IdentifiedRobot, q: Any, refused: bool,
           options: argparse.Namespace) -> None:
    """Write all files; the parameter file not if a joint is refused."""
    from ctc_chattering.identification.report.identification_figures import (
        save_identification_figures,
    )
    from ctc_chattering.identification.report.results import write_page

    out, files = options.out, {_JSON: 'all numbers'}
    if _CORRECTED in robot.files:
        files[_CORRECTED] = 'corrected URDF'
    if not refused:
        files = {_VALUES: 'parameter file', **files}
        values = _values(report.found, report.recommended, robot, q, out)
        with writing(out / _VALUES):
            parameter_file.dump(values, out / _VALUES)
        try:
            parameter_file.load(out / _VALUES)
        except CtcError as error:
            raise CtcError(f'{out / _VALUES} needs a correction by hand: {error}') from None
    write_json(report.as_mapping(), out / _JSON)
    figures = save_identification_figures(report, out / _FIGURES, options.format)
    write_page(report, figures, out / _PAGE, files, options.said)
