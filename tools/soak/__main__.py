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

"""Command line of the soak test; see ``make soak``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
import random
import sys

from ctc_chattering.cli.command_line import guarded
from ctc_chattering.errors import ParameterError
from ctc_chattering.output_files import finite, write_text
from ctc_chattering.output_folder import beside, check_folder
from ctc_chattering.ros.process import collect_signals
from soak.report import complaints, to_markdown
from soak.run import run


def main() -> int:
    """Run the soak test; return 1 if it fails."""
    parser = argparse.ArgumentParser(
        prog='soak', description='Run the graph in real time and inject faults: killed and '
        'stopped processes, malformed messages, second publishers, parameters, ~/enable, ~/reset. '
        'Print how it recovered; status 1 if it did not, a process crashed or its memory grew, '
        'or messages are missing. Ctrl-C ends it early. The bags take about 10 MB per minute.')
    parser.add_argument('--minutes', type=float, required=True, metavar='N', help='duration')
    parser.add_argument('--seed', type=int, default=random.randrange(1 << 31), metavar='S',
                        help='the same seed gives the same faults; random by default')
    parser.add_argument('--control-period', type=float, metavar='S',
                        help='for slow machines; 0.001 by default [s]')
    parser.add_argument('--out', type=Path, default=Path('soak'), metavar='DIR',
                        help='directory to write into, soak by default')
    parser.add_argument('--overwrite', action='store_true', help='replace an earlier run')
    return guarded('soak', lambda: _run(parser.parse_args()))


def _run(options: argparse.Namespace) -> int:
    if not 0.0 < options.minutes < float('inf'):
        raise ParameterError('--minutes', options.minutes, 'a finite number > 0')
    check_folder(options.out, 'soak', options.overwrite)
    with beside(options.out, 'soak') as folder:  # After an error, it remains there.
        folder.begin()
        document = run(60.0 * options.minutes, options.seed, folder.path, options.control_period,
                       collect_signals())
        found = complaints(document)
        write_text(folder.path / 'soak.json', json.dumps(
            finite({**document, 'complaints': found}), indent=2, ensure_ascii=False) + '\n')
        text = to_markdown(document)
        write_text(folder.path / 'soak.md', text)
        folder.take_place(options.out.resolve())
    print(text, end='', flush=True)
    return 1 if found else 0


if __name__ == '__main__':
    sys.exit(main())
