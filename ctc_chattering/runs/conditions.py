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
Conditions of a comparison: drives, sensors and model errors, on any robot.

`ctc compare` runs every law in the cases that this module makes. A `Condition` makes them for any
robot, a file lists them, and `held_out_cases` draws them. A condition replaces the drives,
sensors, network and model error of a parameter file, so that it means the same on every robot.
Friction, disturbance, elasticity and torque limits stay those of the file. A condition with stops
also replaces the motion's profile and the friction at rest. The controller is given what a lab can
know: delay, lag and rate limit of the drives, and the level of the Coulomb friction.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
import dataclasses
from math import inf
from pathlib import Path
from typing import Any, TYPE_CHECKING

from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.configuration.yaml_file import FileKind, mapping, read_yaml
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import ParameterError, suggest, UsageError
import numpy as np

if TYPE_CHECKING:
    from ctc_chattering.configuration.loop_setup import Overrides, Setup

#: Name of all conditions that a robot can have.
ALL = 'all'
#: Seed by default. No rule of gains and no law was chosen on its draws.
SEED = 26
#: Error by which a held-out run is lost [rad or m].
LOST_ERROR_RAD = 1.0
#: Shortest smooth start of a motion [s].
MIN_START_DURATION_S = 2.0


@dataclasses.dataclass(frozen=True)
class Case:
    """
    Parameters of one run in place of those of a file, with a name.

    Attributes
    ----------
    name : str
        Name of the condition, or within the group.
    overrides : mapping
        Parameters by node.
    group : str
        Heading of the table that has the case. It is empty outside a file of cases.
    part : str
        Name that tells the runs of a condition which has several.
    is_held_out : bool
        Whether the case was drawn, after all laws and rules were chosen.
    x : float, optional
        Abscissa in a figure over the group.

    """

    name: str
    overrides: Overrides = dataclasses.field(default_factory=dict)
    group: str = ''
    part: str = ''
    is_held_out: bool = False
    x: float | None = None

    @property
    def title(self) -> str:
        """Group and name."""
        return f'{self.group}: {self.name}' if self.group else self.name


@dataclasses.dataclass(frozen=True)
class Condition:
    """
    Differences from an ideal robot.

    Attributes
    ----------
    name : str
        For the command line and headings.
    lag : float
        Time constant of the drives [s].
    rate_limited : bool
        Whether the drives have the rate limit of `torque_rates`.
    delay : int
        Input delay, in samples.
    resolution : float
        Of the encoders [rad or m]; the velocity is then the difference of positions. 0 for none.
    cutoff : float
        Of a low-pass behind this difference [rad/s]; 0 for none.
    noise : float
        Standard deviation of the noise on the velocity [rad/s or m/s].
    payload : float
        Mass at the end of the arm that the controller's model lacks [kg].
    factors : tuple of float
        Of M, C and G in the controller's model, a run for each.
    friction_error : float
        Relative error of the friction that the controller is given. It is positive on every other
        joint and negative on the others, and changes its sign from run to run.
    stops : bool
        Whether the motion is that of `profile` trapezoid, and friction at rest half as large again
        as the Coulomb friction.

    """

    name: str
    lag: float = 0.0
    rate_limited: bool = False
    delay: int = 0
    resolution: float = 0.0
    cutoff: float = 0.0
    noise: float = 0.0
    payload: float = 0.0
    factors: tuple[float, ...] = (1.0,)
    friction_error: float = 0.0
    stops: bool = False

    def fits(self, setup: Setup) -> bool:
        """Return whether the robot of a parameter file can have the condition."""
        has_payload = setup.plant.described or not self.payload
        return has_payload and not (self.stops and setup.route is not None)

    def cases(self, setup: Setup) -> list[Case]:
        """
        Return the runs of the condition on the robot of a parameter file.

        Raises
        ------
        UsageError
            If the robot cannot have the condition.

        """
        if not self.fits(setup):
            needed = 'a motion without waypoints' if self.stops else 'a robot in a URDF'
            raise UsageError(f'condition {self.name} needs {needed}')
        drives = self._drives(setup)
        reference: dict[str, Any] = {
            'start_duration': max(setup.reference.start_duration, MIN_START_DURATION_S)}
        if self.stops:
            reference['profile'] = 'trapezoid'
        common: dict[str, Mapping[str, Any]] = {
            'plant': drives | self._sensors(setup) | self._load(setup), 'reference': reference,
            'bringup': {'events': ['']}}
        return [Case(
            self.name, common | {'controller': drives | self._assumptions(setup, run)},
            part=f'model_{factor:g}' if len(self.factors) > 1 else '')
            for run, factor in enumerate(self.factors)]

    def _drives(self, setup: Setup) -> dict[str, Any]:
        """Return the parameters of the drives, which the controller knows."""
        n = len(setup.plant.joint_names)
        rates = torque_rates(setup) if self.rate_limited else (inf,) * n
        return {'actuator_lag': [self.lag] * n, 'input_delay': self.delay,
                'torque_rate_limit': list(rates)}

    def _sensors(self, setup: Setup) -> dict[str, Any]:
        """Return the parameters of sensors and network."""
        n = len(setup.plant.joint_names)
        values = {
            'torque_resolution': [0.0] * n, 'position_noise': [0.0] * n,
            'velocity_noise': [self.noise] * n, 'encoder_resolution': [self.resolution] * n,
            'velocity_sensor': 'difference' if self.resolution else 'exact',
            'sample_loss': 0.0, 'sample_jitter': 0.0, 'late_samples': 0.0}
        if self.cutoff:
            values |= {'velocity_sensor': 'filtered', 'velocity_cutoff': self.cutoff}
        return values

    def _load(self, setup: Setup) -> dict[str, Any]:
        """Return payload and friction at rest of the plant."""
        values: dict[str, Any] = {'payload': self.payload}
        if self.stops:
            friction = setup.plant.coulomb_friction
            values['stribeck_friction'] = [0.5 * x for x in friction]
            values['stribeck_velocity'] = [0.01] * len(friction)  # [rad/s]
        return values

    def _assumptions(self, setup: Setup, run: int) -> dict[str, Any]:
        """Return model error, friction and error limit of the controller in a run."""
        factor = self.factors[run]
        friction = [x * (1.0 + self.friction_error * (1.0 - 2.0 * ((joint + run) % 2)))
                    for joint, x in enumerate(setup.plant.coulomb_friction)]
        return {'error_limit': [min(x, 3.0) for x in setup.controller.error_limit],  # [rad or m]
                'inertia_scale': factor, 'gravity_scale': factor, 'friction_level': friction}


