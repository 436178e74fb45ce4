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
    peak : float
        Largest torque of any joint, at any time [N·m].

    """

    experiment: str
    backend: str
    law: str
    switching: str
    joints: tuple[str, ...]
    rms: tuple[float, ...]
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
        rms = result.metrics()['rms_error_rad']
        if rms is None:
            raise CtcError(f'{path}: the run ends before the evaluated interval, 5 s to 10 s')
        yield Outcome(plant.experiment, plant.plant_backend, law, switching, result.joint_names,
                      tuple(rms), float(abs(result.run.tau).max()))


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
    """Return a table for each robot and plant; `least` is the smallest ratio of all joints."""
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
        heads = ['law', 'switching', *original.joints, 'least', 'peak torque [N·m]']
        lines += [f'**{experiment}, plant {backend}**: RMS error [rad], 5 s ≤ t ≤ 10 s', '',
                  *markdown_table(heads, rows), '']
    return '\n'.join(lines)
