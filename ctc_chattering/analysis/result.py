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

"""A finished run with its configuration, its metrics, and its samples for other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
import csv
import dataclasses
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.metrics import metrics, rms, WINDOW, within
from ctc_chattering.analysis.output import write_json, writing
from ctc_chattering.analysis.tables import measured
from ctc_chattering.analysis.terms import RunTerms, terms
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.recommended_gains import LAW, recommended_gains
from ctc_chattering.controller.health import Saturation, term_saturation, WORTH_A_WORD
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.simulation import closed_loop
from ctc_chattering.simulation.closed_loop import Array, Run
from ctc_chattering.simulation.plant import make_plant, Plant
import numpy as np
import numpy.typing as npt

#: The file of `write_metrics`.
METRICS = 'metrics.json'


def _of_run(name: str, what: str) -> Any:
    """Return the property of an array of `Result.run`, without `run` in front."""
    return property(lambda result: getattr(result.run, name), doc=f'Return {what}.')


class RunAttributes:
    """Base of what has a `Run`: its arrays."""

    run: Run
    t: Array = _of_run('t', 'the time, shape (N,) [s]')
    q: Array = _of_run('q', 'the position, shape (N, n) [rad]')
    dq: Array = _of_run('dq', 'the velocity, shape (N, n) [rad/s]')
    q_d: Array = _of_run('q_d', 'the desired position, shape (N, n) [rad]')
    dq_d: Array = _of_run('dq_d', 'the desired velocity, shape (N, n) [rad/s]')
    ddq_d: Array = _of_run('ddq_d', 'the desired acceleration, shape (N, n) [rad/s²]')
    e: Array = _of_run('e', 'the position error q_d - q, shape (N, n) [rad]')
    de: Array = _of_run('de', 'the velocity error dq_d - dq, shape (N, n) [rad/s]')
    tau: Array = _of_run('tau', 'the torque sent at the sample, shape (N, n) [N·m]; nan where it '
                         'is unknown')
    v: Array = _of_run('v', 'the filtered error of equation (3), shape (N, n) [rad/s]')


#: Time after a change in which v reaches 0 and the term may be at its bound [s].
_REACHING = 0.5
#: Part of the motion above which an error is large, and the least motion [rad].
_LARGE, _LEAST_MOTION = 0.1, 1e-3
#: Gains of one switching only.
_OF_SWITCHING = {'boundary_layer': 'boundary_layer', 'observer_bandwidth': 'implicit_observer'}


@dataclasses.dataclass(frozen=True, repr=False)
class Result(RunAttributes):
    """
    One run of one experiment: its samples, the law that ran, and its numbers.

    `simulate` and `read_bag` return it. The samples are attributes: ``t``, ``q``, ``dq``, ``q_d``,
    ``dq_d``, ``ddq_d``, ``e``, ``de``, ``tau``, ``v``.

    Attributes
    ----------
    experiment : str
        Its name, for example ``friction``.
    configs : sequence of (time, ControllerConfig)
        The controller's configurations, and the times from which they apply [s].
    run : Run
        The samples.
    computed : RunTerms, optional
        Terms, if they are known; otherwise computed when first asked for.
    description : str
        The URDF of the controller's model; empty for a model that needs none.
    source : str
        Name of the bag; empty for a simulation.
    window : (float, float)
        Part of the run over which metrics are computed [s].

    Raises
    ------
    CtcError
        If `configs` are no pairs of a time and a `ControllerConfig`.

    Examples
    --------
    >>> from ctc_chattering import load_parameters, simulate
    >>> result = simulate(load_parameters('friction', {'plant': {'duration': 6.0}}))
    >>> result.joint_names, result.e.shape
    (('joint1', 'joint2'), (6001, 2))
    >>> [f'{x:.0e} rad' for x in abs(result.e[5000:]).max(axis=0)]
    ['1e-04 rad', '9e-04 rad']
    >>> [f'{x:.1e} rad' for x in result.metrics()['rms_error_rad']]
    ['6.6e-05 rad', '5.0e-04 rad']

    """

    experiment: str
    configs: Sequence[tuple[float, ControllerConfig]]
    run: Run
    computed: RunTerms | None = None
    description: str = ''
    source: str = ''
    window: tuple[float, float] = WINDOW

    def __post_init__(self) -> None:
        """Check the configurations."""
        if not len(self.configs) or not all(
                isinstance(x, tuple) and len(x) == 2 and isinstance(x[1], ControllerConfig)
                for x in self.configs):
            raise ParameterError('configs', self.configs,
                                 'pairs of a time [s] and a ControllerConfig, one or more')

    def __repr__(self) -> str:
        """Return the run in a line, with its RMS errors in the window."""
        error = metrics(self.run, self.window)['rms_error_rad']
        return (f'<{self.label}: {len(self.run.t)} samples, RMS error {measured(error)} from '
                f'{self.window[0]:g} to {self.window[1]:g} s>')

    @cached_property
    def terms(self) -> RunTerms:
        """Return the parts of the torque, v and V; a simulation lacks what was not sent."""
        return self.computed or terms(
            self.run, self.configs, model_of(self.config, self.description), unsent=True)

    @property
    def config(self) -> ControllerConfig:
        """Return the configuration at the end; model, joints and period are always the same."""
        return self.configs[-1][1]

    @property
    def law(self) -> str:
        """Return the law at the end."""
        return self.config.law

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, in the order of the arrays' columns."""
        return self.config.joint_names

    @property
    def changes(self) -> list[tuple[float, str]]:
        """Return the times [s] at which the law changed during the run, with the new law."""
        return [(t, new.law) for (_, old), (t, new) in pairwise(self.configs)
                if new.law != old.law]

    @property
    def marks(self) -> list[tuple[float, str]]:
        """Return the times [s] at which law or switching changed, with the new one."""
        return [(t, new.law if new.law != old.law else new.switching)
                for (_, old), (t, new) in pairwise(self.configs)
                if (new.law, new.switching) != (old.law, old.switching)]

    @property
    def label(self) -> str:
        """Experiment and laws, for a legend."""
        laws = [self.configs[0][1].law, *(law for _, law in self.changes)]
        return f'{self.experiment}: {" → ".join(laws)}'

    @property
    def slug(self) -> str:
        """Experiment and law, for a file name."""
        return self.experiment if self.changes else f'{self.experiment}_{self.law}'

    @cached_property
    def position_units(self) -> tuple[str, ...]:
        """Return the unit of each joint's position: rad, or m for a prismatic joint."""
        return position_units(self.joint_names, self.description)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Return the unit of each joint's torque: N·m, or N for the force of a prismatic joint."""
        return tuple('N' if unit == 'm' else 'N·m' for unit in self.position_units)

    @property
    def gains(self) -> dict[str, Any]:
        """Return the gains of the law at the end, by parameter name."""
        config = self.config
        values = config.as_mapping()
        names = ['kp', 'kv', *(
            name for name, spec in config.parameters().items()
            if config.law in spec.laws and spec.kind.startswith('float')
            and _OF_SWITCHING.get(name, config.switching) == config.switching)]
        return {name: list(x) if isinstance(x := values[name], tuple) else x for name in names}

    @cached_property
    def missing(self) -> npt.NDArray[np.int64]:
        """Return the number of samples missing after each sample but the last, shape (N - 1,)."""
        return missing(self.run.t, self.config.control_period)

    @cached_property
    def saturation(self) -> list[Saturation] | None:
        """
        How often the chattering term of each joint is at its bound within the window.

        The first `_REACHING` seconds after the start and after a change of parameters are not
        counted. None without a sample under a law that takes ``ka``.
        """
        t, parts = self.run.t, []
        inside, gaps = within(t, self.window), np.append(0, self.missing) > 0
        for (begin, config), (end, _) in pairwise([*self.configs, (np.inf, self.config)]):
            if config.takes('ka'):
                k = np.flatnonzero(inside & (t >= begin + _REACHING) & (t < end))
                parts.append((
                    np.insert(self.terms.robust[k], np.flatnonzero(gaps[k]), np.nan, axis=0),
                    config.ka, config.switching_in_force))
        return term_saturation(parts) or None

    def metrics(self) -> dict[str, Any]:
        """
        Return the numbers of this run, its entry of ``metrics.json``.

        Returns
        -------
        dict
            What `analysis.metrics.metrics` returns for `window`, such as ``rms_error_rad``, a
            number per joint; experiment, bag, law, switching, period, joints, units and gains;
            ``term_at_bound``, how often the chattering term of each joint is at its bound.

        """
        numbers = metrics(self.run, self.window, period=self.config.control_period)
        mixed = len(set(self.position_units)) > 1
        if mixed:
            numbers['max_error_norm1_rad'] = None
        return {
            'experiment': self.experiment, 'bag': self.source or None, 'law': self.law,
            'switching': self.config.switching, 'control_period_s': self.config.control_period,
            'joint_names': list(self.joint_names),
            'position_units': list(self.position_units),
            'torque_units': list(self.torque_units), 'gains': self.gains, **numbers,
            'term_at_bound': self.saturation and [x.fraction for x in self.saturation],
            'notes': [*numbers['notes'], *self._notes(mixed)]}

    def _notes(self, mixed: bool) -> Iterator[str]:
        """Yield what else the user should know."""
        if mixed:
            yield 'no sum of errors: prismatic joints have errors in m, the others in rad'
        lost = int(self.missing.sum())
        if lost:
            yield (f'{lost} of {lost + len(self.run.t)} samples are missing; errors are computed '
                   'from the others, the torque variation from consecutive ones')
        for name, found in zip(self.joint_names, self.saturation or ()):
            if found.cause:
                yield f'{name}: {found}'
        inside = within(self.run.t, self.window)
        if inside.sum() > 1:
            yield from self._large_errors(inside)

    def _large_errors(self, inside: npt.NDArray[np.bool_]) -> Iterator[str]:
        """Yield which errors are large beside the motion in the window, and why."""
        config, tau = self.config, np.abs(np.nan_to_num(self.run.tau[inside]))
        motion = 0.5 * np.ptp(self.run.q_d[inside], axis=0)
        parts = rms(self.run.e[inside]) / np.where(motion < _LEAST_MOTION, np.inf, motion)
        large = ', '.join(f'{name} ({100.0 * x:.0f} %)' for name, x in zip(
            self.joint_names, parts) if x > _LARGE)
        if not large:
            return
        limited = float((tau >= 0.999 * tau.max(axis=0)).mean(axis=0)[parts.argmax()])
        if limited > WORTH_A_WORD:
            why = f'the torque is at a limit in {100.0 * limited:.0f} % of the samples'
        elif config.law == LAW and max(config.kp) < 0.25 * recommended_gains(config)['kp'][0]:
            why = f'kp and kv are too small for {LAW}: --gains recommended'
        else:
            why = 'kp and kv are too small for the friction that the law leaves, or it is unstable'
        yield f'the RMS error is above a tenth of the motion of {large}: {why}'


