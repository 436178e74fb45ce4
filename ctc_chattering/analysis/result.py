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

"""A finished run: its configuration, metrics, name and colour, and samples for other programs."""

from __future__ import annotations

import base64
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
import csv
import dataclasses
from functools import cached_property
import io
from itertools import cycle, groupby, pairwise
import json
from pathlib import Path
from typing import Any, BinaryIO

from ctc_chattering.analysis.metrics import metrics, WINDOW, within
from ctc_chattering.analysis.tables import measured, number_text
from ctc_chattering.analysis.terms import RunTerms, terms
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import ControllerConfig, LAWS
from ctc_chattering.controller.health import Saturation, term_saturation
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.output_files import replacing, write_json
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


#: Signals that differ less than 32 bits tell: q of q_d, and one time of the next.
_EXACT = ('t', 'q', 'q_d')
#: Parts of a torque as the controller publishes them: nominal + compensation + robust.
PARTS = ('nominal', 'compensation', 'robust')


def signals_of(result: Result) -> dict[str, Array]:
    """Return all signals of a run by the names that plots.js lists, each of shape (N, columns)."""
    run, terms = result.run, result.terms
    parts = terms.nominal, -terms.compensation, -terms.robust
    return {'q': run.q, 'q_d': run.q_d, 'dq': run.dq, 'e': run.e, 'v': terms.v,
            'V': terms.lyapunov[:, None], 'torque': run.tau, **dict(zip(PARTS, parts))}


def packed(t: Array, signals: Mapping[str, Array], **head: Any) -> bytes:
    """
    Return samples as the script reads them.

    Four bytes with the length of the head, the head in JSON, then the columns, each beginning at
    a multiple of eight bytes: 64 bits a number for `t`, `q` and `q_d`, 32 for the others.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times [s].
    signals : mapping of str to ndarray, shape (N,) or (N, n)
        By the names that plots.js lists.
    **head : Any
        More for the head: ``run``, number of the run, and ``fresh``; see `append` in plots.js.

    """
    columns, parts = [], []
    for name, rows in {'t': t, **signals}.items():
        kind = '<f8' if name in _EXACT else '<f4'
        with np.errstate(over='ignore'):
            values = np.asarray(rows, float).reshape(len(t), -1).T.astype(kind)
        for joint, column in enumerate(values):
            columns.append((name, joint, column.itemsize))
            parts.append(_filled(column.tobytes()))
    text = json.dumps({'count': len(t), 'columns': columns, **head}).encode()
    return b''.join((_filled(len(text).to_bytes(4, 'little') + text), *parts))


def coded(t: Array, signals: Mapping[str, Array]) -> str:
    """Return `packed` samples as text, for `packed` of a run in a page."""
    return base64.b64encode(packed(t, signals)).decode()


def _filled(data: bytes) -> bytes:
    """Return bytes with zeros up to a multiple of eight."""
    return data + bytes(-len(data) % 8)


#: Colour of each law, the same in all figures and pages, and of a run under several (after
#: Okabe and Ito).
LAW_COLOURS = dict(zip(LAWS, cycle((
    '#D55E00', '#0072B2', '#B0428A', '#B8860B', '#56A0D3', '#6B4E2E', '#7F7F7F', '#7B5EA7',
    '#8C1D40', '#009E9E', '#007A5A'))))
MIXED = '#1B1B1B'
#: Part of white, or of black where it is negative, in the colours of further runs under one law.
_SHADES = (0.0, 0.45, -0.45, 0.25, -0.25, 0.65)


def name(result: Result) -> str:
    """Return experiment, laws, and the switching where it is not the paper's."""
    kinds = [kind for kind, _ in groupby(
        config.switching for _, config in result.configs if config.law == 'chattering')]
    if not kinds or kinds == ['sign']:
        return result.label
    return f'{result.label} ({" → ".join(kinds) if len(kinds) < 3 else "several switchings"})'


