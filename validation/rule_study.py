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

"""Rules of gains around those of the package, on draws that no table judges: `make rules`."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from math import inf
from statistics import median
from typing import Any

from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.runs import recommended
from ctc_chattering.runs.compare import BEST, evaluate, RECOMMENDED, Task, Variant
from ctc_chattering.runs.conditions import held_out
from ctc_chattering.runs.recommended import Rule, RULES
from ctc_chattering.runs.score import Score

#: Seeds of the draws; those of the tables are others.
SEEDS, DRAWS = (1, 2), 24


def candidates(rule: Rule) -> Iterator[Rule]:
    """Yield the rule, and others with p or one of its numbers half as large again, or less."""
    for name in ('', 'speed', 'fastest', 'kp', 'kv', 'ki', 'reversal', *rule.times_p, *rule.fixed):
        for factor in (1.0,) if not name else (0.7, 1.4):
            parts: dict[str, Any] = {
                key: {x: y * (factor if x == name else 1.0) for x, y in part.items()}
                for key, part in (('times_p', rule.times_p), ('fixed', rule.fixed))}
            whole = {name: factor * getattr(rule, name)} if name in Rule._fields else {}
            yield rule._replace(**parts, **whole)


def judged(law: str) -> list[Score]:
    """Return what a law by its rule does on every draw."""
    return [evaluate(Task(find_config('friction'), x, Variant(law, '', RECOMMENDED))).score
            for seed in SEEDS for x in held_out(DRAWS, seed)]


def main() -> None:
    """Print a row for each rule: what survives, worst and median error, variation."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('laws', nargs='*', default=[*RULES])
    best = judged(BEST.law)
    print('| law | rule | survived | worst [rad] | median [rad] | variation over that of ours |')
    print('|---' * 6 + '|')
    for law in parser.parse_args().laws:
        for rule in candidates(RULES[law]):
            recommended.RULES[law] = rule
            found = judged(law)
            errors = [x.error for x in found]
            ratio = median([median(a / b for a, b in zip(x.variation, y.variation))
                            for x, y in zip(found, best) if not x.failure] or [inf])
            changed = [f'{name} {x}' for name, x in rule._asdict().items()
                       if x not in (Rule._field_defaults.get(name), {})]
            print(f'| {law} | {", ".join(changed)} | {sum(x < inf for x in errors)} of '
                  f'{len(errors)} | {max(errors):.1e} | {median(errors):.1e} | {ratio:.2f} |',
                  flush=True)


if __name__ == '__main__':
    main()