def simulate(setup: Setup, progress: Callable[[float], None] | None = None, truth: bool = False,
             robot: Plant | None = None, model: Model | None = None) -> Result:
    """
    Simulate the closed loop without ROS: the same run as that of the nodes in lockstep.

    Parameters
    ----------
    setup : Setup
        As `load_parameters` returns it.
    progress : callable, optional
        Called at intervals with the simulated time [s].
    truth : bool
        Record the true state in place of the one that the sensors show.
    robot : Plant, optional
        At its start, such as a `Plant`; in place of the one that `setup.plant` describes.
    model : Model, optional
        Of the controller, in place of the one that its configuration names.

    Returns
    -------
    Result
        From t = 0 to the plant's `duration`, both included; without the samples whose state is
        lost on the way to the controller.

    Raises
    ------
    CtcError
        If `duration` is 0, the motion diverges, the law has no finite torque, a position error
        exceeds `error_limit`, or the waypoints are not allowed.

    Examples
    --------
    >>> from ctc_chattering import load_parameters, simulate
    >>> setup = load_parameters('friction', {'plant': {'duration': 6.0}})
    >>> for law in ('compensation', 'chattering'):
    ...     result = simulate(setup.changed({'controller': {'law': law}}))
    ...     print(law, f"{result.metrics()['rms_error_rad'][1]:.1e} rad")
    compensation 4.6e-02 rad
    chattering 5.0e-04 rad

    """
    run = closed_loop.simulate(
        setup.plant, setup.controller, setup.reference, setup.events, progress, truth,
        route=setup.route, robot=robot or make_plant(
            setup.plant, setup.descriptions.get('plant', '')),
        model=model or model_of(
            setup.controller, setup.descriptions.get('controller', '')))
    configs = [(0.0, setup.controller)]
    for event in setup.events:
        if event.node == 'controller':
            configs.append((event.time, configs[-1][1].changed(event.values)))
    return Result(setup.plant.experiment, configs, run,
                  description=setup.descriptions.get('controller', ''))


