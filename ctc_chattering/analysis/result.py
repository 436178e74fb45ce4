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

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
import csv
import dataclasses
from enum import auto, Enum
from functools import cached_property
import io
from itertools import cycle, groupby, pairwise
from math import inf
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

from ctc_chattering.analysis.metrics import (
    error_shares,
    metrics,
    WARN_ERROR_SHARE,
    WINDOW,
    window_of,
    within,
)
from ctc_chattering.analysis.signals import PARTS, Series, SignalOrigin
from ctc_chattering.analysis.terms import RunTerms, terms
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import LAWS, OF_SWITCHING
from ctc_chattering.controller.term_saturation import Saturation, term_saturation
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, ParameterError, shorten
from ctc_chattering.number_format import format_joint_values, format_numbers
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


class ReplayVerdict(Enum):
    """Outcome of recomputing the law over recorded states."""

    EXACT = auto()
    OTHER_TORQUES = auto()
    NOT_ONE_TO_ONE = auto()
    TOO_LONG = auto()


class Replay(NamedTuple):
    """
    The law recomputed over the states of a bag, compared with all that was recorded of it.

    Attributes
    ----------
    verdict : ReplayVerdict
        It is shown if it is `ReplayVerdict.EXACT` only.
    difference : tuple of float
        RMS of the difference to the torques recorded, a number a joint [N·m]; empty if it was not
        recomputed.

    """

    verdict: ReplayVerdict
    difference: tuple[float, ...] = ()

    def __str__(self) -> str:
        """Say why the law is not recomputed; empty where it is."""
        if self.verdict is ReplayVerdict.OTHER_TORQUES:
            return ('recomputed over the recorded states, the law has other torques than were '
                    f'sent, by {format_numbers(list(self.difference))} N·m RMS')
        return {ReplayVerdict.EXACT: '',
                ReplayVerdict.NOT_ONE_TO_ONE: 'not every state has one command that answers it',
                ReplayVerdict.TOO_LONG: 'the run is too long to recompute the law'}[self.verdict]