_REAL_ARM = Condition('real_arm', lag=2e-3, rate_limited=True, delay=1, resolution=1e-5,
                      factors=(0.9, 1.1), friction_error=0.1)
#: All conditions by name, as docs/comparison.md describes them.
CONDITIONS = {condition.name: condition for condition in (
    Condition('clean'),
    Condition('lag', lag=2e-3),
    Condition('encoder', resolution=1e-5),
    Condition('noise', noise=5e-3),
    Condition('delay', delay=1),
    Condition('payload', payload=1.0),
    Condition('model_error', factors=(0.9, 1.1)),
    _REAL_ARM,
    dataclasses.replace(_REAL_ARM, name='real_arm_filtered', cutoff=500.0),
    dataclasses.replace(_REAL_ARM, name='stops', stops=True))}


def find_condition(name: str) -> Condition:
    """Return the condition of this name. Raise `UsageError` without one."""
    if name not in CONDITIONS:
        raise UsageError(f'no condition is called {name}; allowed: '
                         f'{", ".join((*CONDITIONS, ALL))}{suggest(name, CONDITIONS)}')
    return CONDITIONS[name]


def named_cases(names: Sequence[str], setup: Setup) -> list[Case]:
    """Return the cases of named conditions. `ALL` is each that fits, '' the file as it is."""
    conditions = [find_condition(name) for name in names if name not in ('', ALL)]
    if ALL in names:
        conditions = [x for x in CONDITIONS.values() if x.fits(setup)]
    unchanged = [Case('')] if '' in names else []
    return unchanged + [case for condition in conditions for case in condition.cases(setup)]


def read_cases(path: Path) -> tuple[Case, ...]:
    """
    Read a file of cases.

    Below ``cases`` it has groups of them, beside that ``overrides`` which all have.

    Raises
    ------
    CtcError
        Naming the key, its value and the allowed ones.

    """
    tree = mapping(f'{path}: spec', read_yaml(path, FileKind.CONDITIONS), ('overrides', 'cases'))
    common = _overrides(f'{path}: overrides', tree.get('overrides', {}))
    return tuple(
        Case(name, _above(common, _overrides(f'{path}: {group}: {name}', values, 'x')), group,
             x=values.get('x'))
        for group, cases in _section(f'{path}: cases', tree.get('cases')).items()
        for name, values in _section(f'{path}: {group}', cases).items())


#: Nodes that a file of cases may name.
_NODES = ('/**', *LOOP)