def write_metrics(results: Sequence[Result], path: Path) -> None:
    """
    Write ``{"runs": [...]}``, an object per run, as strict JSON; null for what is not finite.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    write_json({'runs': [result.metrics() for result in results]}, path)


def position_units(names: Sequence[str], description: str) -> tuple[str, ...]:
    """Return the unit of each joint's position: m if a URDF says that it is prismatic, or rad."""
    kinds = {}
    with suppress(CtcError):
        kinds = {name: joint.kind for name, joint in Tree(description).joints.items()}
    return tuple('m' if kinds.get(name) == 'prismatic' else 'rad' for name in names)


#: Arrays per joint with the suffix of the joint's position unit; None for the torque unit.
_ARRAYS = {'q': '', 'dq': '/s', 'q_d': '', 'dq_d': '/s', 'ddq_d': '/s²', 'tau': None, 'v': '/s'}


def export(result: Result, path: str | Path) -> None:
    """
    Write the samples of a run with names and units of the joints, for other programs.

    Parameters
    ----------
    result : Result
        Of `simulate` or `read_bag`.
    path : str or Path
        File to write: ``.npz`` for NumPy, which has the gains as well; ``.csv`` for a column per
        joint and quantity.

    Raises
    ------
    CtcError
        If the name ends otherwise, or the file cannot be written.

    Examples
    --------
    >>> from ctc_chattering import export, load_parameters, simulate
    >>> result = simulate(load_parameters('friction', {'plant': {'duration': 0.1}}))
    >>> export(result, 'run.csv')
    >>> open('run.csv').readline().split(',')[:2]
    ['t [s]', 'q_joint1 [rad]']

    """
    path = Path(path)
    if path.suffix not in ('.npz', '.csv'):
        raise ParameterError('path', str(path), 'a name that ends in .npz or .csv')
    (write_csv if path.suffix == '.csv' else write_npz)(result, path)


