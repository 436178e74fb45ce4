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
Measures speed: lockstep over ROS beside a bare ping-pong, a control step, a simulation.

``make benchmark``, or ``.venv/bin/python tools/benchmark/benchmark.py --rounds 5``.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path
import random
import statistics
import subprocess
import sys
import tempfile
import time

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.control.controller import Controller
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.launch.graph import one_processor, run_graph
from ctc_chattering.simulation.closed_loop import run_closed_loop
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.trajectory.reference import make_motion

#: Round trips of one measurement of the ping-pong.
TRIPS = 10_000
#: Control steps that are timed together, and all of them.
BATCH, STEPS = 200, 3000


def ping_pong_rate(processors: set[int] | None) -> float:
    """
    Return round trips per second between two processes that do nothing else.

    Parameters
    ----------
    processors : set of int or None
        Those they may use; None for all.

    """
    argv = [sys.executable, str(Path(__file__).with_name('ping_pong.py')),
            ','.join(map(str, processors or ()))]
    with subprocess.Popen([*argv, 'pong']) as pong:
        try:
            done = subprocess.run([*argv, 'ping', str(TRIPS)], check=True, text=True,
                                  stdout=subprocess.PIPE, timeout=60.0)
        finally:
            pong.terminate()
    return float(done.stdout)


def lockstep_rate(bag: Path | None) -> float:
    """Return control cycles per second of the first experiment between t = 1 s and t = 9 s."""
    setup = parameter_file.load(config_directory() / 'friction.yaml')
    passed: list[tuple[float, float]] = []

    def progress(t: float) -> None:
        if 1.0 <= t <= 9.0:
            passed.append((t, time.perf_counter()))

    run_graph(setup, bag, progress=progress, show=lambda _: None)
    (t0, wall0), (t1, wall1) = passed[0], passed[-1]
    return (t1 - t0) / setup.plant.control_period / (wall1 - wall0)


def step_time(path: Path, compiled: bool) -> float:
    """
    Return the time of one control step [s] over the states of a simulated run.

    It is that of the fastest of many batches: what else the machine does makes them slower.
    """
    setup = parameter_file.load(path, {'/**': {'compiled': compiled}})
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    robot = Plant(setup.plant.changed({'duration': 0.0}),
                  model_of(setup.plant, setup.descriptions.get('plant', '')))
    motion = make_motion(setup.reference, None, dict(zip(
        setup.plant.joint_names, zip(*robot.measured))))
    controller, samples = Controller(setup.controller, model), []
    for k in range(STEPS):
        samples.append((*robot.measured, *motion.at(k * 1_000_000)))
        robot.step(controller.step(*samples[-1]).tau)
    times = []
    for _ in range(10):
        controller.reset()
        for k in range(0, STEPS, BATCH):
            begin = time.perf_counter()
            for sample in samples[k:k + BATCH]:
                controller.step(*sample)
            times.append(time.perf_counter() - begin)
    return min(times) / BATCH


def simulation_time(compiled: bool) -> float:
    """Return the computing time of an experiment of 10 s without ROS [s]."""
    setup = parameter_file.load(
        config_directory() / 'friction.yaml', {'/**': {'compiled': compiled}})
    times = []
    for _ in range(5):
        begin = time.process_time()
        run_closed_loop(setup.plant, setup.controller, setup.reference)
        times.append(time.process_time() - begin)
    return statistics.median(times)


def main() -> None:
    """Measure everything in turns, and print medians and ratios."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rounds', type=int, default=3)
    rounds = parser.parse_args().rounds
    rates: dict[str, list[float]] = {title: [] for title in (
        'bare ping-pong', 'the same on one processor', 'lockstep with recording', 'lockstep')}
    compile_setups([parameter_file.load(config_directory() / f'{name}.yaml')
                    for name in ('friction', 'panda')], print)
    os.environ.update(ROS_DOMAIN_ID=str(random.randint(1, 101)),
                      ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
    with tempfile.TemporaryDirectory() as scratch:
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
    print(f'simulation of 10 s at 1 kHz    {simulation_time(True):7.3f} s, plain '
          f'{simulation_time(False):.3f} s')
    for joints, name in ((2, 'friction'), (7, 'panda')):
        code, plain = (1e6 * step_time(config_directory() / f'{name}.yaml', compiled)
                       for compiled in (True, False))
        print(f'control step, {joints} joints         {code:7.2f} us, plain {plain:.2f} us')


if __name__ == '__main__':
    main()
