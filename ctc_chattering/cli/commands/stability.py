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

"""`ctc stability`: what errors of model, lag and delay the loop of a parameter file stands."""

from __future__ import annotations

import argparse
import dataclasses
import json

from ctc_chattering.analysis.number_format import number_text
from ctc_chattering.analysis.output import finite, prepare, write_text
from ctc_chattering.analysis.tables import print_columns
from ctc_chattering.cli.options import add_output, add_params_file, load_setup
from ctc_chattering.control.controller import LAWS
from ctc_chattering.errors import given_by_user

DETAILS = ('For the sampled loop with constant M, without limits: by its poles for constant '
           'errors, by the small-gain theorem for varying ones. Exit status 1 if the loop is '
           'unstable for the exact model. docs/theory.md states the theorem and what it does '
           'not cover.')
_JSON, _FIGURES = 'stability.json', 'figures'


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc stability`."""
    add_params_file(parser)
    parser.add_argument('--law', metavar='X', help=f"instead of the file's: {' | '.join(LAWS)}")
    parser.add_argument('--control-period', type=float, metavar='S',
                        help="instead of the file's [s]")
    parser.add_argument('--lag', type=float, metavar='S',
                        help="true lag of all drives [s], instead of the plant's actuator_lag")
    parser.add_argument('--delay', type=int, metavar='N',
                        help="true delay in samples, instead of the plant's input_delay")
    add_output(parser)


def run(options: argparse.Namespace) -> int:
    """Run `ctc stability`."""
    from ctc_chattering.robustness.stability.margins import loops_of
    from ctc_chattering.robustness.stability.report import as_json, margins, region, rows

    _, _, setup = load_setup(options)
    config, drives = setup.controller, {
        name: value for name, value in (('actuator_lag', options.lag),
                                        ('input_delay', options.delay)) if value is not None}
    with given_by_user(drives):
        plant = setup.plant.changed({
            name: [x] * len(config.joint_names) if name == 'actuator_lag' else x
            for name, x in drives.items()})
    loops = loops_of(dataclasses.replace(setup, plant=plant))
    robot = loops.robots[0]
    if options.out is not None:
        prepare(options.out, (_JSON, _FIGURES), options.overwrite)
    print(f'{config.law}: kp {number_text(config.kp)}, kv {number_text(config.kv)}, sampled every '
          f'{1e3 * robot.period:g} ms')
    for who, lag, delay in (('law', config.assumed_lag if config.takes('actuator_lag')
                             else (0.0,), config.input_delay),
                            ('robot', tuple(robot.lag.tolist()), robot.delay)):
        print(f'{who}: lag {number_text(tuple(1e3 * x for x in lag))} ms, delay {delay}')
    found = margins(loops)
    print_columns(list(rows(found, robot.period)))
    if options.out is not None:
        from ctc_chattering.analysis import drawing
        write_text(options.out / _JSON, json.dumps(finite(as_json(found)), indent=2) + '\n')
        drawing.save(region(loops, found), options.out / _FIGURES, ('svg',))
    return 0 if found.radius < 1.0 else 1