#: Time after a change in which v reaches 0 and the term may be at its bound [s].
_REACHING = 0.5
#: Stands for the window that `window_of` chooses.
_BY_THE_RUN = -inf, -inf


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
    law_terms : RunTerms, optional
        Terms of the law, if they are known; otherwise computed when first asked for.
    description : str
        The URDF of the controller's model; empty for a model that needs none.
    source : str
        Name of the bag; empty for a simulation.
    window : (float, float)
        Part of the run over which metrics are computed [s]; by default as `window_of` has it.
    commands : Series, optional
        Torques sent, where they have times of their own; otherwise they are those of `run`.
    replay : Replay, optional
        Of a bag: whether the law could be recomputed.
    topics : mapping of str to str
        Of a bag: the topics that each signal is taken or computed from.
    off_reference : (float, float), optional
        Of a bag: when the controller did not follow the reference, first and last time [s].

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
    law_terms: RunTerms | None = None
    description: str = ''
    source: str = ''
    window: tuple[float, float] = _BY_THE_RUN
    commands: Series | None = None
    replay: Replay | None = None
    topics: Mapping[str, str] = dataclasses.field(default_factory=dict)
    off_reference: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Choose a window that the run has."""
        if self.window == _BY_THE_RUN:
            object.__setattr__(self, 'window', window_of(self.run.t))

    def __repr__(self) -> str:
        """Return the run in a line, with its RMS errors in the window."""
        error = metrics(self.run, self.window)['rms_error_rad']
        begin, end = self.window
        return (f'<{self.label}: {len(self.run.t)} samples, RMS error {format_numbers(error)} '
                f'from {begin:g} to {end:g} s>')

    @cached_property
    def terms(self) -> RunTerms:
        """
        Return the parts of the torque, v and V; a simulation lacks what was not sent.

        Those of a bag are recorded, every Nth sample, unless they can be computed exactly.
        """
        return self.law_terms or terms(
            self.run, self.configs, model_of(self.config, self.description))

    @property
    def torque(self) -> Series:
        """Return the torques sent: at the states that they answer, or when they were received."""
        return self.commands or Series(self.run.t, self.run.tau, self._origin_of_states)

    @property
    def _origin_of_states(self) -> SignalOrigin:
        return SignalOrigin.RECORDED if self.source else SignalOrigin.COMPUTED

    @cached_property
    def signals(self) -> dict[str, Series]:
        """Return all signals by the names that plots.js lists, each with its origin."""
        run, law, origins = self.run, self.terms, self.origins
        of_run = {'q': run.q, 'dq': run.dq, 'q_d': run.q_d, 'e': run.e}
        of_law = {'v': law.v, 'V': law.lyapunov[:, None], 'nominal': law.nominal,
                  'compensation': -law.compensation, 'robust': -law.robust}
        return {
            **{name: Series(run.t, x, origins[name]) for name, x in of_run.items()},
            'torque': self.torque,
            **{name: Series(law.t, x, origins[name]) for name, x in of_law.items()}}

    @property
    def origins(self) -> dict[str, SignalOrigin]:
        """Return the origin of each signal."""
        of_law = SignalOrigin.COMPUTED if self.law_terms is None else self.law_terms.origin
        return {
            'q': self._origin_of_states, 'dq': self._origin_of_states,
            'q_d': SignalOrigin.COMPUTED, 'e': SignalOrigin.COMPUTED,
            'torque': self.torque.origin, 'v': of_law, 'V': of_law,
            **dict.fromkeys(PARTS, of_law)}

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
            if name in config.law_parameters and spec.kind.startswith('float')
            and OF_SWITCHING.get(name, config.switching) == config.switching)]
        return {name: list(x) if isinstance(x := values[name], tuple) else x for name in names}

    @cached_property
    def missing(self) -> npt.NDArray[np.int64]:
        """Return the number of samples missing after each sample but the last, shape (N - 1,)."""
        return missing(self.run.t, self.config.control_period)

    @cached_property
    def saturation(self) -> list[Saturation] | None:
        """
        Return how often the chattering term of each joint is at its bound within the window.

        The first `_REACHING` seconds after the start and after a change of parameters are not
        counted. None without a sample under a law that takes ``ka``, and where not each sample of
        the term is known: how long it stays at its bound is not known then.
        """
        t, parts = self.terms.t, []
        if self._terms_are_sparse:
            return None
        inside = within(t, self.window)
        gaps = np.append(0, missing(t, self.config.control_period)) > 0
        for (begin, config), (end, _) in pairwise([*self.configs, (np.inf, self.config)]):
            if config.takes('ka'):
                k = np.flatnonzero(inside & (t >= begin + _REACHING) & (t < end))
                parts.append((
                    np.insert(self.terms.robust[k], np.flatnonzero(gaps[k]), np.nan, axis=0),
                    config.ka, config.switching_in_force))
        return term_saturation(parts) or None

    @property
    def _terms_are_sparse(self) -> bool:
        """Return whether the terms of most samples are not known."""
        return 2 * len(self.terms.t) < len(self.run.t)

    def metrics(self) -> dict[str, Any]:
        """
        Return the numbers of this run, its entry of ``metrics.json``.

        Returns
        -------
        dict
            What `analysis.metrics.metrics` returns for `window`, such as ``rms_error_rad``, a
            number per joint; experiment, bag, law, switching, period, joints, units and gains;
            ``term_at_bound``, how often the chattering term of each joint is at its bound;
            ``origins``, where the samples of each signal come from.

        """
        numbers = metrics(
            self.run, self.window, period=self.config.control_period, torque=self.torque,
            v=None if self.law_terms is None else self.signals['v'])
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
            'origins': {name: origin.value for name, origin in self.origins.items()},
            'notes': [*numbers['notes'], *self._notes(mixed),
                      *self._notes_on_errors(numbers['rms_error_rad'])]}

    def _notes(self, mixed: bool) -> Iterator[str]:
        """Yield what else the user should know."""
        if self.window == window_of(self.run.t) != WINDOW:
            yield (f'metrics are computed from {self.window[0]:.4g} s to {self.window[1]:.4g} s, '
                   'the second half of the run: it has too little of '
                   f'{WINDOW[0]:g} s to {WINDOW[1]:g} s')
        if mixed:
            yield 'no sum of errors: prismatic joints have errors in m, the others in rad'
        lost = int(self.missing.sum())
        if lost:
            yield (f'{lost} of {lost + len(self.run.t)} samples are missing; errors are computed '
                   'from the others, the torque variation from '
                   + ('all commands' if self.torque.received else 'consecutive ones'))
        if self.off_reference:
            first, last = self.off_reference
            yield (f'between {first:.4g} s and {last:.4g} s the controller did not always follow '
                   'the reference, as after a pause; errors are those to the reference')
        yield from self._notes_on_terms()
        for name, found in zip(self.joint_names, self.saturation or ()):
            if found.cause:
                yield f'{name}: {found}'

    def _notes_on_errors(self, rms_error: Sequence[float] | None) -> Iterator[str]:
        """Yield which joints hardly follow their motion, and what can be done."""
        if rms_error is None:
            return
        shares = error_shares(self.run, rms_error)
        large = np.flatnonzero(shares > WARN_ERROR_SHARE)
        if len(large):
            low, high = (f'{100.0 * x:.0f}' for x in (shares[large].min(), shares[large].max()))
            cure = 'Set ka above friction and disturbance' if self.config.takes('ka') else (
                'Choose a law that takes friction into account (docs/laws.md)')
            yield (f'{shorten([self.joint_names[i] for i in large])}: the RMS error is '
                   f'{low if low == high else f"{low} to {high}"} % of the amplitude of the '
                   f'motion. {cure}, or raise kp and kv')

    def _notes_on_terms(self) -> Iterator[str]:
        """Yield which terms are shown where the law cannot be recomputed, and why."""
        if self.replay is None or self.replay.verdict is ReplayVerdict.EXACT:
            return
        if self.terms.origin is SignalOrigin.UNKNOWN:
            shown = 'are not known'
        else:
            every = 1e3 * Series(self.terms.t, self.terms.v, self.terms.origin).step
            shown = f'are those that the controller published, every {every:.3g} ms'
        yield f'{self.replay}: v, V and the parts of the torque {shown}'
        if self._terms_are_sparse and self.config.takes('ka'):
            yield ('how often the chattering term is at its bound is not known; record with '
                   'state_decimation 1')


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
    units = {}
    with suppress(CtcError):
        units = {name: joint.position_unit for name, joint in Tree(description).joints.items()}
    return tuple(units.get(name, 'rad') for name in names)


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
        config.switching for _, config in result.configs
        if 'switching' in config.law_parameters)]
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
    return {key: format_joint_values(value) for key, value in (
        *result.gains.items(), ('control_period', result.config.control_period))}


def _repeated(found: Sequence[str]) -> list[int]:
    counts = Counter(found)
    return [i for i, text in enumerate(found) if counts[text] > 1]


#: Arrays per joint with the suffix of the joint's position unit; None for the torque unit.
_ARRAYS = {'q': '', 'dq': '/s', 'q_d': '', 'dq_d': '/s', 'ddq_d': '/s²', 'tau': None, 'v': '/s'}


def commands_path(path: Path) -> Path:
    """Return where `export` writes torques at times of their own beside a CSV file."""
    return path.with_name(f'{path.stem}_commands.csv')


def export(result: Result, path: str | Path) -> None:
    """
    Write the samples of a run with names and units of the joints, for other programs.

    In a NumPy file: ``t``, shape (N,), and ``q, dq, q_d, dq_d, ddq_d, tau, v``, shape (N, n);
    ``command_t``, shape (M,), and ``command``, shape (M, n), all torques sent. Of a bag
    ``terms_t`` and ``nominal, compensation, robust, lyapunov``, the terms of the law;
    ``signals`` and ``origins``, whether each is recorded, computed exactly or not known.
    ``joint_names``, ``position_units``,
    ``torque_units``, shape (n,); ``control_period``, ``law``, ``switching`` and the gains by name,
    as at the end. In comma-separated values: a column per joint and quantity, below its name and
    unit, for example ``q_elbow [rad]``; torques that have times of their own are in
    ``NAME_commands.csv`` beside it. Numbers are exact, unknown ones are ``nan``.

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
    columns = {name: getattr(result.run, name) for name in _ARRAYS}
    with replacing(path) as stream:
        if path.suffix == '.npz':
            _write_arrays(result, stream)
        else:
            _write_columns(result, stream, result.run.t, columns)
    if path.suffix == '.csv' and result.commands is not None:
        with replacing(commands_path(path)) as stream:
            _write_columns(result, stream, result.torque.t, {'tau': result.torque.values})


