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
from pathlib import Path

from ctc_chattering.cli.options import (
    add_loop_options,
    add_number,
    add_overrides,
    add_urdf_options,
    load_setup,
)
from ctc_chattering.configuration.node_parameters import parameter_table
from ctc_chattering.errors import CtcError, given_by_user, UsageError
from ctc_chattering.output_files import check_file, check_folder, write_text

_COMMENT = """\
# By `ctc new-robot` from {location}.
# Assumed: coulomb_friction of the plant, {friction:.0%} of the torque that the model takes.
# ka of the controller must exceed the friction of the real robot and the error of the model; it
# is {ka:.0%} of the effort limit for the one, and a fifth of the model's torque for the other.
# Set what is known of the drives: actuator_lag, torque_rate_limit and input_delay.
"""


def new_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc new-robot`."""
    add_urdf_options(parser, required=True)
    parser.add_argument('--out', type=Path, metavar='F', default=Path('robot.yaml'),
                        help='parameter file to write, default: robot.yaml')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing file')


def run_new_robot(options: argparse.Namespace) -> int:
    """
    Run `ctc new-robot`.

    It has a sinusoid around the middle of the limits, at no more than half of them, law
    observer_feedback with the recommended gains, and a friction that is assumed. docs/robots.md
    says what to set next.
    """
    from ctc_chattering.configuration import parameter_file
    from ctc_chattering.configuration.new_robot import FRICTION, KA, new_robot

    location = options.urdf if '://' in options.urdf else str(Path(options.urdf).resolve())
    out = options.out
    check_file(out, options.overwrite)
    values = new_robot(location, options.joints, options.gravity)
    comment = _COMMENT.format(location=location, friction=FRICTION, ka=KA)
    write_text(out, comment + parameter_file.to_text(values))
    print(f'wrote {out}; next: ctc compile {out}, ctc simulate {out}, bringup {out}')
    return 0


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
    from ctc_chattering.analysis.tables import measured, print_columns
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
    joints = options.joints or (Tree(urdf).movable if urdf else ('joint1', 'joint2'))
    if not joints:
        raise CtcError('the description has no joint that moves')
    with given_by_user(('joint_names', 'model')):
        check_joint_names(joints)
        model = make_model(name, options.gravity, joints, urdf)
    print(f'{name}, {model.n} joints: {", ".join(joints)}')
    findings = check_dynamics(model, options.seed, options.samples)
    print_columns([('', 'worst', 'allowed', 'check')] + [
        ('ok' if x.passed else 'FAILED', f'{x.worst:.2g}', f'{x.tolerance:.2g}', x.name)
        for x in findings])
    failed = [x for x in findings if not x.passed]
    for x in failed:
        print(f'{x.name}: worst at q = {measured(list(x.q))}, dq = {measured(list(x.dq))}'
              + (f': {x.error}' if x.error else ''))
    for fault in inertia_faults(urdf, joints) if urdf else ():
        print(f'warning: {fault}')
    return 1 if failed else 0


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
