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
`ctc new-robot`, `check-model`, `export-c` and `parameters`: robots and their parameters.

`new-robot` and `check-model` read a URDF. They print what they took from it and what it lacks.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
import textwrap
from typing import TYPE_CHECKING

from ctc_chattering.analysis.tables import fitted, one_line
from ctc_chattering.cli.options import (
    add_declared,
    add_loop_options,
    add_number,
    add_overrides,
    add_overwrite,
    add_urdf_options,
    load_setup,
)
from ctc_chattering.configuration.arm_knowledge import (
    ArmFacts,
    ArmKnowledge,
    PAYLOAD,
    RESONANCE,
    ROTOR,
    TORQUE_RATE,
)
from ctc_chattering.configuration.node_parameters import parameter_table
from ctc_chattering.errors import as_usage_error, CtcError, UsageError
from ctc_chattering.number_format import format_count, format_numbers
from ctc_chattering.output_files import check_file, write_text
from ctc_chattering.output_folder import check_folder
from ctc_chattering.parameters import Parameter

if TYPE_CHECKING:
    from ctc_chattering.configuration.new_robot import NewRobot
    from ctc_chattering.dynamics.urdf_parser import Tree

_CENTER = Parameter('center', 'float[]', None, 'Centre of the motion, one position per joint. '
                    'Default: a posture in which every joint carries its weight', 'rad')
_COMMENT = """\
# Written by `ctc new-robot` from {location}.
{lines}
# ka of the controller must exceed the friction of the real robot plus the error of the model.
# For the friction it has {ka:.0%} of the effort limit, or more if the URDF has more friction.
# For the error of the model it has a fifth of the model's torque.
# Set actuator_lag, torque_rate_limit and input_delay to the values of your drives.
# estimator_bandwidth suits encoders of at most {fine:g} rad. Halve it for coarser encoders.
"""


