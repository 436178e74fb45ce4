"""The original law against all others, joint by joint, on any robot and either plant."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
import dataclasses
from pathlib import Path
import tempfile

from ctc_chattering.analysis.result import Result, simulated
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.control.switching import SWITCHINGS
from ctc_chattering.errors import CtcError
from ctc_chattering.experiment import parameter_file
from ctc_chattering.experiment.parameter_file import Overrides
from ctc_chattering.simulation.closed_loop import Run

#: Every law and, of the one that takes it, every switching; '' for the others.
VARIANTS = tuple((law, name) for law in LAWS for name in (
    SWITCHINGS if ControllerConfig(law=law).takes('switching') else ('',)))
#: Runs parameters; returns what happened.
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


def run_variants(path: Path, backend: str | None, run: Runner,
                 overrides: Overrides | None = None) -> Iterator[Outcome]:
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
    overrides : mapping, optional
        As `params.load` takes them.

    """
    for law, switching in VARIANTS:
        over = {node: dict(values) for node, values in (overrides or {}).items()}
        over.setdefault('controller', {}).update(
            {'law': law, 'switching': switching} if switching else {'law': law})
        if backend is not None:
            over.setdefault('plant', {})['plant_backend'] = backend
        setup = parameter_file.load(path, over)
        result = run(path, over)
        rms = result.metrics()['rms_error_rad']
        if rms is None:
            raise CtcError(f'{path}: the run ends before the evaluated interval, 5 s to 10 s')
        yield Outcome(setup.plant.experiment, setup.plant.plant_backend, law, switching,
                      setup.controller.joint_names, tuple(rms), _peak(result.run))


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


def _peak(run: Run) -> float:
    return float(abs(run.tau).max())


def to_markdown(outcomes: Sequence[Outcome]) -> str:
    """Return a table for each robot and plant; `least` is the smallest ratio of all joints."""
    lines: list[str] = []
    for experiment, backend in dict.fromkeys((x.experiment, x.backend) for x in outcomes):
        mine = [x for x in outcomes if (x.experiment, x.backend) == (experiment, backend)]
        original = next(x for x in mine if x.law == 'compensation')
        names = original.joints
        lines += [f'**{experiment}, plant {backend}**: RMS error [rad], 5 s ≤ t ≤ 10 s', '',
                  '| law | switching | ' + ' | '.join(names) + ' | least | peak torque [N·m] |',
                  '|---|---|' + '---|' * (len(names) + 2)]
        for x in mine:
            least = min(a / b for a, b in zip(original.rms, x.rms))
            lines.append(
                f'| {x.law} | {x.switching} | '
                + ' | '.join(f'{value:.2e}' for value in x.rms)
                + f' | {"" if x is original else f"{least:.0f}×"} | {x.peak:.0f} |')
        lines.append('')
    return '\n'.join(lines)