def _section(name: str, value: Any) -> dict[Any, Any]:
    """Return a mapping with any keys. Raise `ParameterError` for another value."""
    if not isinstance(value, dict):
        raise ParameterError(name, value, 'a mapping')
    return value


def _overrides(name: str, value: Any, *further_keys: str) -> Overrides:
    """Return the parameters by node that a part of the file has."""
    values = mapping(name, value, (*_NODES, *further_keys))
    return {node: _section(f'{name}: {node}', values[node]) for node in _NODES if node in values}


def _above(common: Overrides, own: Overrides) -> Overrides:
    """Return overrides of a case above those that all cases have."""
    return {node: {**common.get(node, {}), **own.get(node, {})} for node in _NODES
            if node in common or node in own}


def torque_rates(setup: Setup) -> tuple[float, ...]:
    """
    Return the rate limit of the drives, shape (n,) [N·m/s].

    It is that of the plant in the file. Without one, it is 5000 and 1000 N·m/s for the paper's
    arm, and the effort limit of the description within 50 ms for others. It is inf if nothing is
    known.
    """
    if min(setup.plant.torque_rate_limit) < inf:
        return setup.plant.torque_rate_limit
    if setup.controller.model == 'two_link':
        return 5_000.0, 1_000.0
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    return tuple(x / 0.05 for x in model.effort_limits) or (inf,) * model.n


def held_out_cases(setup: Setup, count: int, seed: int) -> Iterator[Case]:
    """Yield the first draws of a seed for the robot of a parameter file, the nominal one."""
    for index in range(count):
        yield Case(f'held_out_{seed}_{index}', _draw(setup, seed, index), is_held_out=True)


def _draw(setup: Setup, seed: int, index: int) -> Overrides:
    """Return drawn parameters. The order of the draws is part of their meaning."""
    rng = np.random.default_rng((seed, index))
    n = len(setup.plant.joint_names)

    def uniform(low: float, high: float) -> float:
        return float(rng.uniform(low, high))

    def scaled(values: Sequence[float], low: float, high: float) -> list[float]:
        factors = rng.uniform(low, high, len(values))
        return [float(x) for x in np.array(values) * factors]

    period = float(rng.choice((5e-4, 1e-3, 2e-3)))
    lag = uniform(0.0, 4e-3)
    delay = int(rng.integers(0, 3))
    assumed_lag = uniform(0.5, 1.5) * lag
    factor, assumed_factor = (2.0 ** float(x) for x in rng.uniform(-1.0, 1.0, 2))
    rates = [factor * x for x in torque_rates(setup)]
    resolution = 10.0 ** uniform(-6.0, -4.0)
    friction = scaled(setup.plant.coulomb_friction, 0.7, 1.3)
    plant: dict[str, Any] = {
        'actuator_lag': [lag] * n, 'torque_rate_limit': rates, 'input_delay': delay,
        'encoder_resolution': [resolution] * n, 'velocity_sensor': 'difference',
        'coulomb_friction': friction, 'stribeck_friction': scaled(friction, 0.0, 0.3),
        'stribeck_velocity': [10.0 ** uniform(-2.0, -1.0)] * n}
    controller = {
        'actuator_lag': [assumed_lag] * n,
        'torque_rate_limit': [assumed_factor * x for x in rates],
        'input_delay': delay, 'friction_level': list(setup.plant.coulomb_friction),
        'inertia_scale': uniform(0.85, 1.15), 'gravity_scale': uniform(0.85, 1.15),
        'error_limit': [LOST_ERROR_RAD] * n}
    payload = uniform(0.0, 1.0)
    if setup.plant.described:
        plant['payload'] = payload
    reference: dict[str, Any] = {
        'amplitude': scaled(setup.reference.amplitude, 0.4, 0.75),
        'frequency': scaled(setup.reference.frequency, 0.5, 1.3),
        'phase': rng.uniform(0.0, 2.0 * np.pi, n).tolist(),
        'start_duration': max(setup.reference.start_duration, MIN_START_DURATION_S)}
    offset = rng.uniform(-0.3, 0.3, n)
    plant['sample_loss'] = uniform(0.0, 0.1)
    plant['sample_jitter'] = uniform(0.0, 0.3) * period
    if index % 3 == 2:  # Every third draw starts away from the reference.
        start = (np.array(setup.reference.center)
                 + np.array(reference['amplitude']) * np.sin(reference['phase']) + offset)
        plant['initial_position'] = start.tolist()
    return {'/**': {'control_period': period}, 'plant': plant, 'controller': controller,
            'reference': reference, 'bringup': {'events': ['']}}
