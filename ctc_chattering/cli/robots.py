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

"""`ctc new-robot`, `check-model`, `export-c`, `parameters`: robots, and what is set of them."""

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
from ctc_chattering.number_format import format_numbers
from ctc_chattering.output_files import check_file, write_text
from ctc_chattering.output_folder import check_folder
from ctc_chattering.parameters import Parameter

if TYPE_CHECKING:
    from ctc_chattering.configuration.new_robot import NewRobot
    from ctc_chattering.dynamics.urdf_parser import Tree

_CENTER = Parameter('center', 'float[]', None, 'Centre of the motion, one position per joint; '
                    'default: where every joint carries its weight', 'rad')
_COMMENT = """\
# By `ctc new-robot` from {location}.
{lines}
# ka of the controller must exceed the friction of the real robot and the error of the model; it
# is {ka:.0%} of the effort limit, or what exceeds the friction of the URDF, for the one, and a
# fifth of the model's torque for the other.
# Set what is known of the drives: actuator_lag, torque_rate_limit and input_delay.
# estimator_bandwidth is for encoders of at most {fine:g} rad; halve it for coarser ones.
"""


def new_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc new-robot`."""
    add_urdf_options(parser, required=True,
                     default='those of the longest chain, without its end effector')
    parser.add_argument('--tip', default='', metavar='LINK',
                        help='end of the arm: joints between the root and this link')
    add_declared(parser, _CENTER)
    for spec in (ROTOR, TORQUE_RATE, RESONANCE, PAYLOAD):
        add_declared(parser, spec)
    parser.add_argument('--out', type=Path, metavar='F', default=Path('robot.yaml'),
                        help='parameter file to write, default: robot.yaml')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing file')


def run_new_robot(options: argparse.Namespace) -> int:
    """
    Run `ctc new-robot`.

    It has a sinusoid at no more than half of the limits, about a posture in which every joint
    carries its weight, and law observer_feedback with the recommended gains. It says which joints
    and which friction it has taken. docs/robots.md says what to set next.
    """
    from ctc_chattering.configuration import parameter_file
    from ctc_chattering.configuration.new_robot import KA, new_robot
    from ctc_chattering.control.recommended_gains import FINE_RESOLUTION
    from ctc_chattering.runs.arm_margins import arm_lines, arm_margins, with_stable_gains

    if options.joints and options.tip:
        raise UsageError('--tip: not allowed with --joints')
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
    print(f'wrote {out}; next: ctc compile {out}, ctc simulate {out}, bringup {out}')
    return 0


def _described(robot: NewRobot, center_given: bool) -> Iterator[str]:
    """Yield lines that say what was taken of a URDF, and what was not."""
    yield f'joints: {", ".join(robot.joints)}'
    if robot.held:
        yield f'left out, at 0 unless `locked` says otherwise: {", ".join(robot.held)}'
    yield from _mimicked(robot.tree.leaders)
    yield from _unexpanded(robot.tree.unexpanded)
    if robot.unlimited:
        yield (f'without effort limit, which is 0, inf or missing: {", ".join(robot.unlimited)}; '
               'set effort_limit of the controller')
    yield _center_line(robot, center_given)
    yield from _friction_lines(robot)
    yield from fitted(list(robot.knowledge.rows()), 0)
    yield from robot.knowledge.lines()


def _center_line(robot: NewRobot, given: bool) -> str:
    """Return what the motion is about."""
    motion = robot.motion
    about = 'as given' if given else 'the middle of the limits'
    if motion.about_middle:
        about = (f'not the middle of the limits, where {motion.about_middle.joint.name} would '
                 f'take {motion.about_middle}')
    smaller = f'; amplitude and frequency times {motion.size:g}' if motion.size < 1.0 else ''
    center = ', '.join(f'{x:.4g}' for x in motion.center)
    return f'center: {center}; {about}{smaller}; collisions are not checked'


def _friction_lines(robot: NewRobot) -> Iterator[str]:
    """Yield where the friction of the plant is from."""
    from ctc_chattering.configuration.new_robot import (
        FRICTION,
        LARGEST_FRICTION,
        LEAST_STOPPING_TIME,
    )

    friction = robot.friction
    assumed = tuple(x for x in robot.joints if x not in friction.coulomb_described)
    for names, origin in (
            (friction.coulomb_described, 'Coulomb friction of the plant from <dynamics friction>'),
            (friction.viscous_described, 'viscous friction of the plant from <dynamics damping>'),
            (assumed, f'Coulomb friction of the plant assumed, {FRICTION:.0%} of the torque that '
             'the model takes'),
            (friction.implausible, 'not taken from <dynamics>, being more than the torque that '
             f'the model takes, or {LARGEST_FRICTION:.0%} of the effort limit, or a damping that '
             f'stops these bodies within {LEAST_STOPPING_TIME * 1e3:g} ms')):
        if names:
            yield f'{origin}: {"all joints" if names == robot.joints else ", ".join(names)}'


def _mimicked(leaders: Mapping[str, Sequence[str]]) -> Iterator[str]:
    """Yield a line about joints that others mimic; nothing without any."""
    if leaders:
        words = (f'{name} ({", ".join(followers)})' for name, followers in leaders.items())
        yield f'left out, because others mimic them: {", ".join(words)}'


def _unexpanded(macros: Sequence[str]) -> Iterator[str]:
    """Yield a line about macros that xacro has left in a URDF; nothing without any."""
    if macros:
        yield f'ignored: {", ".join(macros)}: xacro had no such macro, so what it makes is missing'


def check_model_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc check-model`."""
    parser.add_argument(
        '--model', metavar='NAME',
        help='two_link, urdf, or package.module:Name; default: urdf if --urdf is given, else '
             'two_link')
    add_urdf_options(parser)
    add_number(parser, '--samples', 'number of states', 100, minimum=1)
    add_number(parser, '--seed', 'seed of the states', 0, minimum=0)


def run_check_model(options: argparse.Namespace) -> int:
    """
    Run `ctc check-model`.

    At random states: M symmetric and positive definite, ½ dM/dt - C skew-symmetric, G a gradient,
    all products consistent. Status 1 if a test fails.
    """
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
        raise CtcError('the description has no joint that moves')
    with as_usage_error(('joint_names', 'model')):
        check_joint_names(joints)
        model = make_model(name, options.gravity, joints, urdf)
    print(f'{name}, {model.n} joints: {", ".join(joints)}')
    for line in _mimicked(tree.leaders) if tree and not options.joints else ():
        print(line)
    findings = check_dynamics(model, options.seed, options.samples)
    print_columns([('', 'worst', 'allowed', 'check')] + [
        ('ok' if x.passed else 'FAILED', f'{x.worst:.2g}', f'{x.tolerance:.2g}', x.name)
        for x in findings])
    failed = [x for x in findings if not x.passed]
    for x in failed:
        print(f'{x.name}: worst at q = {format_numbers(x.q)}, dq = {format_numbers(x.dq)}'
              + (f': {x.error}' if x.error else ''))
    for fault in inertia_faults(urdf, joints) if urdf else ():
        print(f'warning: {fault}')
    for line in _unexpanded(tree.unexpanded if tree else ()):
        print(f'warning: {line}')
    if tree:
        _print_knowledge(tree, joints)
    return 1 if failed else 0


def _print_knowledge(tree: Tree, joints: Sequence[str]) -> None:
    """Print what a URDF says of the arm besides its bodies, and what it lacks."""
    knowledge = ArmKnowledge.from_urdf(tree, joints)
    print('what `ctc new-robot` takes besides the bodies:')
    print('\n'.join(fitted(list(knowledge.rows()))))
    print('\n'.join(f'  {line}' for line in knowledge.lines()))


def export_c_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc export-c`."""
    add_loop_options(parser)
    add_overrides(parser, 'switching')
    parser.add_argument('--processor', default='host', metavar='CPU',
                        help='as llc -mcpu names it, such as x86-64-v3; default: this one')
    parser.add_argument('--ros2-control', default='', metavar='NAME',
                        help='write an ament_cmake package of this name around the library')
    parser.add_argument('--out', type=Path, metavar='DIR', required=True,
                        help='directory to write')
    parser.add_argument('--overwrite', action='store_true',
                        help='replace the output of an earlier run of this command')


def run_export_c(options: argparse.Namespace) -> int:
    """
    Run `ctc export-c`.

    The library runs in hard real time, without Python, and answers a state with the torque of
    this package to the last bit. docs/ros2_control.md has both.
    """
    from ctc_chattering.c_export.library import EXPORT, export
    from ctc_chattering.dynamics.registry import model_of

    setup, out = load_setup(options), options.out
    config = setup.controller
    check_folder(out, EXPORT, options.overwrite)
    size = export(config, model_of(config, setup.descriptions.get('controller', '')), out,
                  options.processor, options.ros2_control, options.overwrite)
    print(f'wrote {out}: {config.law}, {len(config.joint_names)} joints, {size} bytes of code; '
          'next: see docs/ros2_control.md')
    return 0


def parameters_options(_parser: argparse.ArgumentParser) -> None:
    """Add no option."""


def run_parameters(_options: argparse.Namespace) -> int:
    """
    Run `ctc parameters`.

    As a Markdown table.
    """
    print(parameter_table())
    return 0
