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

"""`ctc compile`: machine code for a parameter file's laws and plant, once for a version."""

from __future__ import annotations

import argparse
import time

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_run_options, load_setup

DETAILS = ('Nodes, ctc simulate and all other commands then use it and run about 20 times as '
           'fast. It serves all files with this law and number of joints.')


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc compile`."""
    add_run_options(parser)
    parser.add_argument('--all', action='store_true', help='compile every law and switching')


def run(options: argparse.Namespace) -> int:
    """Run `ctc compile`."""
    from ctc_chattering.analysis.compilation import compile_setup
    from ctc_chattering.compiled.machine_code import cache_directory

    start, (_, _, setup) = time.monotonic(), load_setup(options)
    made = compile_setup(setup, options.all, say)
    print(f'{made} functions compiled in {time.monotonic() - start:.0f} s; the others were '
          f'already compiled: {cache_directory()}')
    return 0
