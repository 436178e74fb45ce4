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
Conditions of a comparison: drives, sensors and errors of the model, on any robot.

A condition replaces what the parameter file has of drives, sensors, network and model error, so
that a condition means the same on every robot; friction, disturbance, elasticity and limits of the
torque stay those of the file, but for a condition with stops: its motion stops, and friction at
rest is higher. What a lab can know, delay, lag and rate limit of the drives and the level of the
Coulomb friction, the controller is given; a law takes of it what it can use.
"""

from __future__ import annotations

from collections.abc import Sequence
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
#: Time in which a drive goes from no torque to its limit [s], where no rate limit is given.
_RISE = 0.05
#: Rate limit of the drives of the paper's arm, of which no effort limits are known [N·m/s].
_TWO_LINK_RATES = (5_000.0, 1_000.0)
#: With stops: rise of friction at rest over that of sliding, and its velocity [rad/s].
_RISE_AT_REST, _TRANSITION = 0.5, 0.01
#: Shortest smooth start [s], and error that counts as divergence [rad or m].
_START, _DIVERGED = 2.0, 3.0


@dataclasses.dataclass(frozen=True)
class Condition:
    """
    What differs from an ideal robot.

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
        Of M, C and G in the controller's model; a run for each.
    friction_error : float
        Part by which the friction is told wrong: up on every other joint, down on the others, and
        the other way round in every other run.
    stops : bool
        Whether the motion is that of `profile` trapezoid, and friction at rest, up to about
        0.01 rad/s, half as large again as the Coulomb friction.

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
        """Return whether the robot of a parameter file can have it."""
        return (setup.plant.described or not self.payload) and not (
            self.stops and setup.route is not None)

    def overrides(self, setup: Setup) -> tuple[Overrides, ...]:
        """
        Return what replaces values of a parameter file, for each run.

        Parameters
        ----------
        setup : Setup
            The file's.

        Raises
        ------
        UsageError
            If the robot cannot have the condition.

        """
        if not self.fits(setup):
            raise UsageError(f'condition {self.name} needs ' + (
                'a motion without waypoints' if self.stops else 'a robot in a URDF'))
        n = len(setup.plant.joint_names)
        drives: dict[str, Any] = {
            'actuator_lag': [self.lag] * n, 'input_delay': self.delay, 'torque_rate_limit': list(
                torque_rates(setup) if self.rate_limited else (inf,) * n)}
        plant = {
            **drives, 'torque_resolution': [0.0] * n, 'position_noise': [0.0] * n,
            'velocity_noise': [self.noise] * n, 'encoder_resolution': [self.resolution] * n,
            'velocity_sensor': (
                'filtered' if self.cutoff else 'difference' if self.resolution else 'exact'),
            **({'velocity_cutoff': self.cutoff} if self.cutoff else {}),
            'sample_loss': 0.0, 'sample_jitter': 0.0, 'late_samples': 0.0,
            'payload': self.payload, **(
                {'stribeck_friction': [_RISE_AT_REST * x for x in setup.plant.coulomb_friction],
                 'stribeck_velocity': [_TRANSITION] * n} if self.stops else {})}
        reference = {'start_duration': max(setup.reference.start_duration, _START),
                     **({'profile': 'trapezoid'} if self.stops else {})}
        return tuple({
            'plant': plant, 'reference': reference, 'bringup': {'events': ['']},
            'controller': {
                **drives, 'error_limit': [min(x, _DIVERGED) for x in setup.controller.error_limit],
                'inertia_scale': factor, 'gravity_scale': factor, 'friction_level': [
                    x * (1.0 + self.friction_error * (1.0 - 2.0 * ((i + k) % 2)))
                    for i, x in enumerate(setup.plant.coulomb_friction)]}}
            for k, factor in enumerate(self.factors))


_REAL_ARM = Condition('real_arm', lag=2e-3, rate_limited=True, delay=1, resolution=1e-5,
                      factors=(0.9, 1.1), friction_error=0.1)
#: All conditions by name; docs/comparison.md has them in words.
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


def condition(name: str) -> Condition:
    """Return the condition of this name, '' for the file's; raise `UsageError` without one."""
    if not name:
        return Case('')
    if name not in CONDITIONS:
        raise UsageError(f'no condition is called {name}; allowed: '
                         f'{", ".join((*CONDITIONS, ALL))}{suggest(name, CONDITIONS)}')
    return CONDITIONS[name]


def chosen(names: Sequence[str], setup: Setup) -> list[Condition]:
    """Return the conditions that names mean on a robot, `ALL` each that it can have."""
    found = [condition(name) for name in names if name != ALL]
    return [x for x in CONDITIONS.values() if x.fits(setup)] if ALL in names else found


@dataclasses.dataclass(frozen=True)
class Case(Condition):
    """A condition of which a file has the values of parameters, by node, and nothing else."""

    values: Overrides = dataclasses.field(default_factory=dict)

    def overrides(self, setup: Setup) -> tuple[Overrides, ...]:  # noqa: ARG002
        """Return what replaces values of a parameter file."""
        return self.values,


