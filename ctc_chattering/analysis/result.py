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
A finished run with its numbers for ``metrics.json``.

`simulate` makes a `Result` without ROS, and `bags.reader.read_bag` makes one of a bag. Figures,
pages and exported files are made of results.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
import dataclasses
from functools import cached_property
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import Any

from ctc_chattering.analysis.metrics import (
    error_shares,
    metrics,
    WARN_ERROR_SHARE,
    WINDOW,
    window_of,
    within,
)
from ctc_chattering.analysis.signals import PARTS, Series, SignalOrigin
from ctc_chattering.analysis.terms import Replay, ReplayVerdict, RunTerms, terms
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.control.laws.registry import OF_SWITCHING
from ctc_chattering.controller.term_saturation import Saturation, term_saturation
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_parser import Tree
from ctc_chattering.errors import CtcError, shorten
from ctc_chattering.learning.learner import Learner
from ctc_chattering.learning.simulated_learner import make_learner
from ctc_chattering.number_format import format_numbers
from ctc_chattering.numerics.time_grid import missing
from ctc_chattering.output_files import write_json
from ctc_chattering.simulation.closed_loop import Array, Run, run_closed_loop
from ctc_chattering.simulation.plant import make_plant, Plant
import numpy as np
import numpy.typing as npt

#: The file of `write_metrics`.
METRICS = 'metrics.json'
#: Stands for the window that `window_of` chooses.
_BY_SAMPLES = (-inf, -inf)


def _run_array(name: str, quantity: str) -> Any:
    """Return a property with an array of `run`."""
    return property(lambda result: getattr(result.run, name), doc=f'Return {quantity}.')


def _desired_array(order: int, quantity: str) -> Any:
    """Return a property with an array of `run` without its correction."""
    return property(lambda result: result.run.desired[order], doc=f'Return {quantity}.')


class _RunArrays:
    """Arrays of a run as attributes of its result."""

    run: Run
    t: Array = _run_array('t', 'the time, shape (N,) [s]')
    q: Array = _run_array('q', 'the position, shape (N, n) [rad]')
    dq: Array = _run_array('dq', 'the velocity, shape (N, n) [rad/s]')
    q_d: Array = _desired_array(0, 'the desired position, shape (N, n) [rad]')
    dq_d: Array = _desired_array(1, 'the desired velocity, shape (N, n) [rad/s]')
    ddq_d: Array = _desired_array(2, 'the desired acceleration, shape (N, n) [rad/s²]')
    e: Array = _run_array('e', 'the position error q_d - q, shape (N, n) [rad]')
    de: Array = _run_array('de', 'the velocity error dq_d - dq, shape (N, n) [rad/s]')
    tau: Array = _run_array(
        'tau', 'the torque sent at the sample, shape (N, n) [N·m]; nan where it is unknown'
    )
    v: Array = _run_array('v', 'the filtered error of equation (3), shape (N, n) [rad/s]')