def write_npz(result: Result, path: Path) -> None:
    """
    Write samples, names, units and gains as a NumPy file.

    ``t``, shape (N,), and ``q, dq, q_d, dq_d, ddq_d, tau, v``, shape (N, n); ``joint_names``,
    ``position_units``, ``torque_units``, shape (n,); ``control_period``, ``law``, ``switching``
    and the gains by name, as at the end.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    with writing(path):
        np.savez(path, **vars(result.run), joint_names=result.joint_names,
                 position_units=result.position_units, torque_units=result.torque_units,
                 control_period=result.config.control_period, law=result.law,
                 switching=result.config.switching, **result.gains)


def write_csv(result: Result, path: Path) -> None:
    """
    Write samples as comma-separated values, a column per joint and quantity.

    The first row has the name and unit of each column, for example ``q_elbow [rad]``. Numbers are
    exact; unknown ones are ``nan``.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    heads, columns = ['t [s]'], [result.run.t]
    for name, suffix in _ARRAYS.items():
        units = (result.torque_units if suffix is None
                 else [unit + suffix for unit in result.position_units])
        heads += [f'{name}_{joint} [{unit}]' for joint, unit in zip(result.joint_names, units)]
        columns.extend(getattr(result.run, name).T)
    with writing(path), path.open('w', newline='', encoding='utf-8') as file:
        rows = csv.writer(file)
        rows.writerow(heads)
        rows.writerows(np.column_stack(columns).tolist())
