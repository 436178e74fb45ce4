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
Conditions of a comparison, for any robot.

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
from ctc_chattering.learning.learner import duration_of_passes
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import make_motion
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
    Named overrides of a parameter file for one run.

    Attributes
    ----------
    name : str
        Name of the condition, or within the group.
    overrides : mapping
        Parameters by node.
    group : str
        Heading of the table that has the case. It is empty outside a file of cases.
    run_name : str
        Name that tells the runs of a condition which has several.
    is_held_out : bool
        Whether the case was drawn, after all laws and rules were chosen.
    x : float, optional
        Abscissa in a figure over the group.

    """

    name: str
    overrides: Overrides = dataclasses.field(default_factory=dict)
    group: str = ''
    run_name: str = ''
    is_held_out: bool = False
    x: float | None = None

    @property
    def title(self) -> str:
        """Group and name."""
        return f'{self.group}: {self.name}' if self.group else self.name


#: Parameters of an ideal plant, for each joint or for all. A condition replaces each of them.
_IDEAL_PLANT = {
    'actuator_lag': 0.0, 'torque_rate_limit': inf, 'input_delay': 0, 'torque_resolution': 0.0,
    'position_noise': 0.0, 'velocity_noise': 0.0, 'encoder_resolution': 0.0,
    'velocity_sensor': 'exact', 'sample_loss': 0.0, 'sample_jitter': 0.0, 'late_samples': 0.0,
    'payload': 0.0}
#: Those of them that the controller knows.
_KNOWN = ('actuator_lag', 'torque_rate_limit', 'input_delay')


@dataclasses.dataclass(frozen=True)
class Condition:
    """
    Differences from an ideal robot.

    Attributes
    ----------
    name : str
        For the command line and headings.
    plant : mapping
        Parameters of the plant. A number stands for each joint.
    rate_limited : bool
        Whether the drives have the rate limit of `torque_rates`.
    factors : tuple of float
        Factors of M, C and G in the controller's model, a run for each.
    friction_error : float
        Relative error of the friction that the controller is given. It is positive on every other
        joint and negative on the others, and changes its sign from run to run.
    stops : bool
        Whether the motion is that of `profile` trapezoid, and friction at rest half as large again
        as the Coulomb friction.

    """

    name: str
    plant: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    rate_limited: bool = False
    factors: tuple[float, ...] = (1.0,)
    friction_error: float = 0.0
    stops: bool = False

    def fits(self, setup: Setup) -> bool:
        """Return whether a robot can have the condition."""
        has_payload = setup.plant.described or 'payload' not in self.plant
        return has_payload and not (self.stops and setup.route is not None)

    def cases(self, setup: Setup) -> list[Case]:
        """
        Return the condition's cases for a parameter file.

        Raises
        ------
        UsageError
            If the robot cannot have the condition.

        """
        if not self.fits(setup):
            needed = 'a motion without waypoints' if self.stops else 'a robot in a URDF'
            raise UsageError(f'condition {self.name} needs {needed}; choose another condition')
        friction = setup.plant.coulomb_friction
        n = len(friction)
        plant = {name: [x] * n if PlantConfig.parameters()[name].shape else x
                 for name, x in {**_IDEAL_PLANT, **self.plant}.items()}
        reference: dict[str, Any] = {
            'start_duration': max(setup.reference.start_duration, MIN_START_DURATION_S)}
        if self.rate_limited:
            plant['torque_rate_limit'] = list(torque_rates(setup))
        if self.stops:
            plant['stribeck_friction'] = [0.5 * x for x in friction]
            plant['stribeck_velocity'] = [0.01] * n  # [rad/s]
            reference['profile'] = 'trapezoid'
        controller = {name: plant[name] for name in _KNOWN} | {
            'error_limit': [min(x, 3.0) for x in setup.controller.error_limit]}  # [rad or m]
        cases = []
        for run, factor in enumerate(self.factors):
            errors = [self.friction_error * (1.0 - 2.0 * ((joint + run) % 2))
                      for joint in range(n)]
            model = {'inertia_scale': factor, 'gravity_scale': factor,
                     'friction_level': [x * (1.0 + error) for x, error in zip(friction, errors)]}
            cases.append(Case(
                self.name, {'plant': plant, 'reference': reference, 'bringup': {'events': ['']},
                            'controller': controller | model},
                run_name=f'model_{factor:g}' if len(self.factors) > 1 else ''))
        return cases


_LAG = {'actuator_lag': 2e-3}
_DELAY = {'input_delay': 1}
_ENCODER = {'encoder_resolution': 1e-5, 'velocity_sensor': 'difference'}
_REAL_ARM = Condition('real_arm', {**_LAG, **_DELAY, **_ENCODER}, rate_limited=True,
                      factors=(0.9, 1.1), friction_error=0.1)
#: All conditions by name, as docs/comparison.md describes them.
CONDITIONS = {condition.name: condition for condition in (
    Condition('clean'),
    Condition('lag', _LAG),
    Condition('encoder', _ENCODER),
    Condition('noise', {'velocity_noise': 5e-3}),
    Condition('delay', _DELAY),
    Condition('payload', {'payload': 1.0}),
    Condition('model_error', factors=(0.9, 1.1)),
    _REAL_ARM,
    dataclasses.replace(_REAL_ARM, name='real_arm_filtered', plant={
        **_REAL_ARM.plant, 'velocity_sensor': 'filtered', 'velocity_cutoff': 500.0}),
    dataclasses.replace(_REAL_ARM, name='stops', stops=True))}


def find_condition(name: str) -> Condition:
    """
    Return the condition of this name.

    Raise `UsageError` if there is none.
    """
    if name not in CONDITIONS:
        raise UsageError(f'no condition is called {name}; allowed: '
                         f'{", ".join((*CONDITIONS, ALL))}{suggest(name, CONDITIONS)}')
    return CONDITIONS[name]


def named_cases(names: Sequence[str], setup: Setup) -> list[Case]:
    """
    Return the cases of named conditions.

    `ALL` is each that fits the robot, '' the file as it is.
    """
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
        Case(name, merge_overrides(common, _overrides(f'{path}: {group}: {name}', values, 'x')),
             group, x=values.get('x'))
        for group, cases in _section(f'{path}: cases', tree.get('cases')).items()
        for name, values in _section(f'{path}: {group}', cases).items())


#: Nodes that a file of cases may name.
_NODES = ('/**', *LOOP)


def _section(name: str, value: Any) -> dict[Any, Any]:
    """
    Return a mapping with any keys.

    Raise `ParameterError` for another value.
    """
    if not isinstance(value, dict):
        raise ParameterError(name, value, 'a mapping')
    return value


def _overrides(name: str, value: Any, *further_keys: str) -> Overrides:
    """Return the overrides in a part of the file."""
    values = mapping(name, value, (*_NODES, *further_keys))
    return {node: _section(f'{name}: {node}', values[node]) for node in _NODES if node in values}


def merge_overrides(first: Overrides, second: Overrides) -> Overrides:
    """Return overrides, `second` above `first`."""
    return {node: {**first.get(node, {}), **second.get(node, {})} for node in {**first, **second}}


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


def learning_setup(setup: Setup, passes: int) -> Setup:
    """
    Return a setup that learns, from a smooth start to the pass after so many others.

    Raise `CtcError` for a motion that is not periodic.
    """
    if setup.route is not None or setup.reference.speed_scaling != 1.0:
        raise UsageError('learning from passes needs a periodic motion, which has no '
                         'trajectory_file, and speed_scaling 1')
    start_duration = max(setup.reference.start_duration, MIN_START_DURATION_S)
    setup = setup.changed({'reference': {'learning': True, 'start_duration': start_duration}})
    motion = motion_of(setup.reference, None, make_motion(setup.reference, None, {}))
    return setup.changed({'plant': {'duration': seconds(duration_of_passes(motion, passes + 1))}})


def held_out_cases(setup: Setup, count: int, seed: int) -> Iterator[Case]:
    """
    Yield the first draws of a seed.

    The robot of the parameter file is the nominal one.
    """
    for index in range(count):
        yield Case(f'held_out_{seed}_{index}', _draw(setup, seed, index), is_held_out=True)


def _draw(setup: Setup, seed: int, index: int) -> Overrides:
    """
    Return drawn parameters.

    The order of the draws is part of their meaning.
    """
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
