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

"""Held-out conditions for `observer_feedback`, on independent plants."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import json
from pathlib import Path
from typing import Any

from held_out import controller, drawn, RIVALS, run, TELLINGS, told
from held_out_table import line, table, verdict


def judged(seed: int, label: str, tellings: Sequence[str], irregular: bool = False
           ) -> list[dict[str, Any]]:
    """Return the rows of a condition: `compensation` and what is told to the law."""
    c, arm, path, first = drawn(seed, irregular)
    rows = []
    for telling in ('compensation', *tellings):
        values = told(c, telling)
        found = run(c, arm, path, first, controller(c, values))
        rows.append({'label': label, 'seed': seed, 'robot': c.robot, 'telling': telling,
                     'condition': c.text(), 'values': values, **found})
    for row in rows:
        row['verdict'] = verdict(row, rows[0])
    return rows


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--first', type=int, default=3000, help='seed of the first condition')
    parser.add_argument('--count', type=int, default=44, help='number of conditions')
    parser.add_argument('--tellings', nargs='*', default=list(TELLINGS),
                        choices=(*TELLINGS, *RIVALS))
    parser.add_argument('--irregular', action='store_true',
                        help='lose states, and measure the others off the grid')
    parser.add_argument('--label', default='this', help='what the rows are called in the table')
    parser.add_argument('--rows', type=Path, default=Path('held_out.jsonl'))
    options = parser.parse_args()
    known = [json.loads(x) for x in options.rows.read_text().splitlines()
             ] if options.rows.exists() else []
    done = {(x['label'], x['seed'], x['telling']) for x in known}
    for seed in range(options.first, options.first + options.count):
        left = [x for x in options.tellings if (options.label, seed, x) not in done]
        if not left:
            continue
        rows = judged(seed, options.label, left, options.irregular)
        known += rows
        print(seed, rows[0]['condition'], *(line(x, rows[0]) for x in rows), sep='\n', flush=True)
        with options.rows.open('a') as file:
            file.writelines(json.dumps(x) + '\n' for x in rows)
    print(table(known))


if __name__ == '__main__':
    main()
