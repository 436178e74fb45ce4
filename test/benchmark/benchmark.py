"""How fast is it: lockstep over ROS against a bare ping-pong, measured side by side."""

from __future__ import annotations

from pathlib import Path
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from ctc_chattering import params
from ctc_chattering.core.controller import Controller
from ctc_chattering.core.models import model_of
from ctc_chattering.core.plant import Plant
from ctc_chattering.core.reference import make_motion
from ctc_chattering.core.simulation import simulate
from ctc_chattering.core.urdf import UrdfModel
from ctc_chattering.domain import own_domain
from ctc_chattering.errors import CtcError
from ctc_chattering.experiments import EXPERIMENTS
from ctc_chattering.orchestra import one_processor, perform
from ctc_chattering.share import config_directory

#: Round trips of one measurement of the ping-pong.
_TRIPS = 10_000
#: Control steps that are timed together.
_BATCH = 200


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
    try:
        seconds, bare = panda_step_time()
    except CtcError as error:
        print(f'7 joints: not measured: {error}')
    else:
        print(f'Pinocchio computeAllTerms      {1e6 * bare:7.2f} us  7 joints, called from Python')
        print(f'one control step, 7 joints     {1e6 * seconds:7.2f} us  '
              f'{seconds / bare:4.2f} times')
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


def panda_step_time() -> tuple[float, float]:
    """
    Return what a control step of a Panda costs, and Pinocchio's computeAllTerms for its state [s].

    Both are called in turn, over the states of a simulated run; the least of many batches counts,
    since all else is other work of the machine.

    Raises
    ------
    CtcError
        If Pinocchio or the Panda's description is not installed.

    """
    setup = params.load(config_directory() / 'panda.yaml')
    model = model_of(setup.controller, setup.descriptions['controller'])
    robot = Plant(setup.plant.changed({'duration': 0.0}),
                  model_of(setup.plant, setup.descriptions['plant']))
    motion = make_motion(setup.reference, None, dict(zip(
        setup.plant.joint_names, zip(*robot.measured))))
    law, samples = Controller(setup.controller, model), []
    for k in range(3000):
        samples.append((*robot.measured, *motion.at(k * 1_000_000)))
        robot.step(law.step(*samples[-1]).tau)
    import pinocchio
    assert isinstance(model, UrdfModel)
    theirs = model.pinocchio_model
    data = theirs.createData()
    states = [(np.array(q), np.array(dq)) for q, dq, *_ in samples]
    least = [float('inf')] * 2
    for _ in range(10):
        law.reset()
        for k in range(0, len(samples), _BATCH):
            begin = time.perf_counter()
            for sample in samples[k:k + _BATCH]:
                law.step(*sample)
            middle = time.perf_counter()
            for q, dq in states[k:k + _BATCH]:
                pinocchio.computeAllTerms(theirs, data, q, dq)
            end = time.perf_counter()
            least = [min(least[0], middle - begin), min(least[1], end - middle)]
    return least[0] / _BATCH, least[1] / _BATCH


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
