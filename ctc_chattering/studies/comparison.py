"""The original law against all others, joint by joint, on any robot and either plant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from pathlib import Path
import tempfile

from ctc_chattering.analysis.output import markdown_table
from ctc_chattering.analysis.result import Result, simulated
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.parameter_file import Overrides

#: Every law and, of the one that takes it, every switching; '' for the others.
VARIANTS = tuple((law, name) for law in LAWS for name in (
    SWITCHINGS if ControllerConfig(law=law).takes('switching') else ('',)))
#: Metrics of each joint, in the order of `Outcome`.
_PER_JOINT = ('rms_error_rad', 'torque_variation_nm_per_s', 'max_torque_step_nm',
              'max_torque_rate_nm_per_s')
#: Runs a parameter file with some values overridden; returns what happened.
Runner = Callable[[Path, Overrides], Result]


@dataclasses.dataclass(frozen=True)
class Outcome:
    """
    One run.

    Attributes
    ----------
    experiment, backend, law, switching : str
        What was run.
    joints : tuple of str, shape (n,)
        Names.
    rms : tuple of float, shape (n,)
        RMS of the position error [rad].
    variation, step, rate : tuple of float, shape (n,)
        Torque variation [N·m/s], and largest step [N·m] and rate [N·m/s] of the torque.
    peak : float
        Largest torque of any joint, at any time [N·m].

    """

    experiment: str
    backend: str
    law: str
    switching: str
    joints: tuple[str, ...]
    rms: tuple[float, ...]
    variation: tuple[float, ...]
    step: tuple[float, ...]
    rate: tuple[float, ...]
    peak: float


def run_variants(path: Path, backend: str | None, run: Runner) -> Iterator[Outcome]:
    """
    Yield the outcome of every variant.

    Parameters
    ----------
    path : Path
        Parameter file.
    backend : str or None
        The plant's, in place of the file's.
    run : callable
        `over_simulation`, or `over_ros`.

    """
    for law, switching in VARIANTS:
        controller = {'law': law, 'switching': switching} if switching else {'law': law}
        over = {'controller': controller,
                'plant': {} if backend is None else {'plant_backend': backend}}
        plant = parameter_file.load(path, over).plant
        result = run(path, over)
        found = result.metrics()
        if found['rms_error_rad'] is None:
            raise CtcError(f'{path}: the run ends before the evaluated interval, 5 s to 10 s')
        rms, variation, step, rate = (tuple(found[key]) for key in _PER_JOINT)
        yield Outcome(plant.experiment, plant.plant_backend, law, switching, result.joint_names,
                      rms, variation, step, rate, float(abs(result.run.tau).max()))


def over_simulation(path: Path, overrides: Overrides) -> Result:
    """Simulate without ROS."""
    return simulated(parameter_file.load(path, overrides))


def over_ros(path: Path, overrides: Overrides) -> Result:
    """Run the nodes, record a bag, and return what it says."""
    from ctc_chattering.bags.reader import read_bag
    from ctc_chattering.launch.graph import run_graph
    from ctc_chattering.ros.domain import own_domain

    with own_domain(), tempfile.TemporaryDirectory(prefix='ctc_chattering_') as scratch:
        bag = Path(scratch) / 'bag'
        run_graph(path, overrides, bag, show=lambda _: None)
        return read_bag(bag)


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """
    Return two tables for each robot and plant: errors, and changes of the torque.

    `least` is the smallest ratio of the errors of all joints.
    """
    lines: list[str] = []
    for experiment, backend in dict.fromkeys((x.experiment, x.backend) for x in outcomes):
        mine = [x for x in outcomes if (x.experiment, x.backend) == (experiment, backend)]
        original = next(x for x in mine if x.law == 'compensation')
        rows = []
        for x in mine:
            least = min(a / b for a, b in zip(original.rms, x.rms))
            ratio = '' if x is original else f'{least:.0f}×'
            rows.append([x.law, x.switching, *(f'{value:.2e}' for value in x.rms), ratio,
                         f'{x.peak:.0f}'])
        heads = ['law', 'switching', *original.joints]
        changes = [[x.law, x.switching, *(
            f'{a:.0f} / {b:.2g} / {c:.0f}' for a, b, c in zip(x.variation, x.step, x.rate))]
            for x in mine]
        title = f'**{experiment}, plant {backend}**'
        lines += [f'{title}: RMS error [rad], 5 s ≤ t ≤ 10 s', '',
                  *markdown_table([*heads, 'least', 'peak torque [N·m]'], rows), '',
                  f'{title}: torque variation [N·m/s] / largest step [N·m] / largest rate [N·m/s]',
                  '', *markdown_table(heads, changes), '']
    return '\n'.join(lines)
