"""Runs of a parameter file under overrides, and the numbers by which laws are compared."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
import dataclasses
from pathlib import Path
import tempfile
from typing import NamedTuple

from ctc_chattering.analysis.engine import simulated_by
from ctc_chattering.analysis.metrics import metrics
from ctc_chattering.analysis.result import Result
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.parameter_file import Overrides
from ctc_chattering.errors import CtcError
import numpy as np

#: Metrics of each joint, in the order of `Measurement`.
_PER_JOINT = ('rms_error_rad', 'torque_variation_nm_per_s', 'max_torque_step_nm',
              'max_torque_rate_nm_per_s')
#: Runs a parameter file with some values overridden; returns what happened.
Runner = Callable[[Path, Overrides], Result]


class Measurement(NamedTuple):
    """The numbers of a run, or the worst of several, over 5 s to 10 s; of each joint, (n,)."""

    #: RMS of the position error [rad].
    rms: tuple[float, ...]
    #: Torque variation [N·m/s], and largest step [N·m] and rate [N·m/s] of the torque sent.
    variation: tuple[float, ...]
    step: tuple[float, ...]
    rate: tuple[float, ...]
    #: Largest torque at any time [N·m].
    peak: tuple[float, ...]


def measure(path: Path, runs: Sequence[Overrides], run: Runner) -> Measurement:
    """
    Return the numbers of the worst of some runs of a file, joint by joint.

    Raises
    ------
    CtcError
        If a run diverges, its parameters are not allowed, or it ends before the interval.

    """
    return worst(_numbers(path, run(path, overrides)) for overrides in runs)


def _numbers(path: Path, result: Result) -> Measurement:
    found = metrics(result.run, period=result.config.control_period)
    if found['rms_error_rad'] is None:
        raise CtcError(f'{path}: the run ends before the evaluated interval, 5 s to 10 s')
    rms, variation, step, rate = (tuple(found[key]) for key in _PER_JOINT)
    return Measurement(rms, variation, step, rate,
                       tuple(np.abs(result.run.tau).max(axis=0).tolist()))


def worst(found: Iterable[Measurement]) -> Measurement:
    """Return the largest of every number."""
    return Measurement(*(tuple(map(max, zip(*rows))) for rows in zip(*found)))


@dataclasses.dataclass(frozen=True)
class Simulation:
    """Simulates without ROS, by an engine that `engine_of` takes; the states are the true ones."""

    engine: str | None = None

    def __call__(self, path: Path, overrides: Overrides) -> Result:
        """Return what happens."""
        return simulated_by(parameter_file.load(path, overrides), self.engine, truth=True)


over_simulation = Simulation()


def over_ros(path: Path, overrides: Overrides) -> Result:
    """Run the nodes, record a bag, and return what it says; the states are the measured ones."""
    from ctc_chattering.bags.reader import read_bag
    from ctc_chattering.launch.graph import run_graph
    from ctc_chattering.ros.domain import own_domain

    with own_domain(), tempfile.TemporaryDirectory(prefix='ctc_chattering_') as scratch:
        bag = Path(scratch) / 'bag'
        run_graph(path, overrides, bag, show=lambda _: None)
        return read_bag(bag)


def merged(*parts: Overrides) -> Overrides:
    """Return overrides by node and parameter; later ones win."""
    nodes = dict.fromkeys(node for part in parts for node in part)
    return {node: {name: value for part in parts for name, value in part.get(node, {}).items()}
            for node in nodes}
