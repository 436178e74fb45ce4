"""What a soak test does and how it judges, without a graph."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise
import json
import random
from typing import Any

import numpy as np
import pytest

from ctc_chattering import soak
from ctc_chattering.errors import CtcError
from ctc_chattering.result import finite
from ctc_chattering.settings import NODES, parameters_of
from ctc_chattering.soak import Fault, Gap, gaps, Outage, plan, Report

S = 1_000_000_000
DOERS = {soak.KILL, soak.STOP, soak.MALFORMED, soak.SECOND, soak.TAKEOVER, soak.VALID,
         soak.INVALID, soak.ENABLE, soak.RESET, soak.TRIP}


def changed(node: str, name: str, value: object) -> None:
    """Set a parameter as a node would; raise `CtcError` if that is not allowed."""
    for config in NODES[node]:
        if name in config.parameters():
            config().changed({name: value})


def test_a_plan_is_made_by_its_seed_alone() -> None:
    assert repr(plan(3, 600.0)) == repr(plan(3, 600.0)) != repr(plan(4, 600.0))
    random.seed(5)
    assert repr(plan(3, 600.0)) == repr(plan(3, 600.0))


def test_a_plan_has_everything_in_it_in_time_and_kills_at_the_beginning_only() -> None:
    faults = plan(1, 600.0)
    times = [fault.at for fault in faults]
    pauses = [b.at - a.at - a.lasts for a, b in pairwise(faults)]
    assert soak.PAUSE[0] <= min(*pauses, times[0]) and max(*pauses, times[0]) <= soak.PAUSE[1]
    assert all(fault.at + fault.lasts < 600.0 for fault in faults)
    assert {fault.kind for fault in faults} == DOERS
    kills = [fault for fault in faults if fault.kind == soak.KILL]
    assert max(fault.at for fault in kills) < 200.0
    counts = Counter(fault.target for fault in kills)
    assert set(counts) == set(soak.PROCESSES)
    assert max(counts.values()) - min(counts.values()) <= 1
    for topic, flavours in soak.FLAVOURS.items():
        assert {f.flavour for f in faults if (f.kind, f.target) == (soak.MALFORMED, topic)
                } == set(flavours)
    stops = [fault for fault in faults if fault.kind == soak.STOP]
    assert {fault.target for fault in stops} == set(soak.PROCESSES)
    assert all(0.05 <= fault.lasts <= 2.0 for fault in stops)
    assert len({fault.seed for fault in faults}) == len(faults)
    assert plan(1, 1.0) == []


def test_valid_parameters_are_allowed_and_invalid_ones_are_not() -> None:
    seen = Counter[str]()
    for fault in (fault for seed in range(40) for fault in plan(seed, 600.0)):
        for name, value in fault.values:
            spec = parameters_of(fault.target).get(name)
            seen[fault.kind] += 1
            if fault.kind == soak.VALID:
                assert spec and not spec.read_only
                changed(fault.target, name, value)
            elif spec and not spec.read_only:
                with pytest.raises(CtcError):
                    changed(fault.target, name, value)
    assert min(seen.values()) > 100


def test_a_fit_is_that_of_polyfit() -> None:
    rng = np.random.default_rng(1)
    x = 1e6 + np.cumsum(rng.uniform(0.5, 1.5, 500))
    y = 7e4 + 0.03 * x + rng.normal(0.0, 20.0, 500)
    fit = soak.Fit()
    assert fit.slope is None
    for point in zip(x.tolist(), y.tolist()):
        fit.add(*point)
    assert fit.slope == pytest.approx(np.polyfit(x - x[0], y, 1)[0], rel=1e-9)
    assert (fit.count, fit.span) == (500, x[-1] - x[0])


def test_memory_is_that_of_the_longest_lived_generation_after_its_warm_up() -> None:
    memory = soak.Memory()
    lives = [(0.0, 100, 5.0), (150.0, 400, 2.0), (600.0, 100, 9.0)]
    for begin, lasts, slope in lives:
        memory.begin(begin)
        for k in range(lasts + 1):
            # It grows much in the warm-up, which does not count.
            memory.add(begin + k, 1000.0 + 100.0 * min(k, soak.WARM_UP) + slope * k)
    assert memory.growth == pytest.approx(60.0 * 2.0)
    warm = 1000.0 + 100.0 * soak.WARM_UP
    assert (memory.start, memory.end) == (warm + 2.0 * soak.WARM_UP, warm + 800.0)
    assert memory.fit.span == 400.0 - soak.WARM_UP
    short = soak.Memory()
    short.add(1.0, 5.0)
    assert (short.growth, short.start, short.end) == (None, 5.0, 5.0)


def test_speed_is_that_of_the_beginning() -> None:
    speed = soak.Speed()
    for cost in (1.0, 9.0, 2.0):
        speed.add(cost)
    assert speed.since(1) == speed.least == 1.0
    speed.begin()
    assert speed.since(1) == 1.0
    for cost in (2.0, 4.0, 4.0, 1.0):
        speed.add(cost)
    assert (speed.since(0), speed.since(1)) == (2.0, 2.0)
    assert speed.since(3) == pytest.approx(2 / 3)
    assert (speed.least, speed.slow) == (0.5, 2)


def test_totals_are_summed_over_generations() -> None:
    totals = soak.Totals()
    for generation in range(3):
        for samples in (10, 20, 30 + generation):
            totals.update({'samples': str(samples), 'rate [Hz]': '998.5', 'time': 'real',
                           'a: refused': '9', 'a: refused, nan': '7', 'timeouts, x': '0'})
        totals.retire()
    totals.update({'samples': '5', 'b: refused, bytes': '1'})
    assert totals['samples'] == 30 + 31 + 32 + 5
    assert totals.containing(': refused, ') == {'a: nan': 21, 'b: bytes': 1}
    assert totals.starting('timeouts, ') == {}
    assert totals['rate [Hz]'] == 0


def reports(t: int = 2 * S, **messages: str) -> dict[str, Report]:
    values = {'controller': {'rate [Hz]': '950.3'},
              'recorder': {'messages': '12', 'rate [Hz]': '3500.0'}}
    said = {**dict.fromkeys(soak.PROCESSES, 'running'), 'recorder': 'recording to x', **messages}
    return {name: Report(t, message, values.get(name, {})) for name, message in said.items()}


def test_what_ails_a_graph() -> None:
    assert soak.ailing(reports(), S, 900.0) == ''
    assert soak.ailing(reports(plant='running; x has publishers beside'), S, 900.0) == ''
    assert soak.ailing(reports(recorder='3 messages were dropped'), S, 900.0) == ''
    assert soak.ailing(reports(), 3 * S, 900.0) == 'recorder says nothing'
    assert soak.ailing(reports(), S, 990.0) == 'controller: 950 samples per second of 990'
    assert 'brakes' in soak.ailing(reports(plant='no command; brakes on'), S, 900.0)
    assert 'stopped' in soak.ailing(reports(recorder='recording has stopped: full'), S, 900.0)
    assert soak.ailing(reports(), S, 2000.0) == 'controller: 950 samples per second of 2000'
    deaf = reports()
    deaf['recorder'].values['rate [Hz]'] = '4.0'  # type: ignore[index]
    assert soak.ailing(deaf, S, 900.0) == 'recorder: 4 messages per second of 1800'
    missing = reports()
    del missing['reference']
    assert soak.ailing(missing, S, 900.0) == 'reference says nothing'
    assert soak.Report(0, '', {'x': 'many'}).number('x') == 0.0


def test_gaps_are_found_and_explained_by_outages() -> None:
    ms = S // 1000
    stamps = [*range(0, S, ms), *range(3 * S, 4 * S, ms), 3 * S, *range(9 * S, 10 * S, ms)]
    found = gaps(stamps, [Outage(S + 400 * ms, 2 * S)])
    assert found == [Gap(S - ms, 3 * S, True), Gap(4 * S - ms, 3 * S, False),
                     Gap(3 * S, 9 * S, False)]
    assert gaps(stamps[:1000], []) == gaps([], []) == []


PROCESS = {'samples': 1000, 'misses': 2, 'refused': {'joint_states: not_finite': 3},
           'timeouts': {'timeouts, state': 4}, 'restarts': 1, 'deaths': 0, 'waited_s': 0.5,
           'memory_start_kb': 70_000.0, 'memory_end_kb': 71_000.0, 'growth_kb_per_min': 5.0,
           'fitted_s': 80.0}


def document(**more: Any) -> dict[str, Any]:
    """Return a document without complaints."""
    tally = soak.Tally()
    tally.add(Fault(1.0, soak.KILL, 'plant'), 2.5, '')
    tally.add(Fault(2.0, soak.RESET, 'controller'), 0.4, '')
    return {
        'seed': 7, 'asked_s': 120.0, 'duration_s': 90.0, 'control_period_s': 1e-3,
        'machine': {'processor': 'Z80', 'cores': 1, 'python': '3.12', 'kernel': 'Linux 6',
                    'speed': {'least': 0.456, 'slow_s': 12}},
        'faults': tally.as_mapping(), 'failures': tally.failures, 'deaths': [],
        'processes': {name: dict(PROCESS) for name in (*soak.PROCESSES, soak.SELF)},
        'bags': {'count': 2, 'salvaged': 1, 'messages': 5000, 'states': 2000, 'gaps': 1,
                 'longest_gap_s': 1.25, 'unexplained_gaps': 0, 'dropped': 6,
                 'unexplained_dropped': 0, 'unreadable': []}, **more}


def test_the_table_says_everything() -> None:
    text = soak.to_markdown(document())
    for line in ('| duration | 1.5 min of 2.0 |', '| seed | 7 |', '| machine | Z80, 1 cores |',
                 '| speed | 46% of that at the beginning at worst, below 70% for 12 s |',
                 '| SIGKILL plant | 1 | 1 | 0 | 2.5 |', '| ~/reset | 1 | 1 | 0 | 0.4 |',
                 '| **all** | 2 | 2 | 0 | 2.5 |',
                 '| plant | 1000 | 2 | 3 | 4 | 1 | 0 | 0.5 | 70.0 → 71.0 | 5.0 | 80 |',
                 '| controller | joint_states: not_finite | 3 |',
                 '| 2 | 1 | 5000 | 2000 | 1 | 1.25 | 0 | 6 | 0 |', 'Passed.'):
        assert line in text.splitlines()
    widths = [line.count(' | ') for line in text.splitlines() if line.startswith('|')]
    assert len(set(widths)) <= 6, 'a row of another length than its table'
    json.dumps(finite(document()), allow_nan=False)
    empty = document(faults={})
    assert '| **all** | 0 | 0 | 0 |  |' in soak.to_markdown(empty)


def test_verdict() -> None:
    assert soak.complaints(document()) == []
    tally = soak.Tally()
    for k in range(100):
        tally.add(Fault(float(k), soak.STOP, 'plant', 1.0), 10.0, 'plant says nothing')
    failed = soak.complaints(document(faults=tally.as_mapping(), failures=tally.failures))
    assert failed[0] == 'at 0.0 s, SIGSTOP plant for 1.00 s: plant says nothing'
    assert len(failed) < 30 and failed[-1].startswith('100 faults')
    assert tally.as_mapping()['SIGSTOP plant']['longest_recovery_s'] is None
    slow = soak.Tally()
    for k in range(3):
        slow.add(Fault(float(k), soak.STOP, 'plant', 1.0), 10.0, 'plant says nothing', 0.6)
    assert slow.as_mapping()['SIGSTOP plant']['not_judged'] == 3 and not slow.failures
    assert soak.complaints(document(faults=slow.as_mapping())) == []
    slow.add(Fault(4.0, soak.STOP, 'plant', 1.0), 10.0, 'plant says nothing', 0.8)
    assert len(soak.complaints(document(
        faults=slow.as_mapping(), failures=slow.failures))) == 1
    assert soak.complaints(document(deaths=['plant died'])) == ['plant died']
    bags = document()['bags']
    for key in ('unexplained_gaps', 'unexplained_dropped'):
        (line,) = soak.complaints(document(bags={**bags, key: 3}))
        assert line.startswith('3 ') and line in soak.to_markdown(document(bags={**bags, key: 3}))
    assert soak.complaints(document(bags={**bags, 'unreadable': ['x: not a bag']}))


@pytest.mark.parametrize(('growth', 'fitted', 'fails'), [
    (None, 0.0, False), (5000.0, 20.0, False),      # Too short to be judged.
    (1000.0, 60.0, False), (3000.0, 60.0, True),    # Not more than 2 MB; more.
    (99.0, 36000.0, False), (101.0, 36000.0, True), (-500.0, 3600.0, False)])
def test_growth_that_is_too_much(growth: float | None, fitted: float, fails: bool) -> None:
    made = document()
    made['processes']['plant'].update(growth_kb_per_min=growth, fitted_s=fitted)
    assert [line.startswith('plant: memory') for line in soak.complaints(made)] == [True] * fails
