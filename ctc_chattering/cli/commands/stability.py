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

from ctc_chattering.analysis.number_format import number_text
from ctc_chattering.analysis.output import prepare, write_json
from ctc_chattering.analysis.tables import print_columns, Table
from ctc_chattering.cli.options import add_format, add_loop_options, add_output, load_setup
from ctc_chattering.cli.presentation import print_page
from ctc_chattering.errors import given_by_user

DETAILS = ('For the sampled loop with constant M, without limits: by its poles for constant '
           'errors, by the small-gain theorem for varying ones. Exit status 1 if the loop is '
           'unstable for the exact model. docs/theory.md states the theorem and what it does '
           'not cover.')
_JSON, _FIGURES, _PAGE = 'stability.json', 'figures', 'index.html'

_LEAD = ('Which errors of the model, lags and delays the sampled loop tolerates, with constant M '
         'and without limits of the torque.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc stability`."""
    add_loop_options(parser)
    parser.add_argument('--lag', type=float, metavar='S',
                        help="true lag of all drives [s], instead of the plant's actuator_lag")
    parser.add_argument('--delay', type=int, metavar='N',
                        help="true delay in samples, instead of the plant's input_delay")
    add_format(parser)
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
        prepare(options.out, (_JSON, _FIGURES, _PAGE), options.overwrite)
    about = [(config.law, f'kp {number_text(config.kp)}, kv {number_text(config.kv)}, sampled '
                          f'every {1e3 * robot.period:g} ms')]
    lag = config.assumed_lag if config.takes('actuator_lag') else (0.0,)
    about += [(who, f'lag {number_text(tuple(1e3 * x for x in lags))} ms, delay {delay}')
              for who, lags, delay in (('law', lag, config.input_delay),
                                       ('robot', tuple(robot.lag.tolist()), robot.delay))]
    print('\n'.join(f'{name}: {text}' for name, text in about))
    found = margins(loops)
    numbers = list(rows(found, robot.period))
    print_columns(numbers)
    if options.out is not None:
        from ctc_chattering.analysis import drawing
        from ctc_chattering.analysis.page import Section, write_page
        write_json(as_json(found), options.out / _JSON)
        figures = drawing.save(region(loops, found), options.out / _FIGURES,
                               ('svg', options.format))
        write_page(options.out / _PAGE, f'Stability of {config.law}', _LEAD, [
            Section('Stable region', figures), Section('Margins', [Table('', (), numbers)]),
            Section('What was computed', [Table('', (), about)])],
            [(_JSON, _JSON)], options.said)
        print_page(options.out / _PAGE)
    return 0 if found.radius < 1.0 else 1
