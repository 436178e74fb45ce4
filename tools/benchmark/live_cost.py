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
Cost of `ctc live` for the loop: misses and times with an open page and without, in turns.

`make live-cost` prints a Markdown table of medians, which validation/README.md shows. The browser
has the lowest priority: without a graphics card it draws in the time that others leave.
"""

from __future__ import annotations

import argparse
from contextlib import ExitStack
import os
from pathlib import Path
import platform
import statistics
import sys
import tempfile
from typing import NamedTuple

from browser import browser, browser_page, chromium, ctc_live
from real_time_loop import real_time_loop

#: Reports of a second each that are not counted, at the start.
_FIRST = 4


class Cost(NamedTuple):
    """Misses of plant and controller per 1000 periods, and median answer times [ms]."""

    plant_misses: float
    controller_misses: float
    plant_answer: float
    controller_computing: float


def measure(page: bool, lasts: int) -> Cost:
    """Return what the diagnostics say over `lasts` seconds, with the page open or without."""
    nodes = ('/plant', '/controller')
    with real_time_loop() as (reports, spin), ExitStack() as stack:
        if page:
            _, url = stack.enter_context(ctc_live('--port', 0))
            tab = stack.enter_context(browser_page(stack.enter_context(browser())))
            tab.goto(url)
            tab.wait_for_selector('.ctc-numbers')
            tab.wait_for_selector('.ctc-panel')
        reports.clear()
        while min(len(reports[node]) for node in nodes) < lasts + _FIRST:
            spin()
        found = [[{x.key: x.value for x in status.values} for status in reports[node]]
                 for node in nodes]
    return Cost(*map(_rate, found), *(
        statistics.median(float(x[f'{what}, p50 [ms]']) for x in series[_FIRST:])
        for what, series in zip(('answer time', 'computing time'), found)))


def _rate(series: list[dict[str, str]]) -> float:
    first, last = series[_FIRST - 1], series[-1]
    return 1000.0 * (int(last['deadline misses']) - int(first['deadline misses'])) / (
        int(last['samples']) - int(first['samples']))


def main() -> None:
    """Measure in turns and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=3)
    parser.add_argument('--seconds', type=int, default=20)
    options = parser.parse_args()
    print(f'{platform.release()}, {os.cpu_count()} processors, load average '
          f'{os.getloadavg()[0]:.1f} before', flush=True)
    found: dict[bool, list[Cost]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        polite = Path(folder) / 'chromium'
        polite.write_text(f'#!/bin/sh\nexec nice -n 19 {chromium()} "$@"\n')
        polite.chmod(0o755)
        os.environ['CHROMIUM'] = str(polite)
        for _ in range(options.rounds):
            for page, costs in found.items():
                costs.append(measure(page, options.seconds))
                print('page' if page else 'no page', costs[-1], file=sys.stderr, flush=True)
    print('| page | misses of the plant [per 1000] | of the controller | median answer [ms] '
          '| median computing [ms] |\n|---|--:|--:|--:|--:|')
    none, with_page = ([statistics.median(column) for column in zip(*costs)]
                       for costs in found.values())
    ratios = [b / a if a else float('nan') for a, b in zip(none, with_page)]
    for name, values in (('none', none), ('open', with_page), ('open / none', ratios)):
        print(f'| {name} | ' + ' | '.join(f'{x:.3g}' for x in values) + ' |')


if __name__ == '__main__':
    main()