@dataclasses.dataclass(frozen=True, repr=False)
class Result(_RunArrays):
    """
    One run of one experiment.

    It has the samples, the law that ran, and numbers.

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
        Terms of the law, if they are known. By default they are computed when first asked for.
    description : str
        The URDF of the controller's model, or '' for a model that needs none.
    source : str
        Name of the bag, or '' for a simulation.
    window : (float, float), optional
        Part of the run over which metrics are computed [s]. The default is that of `window_of`.
    commands : Series, optional
        Torques sent, if they have times of their own. The default are those of `run`.
    replay : Replay, optional
        For a bag, the result of recomputing the law.
    topics : mapping of str to str
        For a bag, the topics of which each signal is taken or computed.
    off_reference : (float, float), optional
        For a bag, the first and last time at which the controller did not follow the reference
        [s].
    learner : Learner, optional
        For a simulation that learns, its passes and its correction.

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
    window: tuple[float, float] = _BY_SAMPLES
    commands: Series | None = None
    replay: Replay | None = None
    topics: Mapping[str, str] = dataclasses.field(default_factory=dict)
    off_reference: tuple[float, float] | None = None
    learner: Learner | None = None

    def __post_init__(self) -> None:
        """Choose a window that the run has."""
        if self.window == _BY_SAMPLES:
            object.__setattr__(self, 'window', window_of(self.run.t))

    def __repr__(self) -> str:
        """Return the run in a line, with its RMS errors."""
        error = format_numbers(metrics(self.run, self.window)['rms_error_rad'])
        begin, end = self.window
        return (
            f'<{self.label}: {len(self.run.t)} samples, RMS error {error} from {begin:g} to '
            f'{end:g} s>'
        )

    @cached_property
    def terms(self) -> RunTerms:
        """
        Return the parts of the torque, v and V.

        Those of a bag are recorded, every Nth sample, unless they can be computed exactly.
        """
        return self.law_terms or terms(
            self.run, self.configs, model_of(self.config, self.description)
        )

    @property
    def torque(self) -> Series:
        """
        Return the torques sent.

        Their times are those of the states that they answer, or those of reception.
        """
        return self.commands or Series(self.run.t, self.run.tau, self._origin_of_states)

    @property
    def _origin_of_states(self) -> SignalOrigin:
        return SignalOrigin.RECORDED if self.source else SignalOrigin.COMPUTED

    @cached_property
    def signals(self) -> dict[str, Series]:
        """Return all signals by the names in plots.js."""
        run, law = self.run, self.terms
        signs = {'nominal': 1.0, 'compensation': -1.0, 'robust': -1.0}
        at_states = {'q': run.q, 'dq': run.dq, 'q_d': self.q_d, 'e': run.e}
        at_terms = {
            'v': law.v,
            'V': law.lyapunov[:, None],
            **{name: signs[name] * getattr(law, name) for name in PARTS},
        }
        origins = self.origins
        return {
            **{name: Series(run.t, x, origins[name]) for name, x in at_states.items()},
            'torque': self.torque,
            **{name: Series(law.t, x, origins[name]) for name, x in at_terms.items()},
        }

    @property
    def origins(self) -> dict[str, SignalOrigin]:
        """Return the origin of each signal."""
        of_terms = SignalOrigin.COMPUTED if self.law_terms is None else self.law_terms.origin
        return {
            **dict.fromkeys(('q', 'dq'), self._origin_of_states),
            **dict.fromkeys(('q_d', 'e'), SignalOrigin.COMPUTED),
            'torque': self.torque.origin,
            **dict.fromkeys(('v', 'V', *PARTS), of_terms),
        }

    @property
    def config(self) -> ControllerConfig:
        """
        Return the configuration at the end.

        Model, joints and period never change.
        """
        return self.configs[-1][1]

    @property
    def law(self) -> str:
        """Return the law at the end."""
        return self.config.law

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints, as columns of the arrays."""
        return self.config.joint_names

    @property
    def changes(self) -> list[tuple[float, str]]:
        """Return the changes of law: time [s] and new law."""
        return [
            (t, new.law) for (_, old), (t, new) in pairwise(self.configs) if new.law != old.law
        ]

    @property
    def marks(self) -> list[tuple[float, str]]:
        """Return the changes of law or switching: time [s] and new one."""
        return [
            (t, new.law if new.law != old.law else new.switching)
            for (_, old), (t, new) in pairwise(self.configs)
            if (new.law, new.switching) != (old.law, old.switching)
        ]

    @property
    def laws(self) -> str:
        """Laws of the run in their order."""
        return ' → '.join([self.configs[0][1].law, *(law for _, law in self.changes)])

    @property
    def label(self) -> str:
        """Experiment and laws, for a legend."""
        return f'{self.experiment}: {self.laws}'

    @property
    def slug(self) -> str:
        """Experiment and law, for a file name."""
        return self.experiment if self.changes else f'{self.experiment}_{self.law}'

    @cached_property
    def position_units(self) -> tuple[str, ...]:
        """Return the unit of each joint's position: rad or m."""
        return position_units(self.joint_names, self.description)

    @property
    def torque_units(self) -> tuple[str, ...]:
        """Return the unit of each joint's torque: N·m or N."""
        return tuple('N' if unit == 'm' else 'N·m' for unit in self.position_units)

    @property
    def gains(self) -> dict[str, Any]:
        """Return the gains at the end, by parameter name."""
        config = self.config
        values = config.as_mapping()
        names = [
            'kp',
            'kv',
            *(
                name
                for name, spec in config.parameters().items()
                if name in config.law_parameters
                and spec.kind.startswith('float')
                and OF_SWITCHING.get(name, config.switching) == config.switching
            ),
        ]
        return {
            name: list(values[name]) if isinstance(values[name], tuple) else values[name]
            for name in names
        }

    @cached_property
    def missing(self) -> npt.NDArray[np.int64]:
        """
        Return the number of samples missing after each sample.

        The last sample has none: the shape is (N - 1,).
        """
        return missing(self.run.t, self.config.control_period)

    @cached_property
    def saturation(self) -> list[Saturation] | None:
        """
        Return the saturation of each joint in the window.

        A while after the start, and after each change of parameters, is not counted: v reaches 0
        then. The result is None without a sample under a law that takes ``ka``. It is also None
        if most samples of the term are unknown, as nobody knows then how long it stays there.
        """
        if self._terms_are_sparse:
            return None
        t, robust = self.terms.t, self.terms.robust
        inside = within(t, self.window)
        follows_gap = np.append(False, missing(t, self.config.control_period) > 0)
        recordings = []
        for (begin, config), (end, _) in pairwise([*self.configs, (np.inf, self.config)]):
            if config.takes('ka'):
                counted = inside & (t >= begin + 0.5) & (t < end)  # Within 0.5 s v reaches 0.
                rows = np.flatnonzero(counted)
                term = np.insert(robust[rows], np.flatnonzero(follows_gap[rows]), np.nan, axis=0)
                recordings.append((term, config.ka, config.switching_in_force))
        return term_saturation(recordings) or None

    @property
    def _terms_are_sparse(self) -> bool:
        """Return whether the terms of most samples are unknown."""
        return 2 * len(self.terms.t) < len(self.run.t)

    @property
    def _has_both_units(self) -> bool:
        """Return whether some joints are prismatic and others not."""
        return len(set(self.position_units)) > 1

    def metrics(self) -> dict[str, Any]:
        """
        Return the numbers of this run, its entry of ``metrics.json``.

        Returns
        -------
        dict
            All that `analysis.metrics.metrics` returns for `window`, such as ``rms_error_rad``, a
            number per joint. Experiment, bag, law, switching, period, joints, units and gains.
            ``term_at_bound``, the share of samples at which the chattering term of each joint is
            at its bound. ``origins``, the source of each signal's samples.

        """
        numbers = metrics(
            self.run,
            self.window,
            period=self.config.control_period,
            torque=self.torque,
            v=None if self.law_terms is None else self.signals['v'],
        )
        if self._has_both_units:
            numbers['max_error_norm1_rad'] = None
        return {
            'experiment': self.experiment,
            'bag': self.source or None,
            'law': self.law,
            'switching': self.config.switching,
            'control_period_s': self.config.control_period,
            'joint_names': list(self.joint_names),
            'position_units': list(self.position_units),
            'torque_units': list(self.torque_units),
            'gains': self.gains,
            **numbers,
            'term_at_bound': self.saturation and [x.fraction for x in self.saturation],
            'origins': {name: origin.value for name, origin in self.origins.items()},
            'notes': [
                *numbers['notes'],
                *self._notes(),
                *self._notes_on_errors(numbers['rms_error_rad']),
            ],
        }

    def _notes(self) -> Iterator[str]:
        """Yield facts that numbers alone would hide."""
        begin, end = self.window
        if self.window == window_of(self.run.t) != WINDOW:
            yield (
                f'metrics are computed from {begin:.4g} s to {end:.4g} s, the second half of '
                f'the run, because it has too little of {WINDOW[0]:g} s to {WINDOW[1]:g} s'
            )
        if self._has_both_units:
            yield (
                'there is no sum of errors, because prismatic joints have errors in m and the '
                'others in rad'
            )
        lost = int(self.missing.sum())
        if lost:
            source = 'all commands' if self.torque.received else 'consecutive ones'
            yield (
                f'{lost} of {lost + len(self.run.t)} samples are missing; errors are computed '
                f'from the others, the torque variation from {source}'
            )
        if self.off_reference:
            first, last = self.off_reference
            yield (
                f'between {first:.4g} s and {last:.4g} s the controller did not always follow '
                'the reference, for example after a pause; errors are those to the reference'
            )
        yield from self._notes_on_terms()
        for name, saturation in zip(self.joint_names, self.saturation or ()):
            if saturation.cause:
                yield f'{name}: {saturation}'

    def _notes_on_errors(self, rms_error: Sequence[float] | None) -> Iterator[str]:
        """Yield joints that hardly follow their motion."""
        if rms_error is None:
            return
        shares = error_shares(self.run, rms_error)
        large = np.flatnonzero(shares > WARN_ERROR_SHARE)
        if len(large):
            percent = [f'{100.0 * x:.0f}' for x in (shares[large].min(), shares[large].max())]
            cure = (
                'Set ka above friction and disturbance'
                if self.config.takes('ka')
                else ('Choose a law that takes friction into account (docs/laws.md)')
            )
            yield (
                f'{shorten([self.joint_names[i] for i in large])}: the RMS error is '
                f'{" to ".join(dict.fromkeys(percent))} % of the amplitude of the motion. '
                f'{cure}, or raise kp and kv'
            )

    def _notes_on_terms(self) -> Iterator[str]:
        """Yield the reason if the law is not recomputed."""
        if self.replay is None or self.replay.verdict is ReplayVerdict.EXACT:
            return
        origin = 'are not known'
        if self.terms.origin is not SignalOrigin.UNKNOWN:
            step = Series(self.terms.t, self.terms.v, self.terms.origin).step
            origin = f'are those that the controller published, every {1e3 * step:.3g} ms'
        yield f'{self.replay}; therefore v, V and the parts of the torque {origin}'
        if self._terms_are_sparse and self.config.takes('ka'):
            yield (
                'how often the chattering term is at its bound is not known; record with '
                'state_decimation 1'
            )


