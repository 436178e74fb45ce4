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
The law in C at 1 kHz, beside an empty loop and two busy ones: a Markdown table.

Needs a C compiler, and for the second row the right to SCHED_FIFO; docs/real_time.md shows one.
"""

from __future__ import annotations

from pathlib import Path
import subprocess
import sys
import tempfile

from ctc_chattering.cli.ctc import main

#: Length of a measurement [s].
_SECONDS = '60'
_HERE = Path(__file__).parent
_COLUMNS = ('empty p50', 'p99.9', 'max', 'law p50', 'p99.9', 'max', 'step p50', 'p99.9', 'max',
            'page faults', 'bytes allocated')


def measured(program: Path, *priority: str) -> list[str]:
    """Return the numbers of real_time.c, beside two busy loops."""
    busy = [subprocess.Popen([sys.executable, '-c', 'while True: pass']) for _ in range(2)]
    try:
        return subprocess.check_output([program, _SECONDS, *priority], text=True).split()
    finally:
        for process in busy:
            process.kill()


def table() -> None:
    """Print the table for seven joints under observer_feedback."""
    with tempfile.TemporaryDirectory() as name:
        library = Path(name) / 'library'
        if main(['export-c', 'panda', '--law', 'observer_feedback', '--out', str(library)]):
            raise SystemExit('not exported')
        program = library / 'real_time'
        subprocess.run(['cc', '-O2', '-I', library, _HERE / 'real_time.c', library / 'ctc_law.c',
                        library / 'ctc_law_code.o', '-lm', '-o', program], check=True)
        print(f'| scheduling | {" | ".join(_COLUMNS)} |\n|---|{"---|" * len(_COLUMNS)}')
        for scheduling, priority in (('normal', ()), ('SCHED_FIFO', ('fifo',))):
            print(f'| {scheduling} | {" | ".join(measured(program, *priority))} |')


if __name__ == '__main__':
    table()