def new_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc new-robot`."""
    add_urdf_options(parser, required=True,
                     default='the longest chain without its end effector')
    parser.add_argument('--tip', default='', metavar='LINK',
                        help='Last link of the arm. The joints are those between the root and '
                             'this link.')
    add_declared(parser, _CENTER)
    for spec in (ROTOR, TORQUE_RATE, RESONANCE, PAYLOAD):
        add_declared(parser, spec)
    parser.add_argument('--out', type=Path, metavar='F', default=Path('robot.yaml'),
                        help='Parameter file to write. Default: robot.yaml.')
    add_overwrite(parser)


def run_new_robot(options: argparse.Namespace) -> int:
    """Run `ctc new-robot`."""
    from ctc_chattering.configuration import parameter_file
    from ctc_chattering.configuration.compilation import has_compiler
    from ctc_chattering.configuration.new_robot import KA, new_robot
    from ctc_chattering.control.recommended_gains import FINE_RESOLUTION
    from ctc_chattering.runs.arm_margins import arm_lines, arm_margins, with_stable_gains

    if options.joints and options.tip:
        raise UsageError('--tip and --joints both select the joints; give only one of them')
    location = options.urdf if '://' in options.urdf else str(Path(options.urdf).resolve())
    facts = ArmFacts(options.rotor_inertia or (), options.torque_rate or (), options.resonance,
                     options.payload)
    out = options.out
    check_file(out, options.overwrite)
    with as_usage_error(('joint_names', 'tip', 'center', 'rotor_inertia', 'torque_rate')):
        robot = with_stable_gains(new_robot(
            location, options.joints, options.gravity, options.tip, options.center or (), facts))
    margins = arm_margins(parameter_file.load(None, robot.values))
    lines = [one_line(line) for line in _described(robot, bool(options.center))]
    lines += arm_lines(margins) if margins else ()
    comment = '\n'.join(textwrap.fill(
        line, 99, initial_indent='# ', subsequent_indent='#   ') for line in lines)
    write_text(out, _COMMENT.format(location=one_line(location), lines=comment, ka=KA,
                                    fine=FINE_RESOLUTION)
               + parameter_file.to_text(robot.values))
    print('\n'.join(lines))
    compilation = f'ctc compile {out}, ' if has_compiler() else ''
    print(f'wrote {out}; next: {compilation}ctc simulate {out}, bringup {out}')
    return 0


def _described(robot: NewRobot, center_given: bool) -> Iterator[str]:
    """Yield lines about the joints, limits and friction taken from a URDF."""
    yield f'joints: {", ".join(robot.joints)}'
    if robot.held:
        yield ('left out, and held at 0 unless the parameter `locked` gives another position: '
               f'{", ".join(robot.held)}')
    yield from _mimicked(robot.tree.leaders)
    yield from _unexpanded(robot.tree.unexpanded)
    if robot.unlimited:
        yield (f'no usable effort limit (0, inf or missing) for {", ".join(robot.unlimited)}; set '
               'effort_limit of the controller')
    yield _center_line(robot, center_given)
    yield from _friction_lines(robot)
    yield from fitted(list(robot.knowledge.rows()), 0)
    yield from robot.knowledge.lines()


def _center_line(robot: NewRobot, center_given: bool) -> str:
    """Return a line about the centre of the motion."""
    motion = robot.motion
    reason = 'as given' if center_given else 'the middle of the limits'
    if motion.about_middle:
        reason = (f'not the middle of the limits, where {motion.about_middle.joint.name} would '
                  f'need {motion.about_middle}')
    smaller = ''
    if motion.size < 1.0:
        smaller = f'; amplitude and frequency are reduced to {motion.size:g} times the usual ones'
    center = ', '.join(f'{x:.4g}' for x in motion.center)
    return f'center of the motion: {center}, {reason}{smaller}; collisions are not checked'


def _friction_lines(robot: NewRobot) -> Iterator[str]:
    """Yield lines about the source of the plant's friction."""
    from ctc_chattering.configuration.new_robot import (
        FRICTION,
        LARGEST_FRICTION,
        LEAST_STOPPING_TIME,
    )

    friction = robot.friction
    assumed = tuple(x for x in robot.joints if x not in friction.coulomb_described)
    for names, origin in (
            (friction.coulomb_described, 'Coulomb friction taken from <dynamics friction>'),
            (friction.viscous_described, 'viscous friction taken from <dynamics damping>'),
            (assumed, f'Coulomb friction assumed, {FRICTION:.0%} of the torque that the model '
             'needs'),
            (friction.implausible, 'friction in <dynamics> ignored as implausible, because it '
             f'exceeds the torque that the model needs or {LARGEST_FRICTION:.0%} of the effort '
             f'limit, or stops the bodies within {LEAST_STOPPING_TIME * 1e3:g} ms')):
        if names:
            yield f'{origin}: {"all joints" if names == robot.joints else ", ".join(names)}'


def _mimicked(leaders: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield a line about joints that others mimic, if there are any."""
    if leaders:
        joints = (f'{name} ({", ".join(followers)})' for name, followers in leaders.items())
        yield f'left out, because other joints mimic them: {", ".join(joints)}'


def _unexpanded(macros: Sequence[str]) -> Iterator[str]:
    """Yield a line about macros that xacro has left in a URDF, if there are any."""
    if macros:
        yield (f'ignored: {", ".join(macros)}; xacro did not know these macros, so their links '
               'and joints are missing')


def check_model_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc check-model`."""
    parser.add_argument(
        '--model', metavar='NAME',
        help='Robot model: two_link, urdf, or your own as package.module:Name. Default: urdf if '
             '--urdf is given, else two_link.')
    add_urdf_options(parser)
    add_number(parser, '--samples', 'Number of random states', 100, minimum=1)
    add_number(parser, '--seed', 'Seed of the random states', 0, minimum=0)


def run_check_model(options: argparse.Namespace) -> int:
    """Run `ctc check-model`."""
    from ctc_chattering.analysis.tables import print_columns
    from ctc_chattering.configuration.package_share import read_description
    from ctc_chattering.dynamics.model_check import check_dynamics, inertia_faults
    from ctc_chattering.dynamics.registry import make_model
    from ctc_chattering.dynamics.urdf_parser import Tree
    from ctc_chattering.parameters import check_joint_names

    name = options.model or ('urdf' if options.urdf else 'two_link')
    if (name == 'urdf') != (options.urdf is not None):
        raise UsageError(
            f'the model {name} {"needs" if name == "urdf" else "takes no"} --urdf FILE')
    urdf = read_description(options.urdf) if options.urdf else ''
    tree = Tree(urdf) if urdf else None
    joints = options.joints or (tree.movable if tree else ('joint1', 'joint2'))
    if not joints:
        raise CtcError('the description has no movable joint; check the URDF')
    with as_usage_error(('joint_names', 'model')):
        check_joint_names(joints)
        model = make_model(name, options.gravity, joints, urdf)
    print(f'model {name} with {format_count(model.n, "joint")}: {", ".join(joints)}')
    for line in _mimicked(tree.leaders) if tree and not options.joints else ():
        print(line)
    findings = check_dynamics(model, options.seed, options.samples)
    print_columns([('', 'worst', 'allowed', 'check')] + [
        ('ok' if x.passed else 'FAILED', f'{x.worst:.2g}', f'{x.tolerance:.2g}', x.name)
        for x in findings])
    failed = [x for x in findings if not x.passed]
    for x in failed:
        error = f': {x.error}' if x.error else ''
        print(f'{x.name}: the worst state is q = {format_numbers(x.q)}, '
              f'dq = {format_numbers(x.dq)}{error}')
    for fault in inertia_faults(urdf, joints) if urdf else ():
        print(f'warning: {fault}')
    for line in _unexpanded(tree.unexpanded if tree else ()):
        print(f'warning: {line}')
    if tree:
        _print_knowledge(tree, joints)
    return 1 if failed else 0


def _print_knowledge(tree: Tree, joints: Sequence[str]) -> None:
    """Print drive data that a URDF gives besides its bodies, and data that it lacks."""
    knowledge = ArmKnowledge.from_urdf(tree, joints)
    print('`ctc new-robot` also uses these data of the drives:')
    print('\n'.join(fitted(list(knowledge.rows()))))
    print('\n'.join(f'  {line}' for line in knowledge.lines()))


def export_c_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc export-c`."""
    add_loop_options(parser)
    add_overrides(parser, 'switching')
    parser.add_argument('--processor', default='host', metavar='CPU',
                        help='Processor as llc -mcpu names it, for example x86-64-v3. Default: '
                             'the processor of this computer.')
    parser.add_argument('--ros2-control', default='', metavar='NAME',
                        help='Name of an ament_cmake package with a ros2_control controller, to '
                             'be written around the library.')
    parser.add_argument('--out', type=Path, metavar='DIR', required=True, help='Output directory.')
    add_overwrite(parser, 'the output of an earlier run of this command')


def run_export_c(options: argparse.Namespace) -> int:
    """Run `ctc export-c`."""
    from ctc_chattering.c_export.library import EXPORT, export
    from ctc_chattering.dynamics.registry import model_of

    setup, out = load_setup(options), options.out
    config = setup.controller
    check_folder(out, EXPORT, options.overwrite)
    size = export(config, model_of(config, setup.descriptions.get('controller', '')), out,
                  options.processor, options.ros2_control, options.overwrite)
    joints = format_count(len(config.joint_names), 'joint')
    print(f'wrote {out}: law {config.law} for {joints}, {size} bytes of code; '
          'next: see docs/ros2_control.md')
    return 0


def parameters_options(_parser: argparse.ArgumentParser) -> None:
    """Add no option."""


def run_parameters(_options: argparse.Namespace) -> int:
    """Run `ctc parameters`."""
    print(parameter_table())
    return 0