def simulate(
    setup: Setup,
    progress: Callable[[float], None] | None = None,
    truth: bool = False,
    robot: Plant | None = None,
    model: Model | None = None,
) -> Result:
    """
    Simulate the closed loop without ROS.

    The run is the same as that of the nodes in lockstep.

    Parameters
    ----------
    setup : Setup
        Configurations, as `load_parameters` returns them.
    progress : callable, optional
        Called at intervals with the simulated time [s].
    truth : bool
        Record the true state. By default the state that the sensors show is recorded.
    robot : Plant, optional
        Plant at its start, such as a `Plant`. The default is the one that `setup.plant` describes.
    model : Model, optional
        Model of the controller. The default is the one that its configuration names.

    Returns
    -------
    Result
        From t = 0 to the plant's `duration`, both included. Samples whose state is lost on the way
        to the controller are left out.

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
    description = setup.descriptions.get('controller', '')
    robot = robot or make_plant(setup.plant, setup.descriptions.get('plant', ''))
    model = model or model_of(setup.controller, description)
    learner = make_learner(setup, robot, model) if setup.reference.learning else None
    run = run_closed_loop(
        setup.plant,
        setup.controller,
        setup.reference,
        setup.events,
        progress,
        truth,
        route=setup.route,
        robot=robot,
        model=model,
        learner=learner,
    )
    configs = [(0.0, setup.controller)]
    for event in setup.events:
        if event.node == 'controller':
            configs.append((event.time, configs[-1][1].changed(event.values)))
    return Result(setup.plant.experiment, configs, run, description=description,
                  learner=learner)


def write_metrics(results: Sequence[Result], path: Path) -> None:
    """
    Write ``{"runs": [...]}``, with an object per run.

    It is strict JSON, with null for infinity and nan.

    Raises
    ------
    CtcError
        If the file cannot be written.

    """
    write_json({'runs': [result.metrics() for result in results]}, path)


def position_units(names: Sequence[str], description: str) -> tuple[str, ...]:
    """
    Return the unit of each joint's position.

    It is m for a joint that is prismatic in the URDF, and rad for all others.
    """
    units = {}
    with suppress(CtcError):
        units = {name: joint.position_unit for name, joint in Tree(description).joints.items()}
    return tuple(units.get(name, 'rad') for name in names)