def names(results: Sequence[Result]) -> list[str]:
    """
    Return a name for each of several runs, all different.

    Where experiment, law and switching are the same, gains that differ are added; where these
    are the same too, the name of the bag, or a number.
    """
    found = [name(result) for result in results]
    for clash in [text for text, count in Counter(found).items() if count > 1]:
        mine = [i for i, text in enumerate(found) if text == clash]
        values = [_gains(results[i]) for i in mine]
        differ = [key for key in values[0] if len({x.get(key) for x in values}) > 1]
        for i, value in zip(mine, values):
            found[i] = ', '.join([found[i], *(
                f'{key} {value[key]}' for key in differ[:3] if key in value)])
    for i in _repeated(found):
        if results[i].source:
            found[i] += f', bag {results[i].source}'
    for k, i in enumerate(_repeated(found), 1):
        found[i] += f' #{k}'
    return found


def colours(results: Sequence[Result]) -> list[str]:
    """Return a colour for each run: that of its law, in shades for several of an experiment."""
    return shaded([colour(x) for x in results], [x.experiment for x in results])


def shaded(colours: Sequence[str], groups: Sequence[object] = ()) -> list[str]:
    """Return colours, ``#rrggbb``, of which equal ones of a group become different shades."""
    before: Counter[tuple[object, str]] = Counter()
    found = []
    for group, text in zip(groups or [None] * len(colours), colours):
        share = _SHADES[before[group, text] % len(_SHADES)]
        before[group, text] += 1
        end = 255.0 if share > 0.0 else 0.0
        found.append('#' + ''.join(
            f'{round((1.0 - abs(share)) * int(text[i:i + 2], 16) + abs(share) * end):02X}'
            for i in (1, 3, 5)))
    return found


def colour(result: Result) -> str:
    """Return the colour of a run by itself."""
    return MIXED if result.changes else LAW_COLOURS[result.law]


def gains(result: Result) -> str:
    """Return the gains in force at the end, and the sample period, on one line."""
    return ', '.join(f'{key} {value}' for key, value in _gains(result).items())


def _gains(result: Result) -> dict[str, str]:
    return {key: number_text(value) for key, value in (
        *result.gains.items(), ('control_period', result.config.control_period))}


def _repeated(found: Sequence[str]) -> list[int]:
    counts = Counter(found)
    return [i for i, text in enumerate(found) if counts[text] > 1]


#: Arrays per joint with the suffix of the joint's position unit; None for the torque unit.
_ARRAYS = {'q': '', 'dq': '/s', 'q_d': '', 'dq_d': '/s', 'ddq_d': '/s²', 'tau': None, 'v': '/s'}


def export(result: Result, path: str | Path) -> None:
    """
    Write the samples of a run with names and units of the joints, for other programs.

    In a NumPy file: ``t``, shape (N,), and ``q, dq, q_d, dq_d, ddq_d, tau, v``, shape (N, n);
    ``joint_names``, ``position_units``, ``torque_units``, shape (n,); ``control_period``, ``law``,
    ``switching`` and the gains by name, as at the end. In comma-separated values: a column per
    joint and quantity, below its name and unit, for example ``q_elbow [rad]``; numbers are exact,
    unknown ones are ``nan``.

    Parameters
    ----------
    result : Result
        Of `simulate` or `read_bag`.
    path : str or Path
        File to write, ``.npz`` or ``.csv``.

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
    with replacing(path) as stream:
        if path.suffix == '.csv':
            _write_csv(result, stream)
            return
        np.savez(stream, **vars(result.run), joint_names=result.joint_names,
                 position_units=result.position_units, torque_units=result.torque_units,
                 control_period=result.config.control_period, law=result.law,
                 switching=result.config.switching, **result.gains)


def _write_csv(result: Result, stream: BinaryIO) -> None:
    """Write a line for each sample, below one with names and units."""
    heads, columns = ['t [s]'], [result.run.t]
    for name, suffix in _ARRAYS.items():
        units = (result.torque_units if suffix is None
                 else [unit + suffix for unit in result.position_units])
        heads += [f'{name}_{joint} [{unit}]' for joint, unit in zip(result.joint_names, units)]
        columns.extend(getattr(result.run, name).T)
    text = io.TextIOWrapper(stream, 'utf-8', 'backslashreplace', newline='')
    csv.writer(text).writerows([heads, *np.column_stack(columns).tolist()])
    text.detach()
