"""How fast is it: lockstep over ROS against a bare ping-pong, measured side by side."""

from __future__ import annotations

from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time

from ctc_chattering import params
from ctc_chattering.core.controller import Controller
from ctc_chattering.core.simulation import simulate
from ctc_chattering.domain import own_domain
from ctc_chattering.errors import CtcError
from ctc_chattering.experiments import EXPERIMENTS
from ctc_chattering.orchestra import one_processor, perform

#: Round trips of one measurement of the ping-pong.
_TRIPS = 10_000


def measure(rounds: int) -> int:
    """Measure everything `rounds` times in turn, and print medians and ratios."""
    rates: dict[str, list[float]] = {title: [] for title in (
        'bare ping-pong', 'the same on one processor', 'lockstep with recording', 'lockstep')}
    with own_domain(), tempfile.TemporaryDirectory() as scratch:
        for i in range(rounds):
            measured = (ping_pong_rate(None), ping_pong_rate(one_processor()),
                        lockstep_rate(Path(scratch) / f'bag{i}'), lockstep_rate(None))
            for series, value in zip(rates.values(), measured):
                series.append(value)
            print(f'round {i + 1} of {rounds}: ' + ', '.join(
                f'{title} {value:.0f}/s' for title, value in zip(rates, measured)), flush=True)
    base = statistics.median(rates['bare ping-pong'])
    for title, series in rates.items():
        rate = statistics.median(series)
        print(f'{title:30} {rate:7.0f}/s  {rate / base:4.0%}')
    seconds, step = simulation_time()
    print(f'simulation of 10 s at 1 kHz    {seconds:7.3f} s of computing')
    print(f'one control step               {1e6 * step:7.2f} us')
    return 0


def ping_pong_rate(processors: set[int] | None) -> float:
    """
    Return round trips per second between two processes that do nothing else.

    Parameters
    ----------
    processors : set of int or None
        Those they may use; None for all.

    """
    argv = [sys.executable, '-m', 'ctc_chattering.nodes.pingpong',
            ','.join(map(str, processors or ()))]
    with subprocess.Popen([*argv, 'pong']) as pong:
        try:
            done = subprocess.run([*argv, 'ping', str(_TRIPS)], check=True, text=True,
                                  stdout=subprocess.PIPE, timeout=60.0)
        except (subprocess.SubprocessError, OSError) as error:
            raise CtcError(f'the ping-pong failed: {error}') from None
        finally:
            pong.terminate()
    return float(done.stdout)


def lockstep_rate(bag: Path | None) -> float:
    """Return control cycles per second of the first experiment between t = 1 s and t = 9 s."""
    experiment = EXPERIMENTS[1]
    period = params.load(experiment.path).plant.control_period
    seen: list[tuple[float, float]] = []

    def progress(t: float) -> None:
        if 1.0 <= t <= 9.0:
            seen.append((t, time.perf_counter()))

    perform(experiment.path, experiment.overrides, bag, progress=progress, show=lambda _: None)
    (t0, wall0), (t1, wall1) = seen[0], seen[-1]
    return (t1 - t0) / period / (wall1 - wall0)


def simulation_time() -> tuple[float, float]:
    """Return the computing time [s] of an experiment without ROS, and of one control step."""
    setup = params.load(EXPERIMENTS[1].path)
    times = []
    for _ in range(5):
        begin = time.process_time()
        simulate(setup.plant, setup.controller, setup.reference)
        times.append(time.process_time() - begin)
    law, row, steps = Controller(setup.controller), (0.1, 0.2), 20_000
    begin = time.process_time()
    for _ in range(steps):
        law.step(row, row, row, row, row)
    return statistics.median(times), (time.process_time() - begin) / steps