def read_cases(path: Path) -> tuple[Case, ...]:
    """
    Read a file of cases: under ``cases`` groups of them, above ``overrides`` that all have.

    Raises
    ------
    CtcError
        Naming the key, its value and what is allowed.

    """
    def each(name: str, tree: Any, keys: Sequence[str] | None = None) -> dict[Any, Any]:
        if keys is None and not isinstance(tree, dict):
            raise ParameterError(f'{path}: {name}', tree, 'a mapping')
        return mapping(f'{path}: {name}', tree, tuple(tree) if keys is None else keys)

    def by_node(name: str, tree: Any, *keys: str) -> dict[str, dict[str, Any]]:
        values = each(name, tree, (*nodes, *keys))
        return {node: each(f'{name}: {node}', values[node]) for node in nodes if node in values}

    contents = read_yaml(path, FileKind.CONDITIONS)
    tree, nodes = each('spec', contents, ('overrides', 'cases')), ('/**', *LOOP)
    common = by_node('overrides', tree.get('overrides', {}))
    found = []
    for group, cases in each('cases', tree.get('cases')).items():
        for name, case in each(group, cases).items():
            values = by_node(f'{group}: {name}', case, 'x')
            found.append(Case(f'{group}: {name}', values={
                node: common.get(node, {}) | values.get(node, {}) for node in nodes
                if node in common or node in values}))
    return tuple(found)


def torque_rates(setup: Setup) -> tuple[float, ...]:
    """
    Return the rate limit of the drives, shape (n,) [N·m/s].

    That of the plant in the file; where it has none, 5000 and 1000 N·m/s for the paper's arm, and
    the effort limit of the description within 50 ms for others. inf where nothing is known.
    """
    if min(setup.plant.torque_rate_limit) < inf:
        return setup.plant.torque_rate_limit
    if setup.controller.model == 'two_link':
        return _TWO_LINK_RATES
    model = model_of(setup.controller, setup.descriptions.get('controller', ''))
    return tuple(x / _RISE for x in model.effort_limits) or (inf,) * model.n


#: Error by which a run is lost [rad or m].
LOST = 1.0
#: Seed by default: no rule of gains and no law was chosen on its draws.
SEED = 26
#: Sample periods [s].
_PERIODS = (5e-4, 1e-3, 2e-3)


@dataclasses.dataclass(frozen=True)
class HeldOut(Condition):
    """A condition for which no law was chosen: the draw `index` of the seed `seed`."""

    seed: int = SEED
    index: int = 0

    def overrides(self, setup: Setup) -> tuple[Overrides, ...]:
        """Return what replaces values of a parameter file, which is the nominal robot."""
        rng, n = np.random.default_rng((self.seed, self.index)), len(setup.plant.joint_names)

        def times(values: tuple[float, ...], low: float, high: float) -> list[float]:
            return [float(x) for x in np.array(values) * rng.uniform(low, high, len(values))]

        period = float(rng.choice(_PERIODS))
        lag, delay = (float(rng.uniform(0.0, 4e-3)),) * n, int(rng.integers(0, 3))
        told_lag = [float(rng.uniform(0.5, 1.5)) * lag[0]] * n
        factor, told_factor = (2.0 ** float(x) for x in rng.uniform(-1.0, 1.0, 2))
        rates = [factor * x for x in torque_rates(setup)]
        resolution = 10.0 ** float(rng.uniform(-6.0, -4.0))
        friction = times(setup.plant.coulomb_friction, 0.7, 1.3)
        plant: dict[str, Any] = {
            'actuator_lag': list(lag), 'torque_rate_limit': rates, 'input_delay': delay,
            'encoder_resolution': [resolution] * n, 'velocity_sensor': 'difference',
            'coulomb_friction': friction, 'stribeck_friction': times(tuple(friction), 0.0, 0.3),
            'stribeck_velocity': [10.0 ** float(rng.uniform(-2.0, -1.0))] * n}
        known: dict[str, Any] = {
            'actuator_lag': told_lag, 'torque_rate_limit': [told_factor * x for x in rates],
            'input_delay': delay, 'friction_level': list(setup.plant.coulomb_friction),
            'inertia_scale': float(rng.uniform(0.85, 1.15)),
            'gravity_scale': float(rng.uniform(0.85, 1.15)), 'error_limit': [LOST] * n}
        payload = float(rng.uniform(0.0, 1.0))
        if setup.plant.described:
            plant['payload'] = payload
        motion: dict[str, Any] = {
            'amplitude': times(setup.reference.amplitude, 0.4, 0.75),
            'frequency': times(setup.reference.frequency, 0.5, 1.3),
            'phase': [float(x) for x in rng.uniform(0.0, 2.0 * np.pi, n)],
            'start_duration': max(setup.reference.start_duration, _START)}
        offset = rng.uniform(-0.3, 0.3, n)
        plant['sample_loss'] = float(rng.uniform(0.0, 0.1))
        plant['sample_jitter'] = float(rng.uniform(0.0, 0.3)) * period
        if self.index % 3 == 2:
            plant['initial_position'] = [
                float(c + a * np.sin(x) + d) for c, a, x, d in zip(
                    setup.reference.center, motion['amplitude'], motion['phase'], offset)]
        return {'/**': {'control_period': period}, 'plant': plant, 'controller': known,
                'reference': motion, 'bringup': {'events': ['']}},


def held_out(count: int, seed: int) -> tuple[HeldOut, ...]:
    """Return the first conditions of a seed."""
    return tuple(HeldOut(f'held_out_{seed}_{i}', seed=seed, index=i) for i in range(count))
