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

"""`ctc check-model`: the tests of a model, and its table."""

from __future__ import annotations

import argparse

from ctc_chattering.analysis.tables import measured, print_columns
from ctc_chattering.cli.options import add_urdf_options, check
from ctc_chattering.configuration.package_share import read_description
from ctc_chattering.dynamics.model_check import check_dynamics, inertia_faults
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, given_by_user, UsageError
from ctc_chattering.parameters import check_joint_names

DETAILS = ('At random states: M symmetric and positive definite, ½ dM/dt - C skew-symmetric, G a '
           'gradient, all products consistent. Status 1 if a test fails.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc check-model`."""
    parser.add_argument(
        '--model', metavar='NAME',
        help='two_link, urdf, or package.module:Name; default: urdf if --urdf is given, else '
             'two_link')
    add_urdf_options(parser)
    parser.add_argument('--samples', type=int, default=100, metavar='N',
                        help='number of states, default: 100')
    parser.add_argument('--seed', type=int, default=0, metavar='S',
                        help='seed of the states, default: 0')


def run(options: argparse.Namespace) -> int:
    """Run `ctc check-model`."""
    check('--samples', options.samples, 1)
    check('--seed', options.seed, 0)
    check('--gravity', options.gravity, 0)
    name = options.model or ('urdf' if options.urdf else 'two_link')
    if (name == 'urdf') != (options.urdf is not None):
        raise UsageError(
            f'the model {name} {"needs" if name == "urdf" else "takes no"} --urdf FILE')
    urdf = read_description(options.urdf) if options.urdf else ''
    with given_by_user(('joint_names', 'model')):
        joints = _joints(options.joints, urdf)
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


def _joints(option: str | None, urdf: str) -> tuple[str, ...]:
    """Return the joints that the option names, by default all of the robot that can move."""
    joints: tuple[str, ...] = ('joint1', 'joint2')
    if option is not None:
        joints = tuple(x.strip() for x in option.split(','))
    elif urdf:
        joints = Tree(urdf).movable
        if not joints:
            raise CtcError('the description has no joint that moves')
    check_joint_names(joints)
    return joints