def _write_arrays(result: Result, stream: BinaryIO) -> None:
    """Write the arrays of a run in NumPy's format."""
    terms = result.law_terms
    of_law: dict[str, Any] = {} if terms is None else {
        'terms_t': terms.t, 'nominal': terms.nominal, 'compensation': terms.compensation,
        'robust': terms.robust, 'lyapunov': terms.lyapunov}
    np.savez(
        stream, **vars(result.run), command_t=result.torque.t, command=result.torque.values,
        **of_law, signals=list(result.origins),
        origins=[origin.value for origin in result.origins.values()],
        joint_names=result.joint_names, position_units=result.position_units,
        torque_units=result.torque_units, control_period=result.config.control_period,
        law=result.law, switching=result.config.switching, **result.gains)


def _write_columns(result: Result, stream: BinaryIO, t: Array, arrays: Mapping[str, Array]
                   ) -> None:
    """Write times and arrays, each of shape (N, n), as comma-separated values."""
    heads, columns = ['t [s]'], [t]
    for name, values in arrays.items():
        suffix = _ARRAYS[name]
        units = (result.torque_units if suffix is None
                 else [unit + suffix for unit in result.position_units])
        heads += [f'{name}_{joint} [{unit}]' for joint, unit in zip(result.joint_names, units)]
        columns.extend(values.T)
    text = io.TextIOWrapper(stream, 'utf-8', 'backslashreplace', newline='')
    csv.writer(text).writerows([heads, *np.column_stack(columns).tolist()])
    text.detach()
