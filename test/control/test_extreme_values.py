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

"""No parameters that are accepted make the numeric core raise, or send what is not finite."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
import math
import random
from typing import Any, TypeVar

from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.parameters import Config, LARGEST, LEAST, Parameter
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig, Sinusoid
from hypothesis import given, HealthCheck, settings
from hypothesis import strategies as st
import pytest
from urdfs import two_links

# numpy warns of what overflows; the law then has no sample.
pytestmark = pytest.mark.filterwarnings('ignore::RuntimeWarning')

C = TypeVar('C', bound=Config)
#: Parameters that set up something else than numbers; the rest is drawn.
FIXED = ('joint_names', 'model', 'description', 'locked', 'pacing', 'experiment',
         'trajectory_file', 'learning_file', 'duration', 'integration_step', 'input_delay', 'compiled',
         'friction_model')
STEPS = 12
LIMITED = settings(
    max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
seeds = st.integers(0, 10 ** 6)


def rows(seed: int) -> Iterator[list[list[float]]]:
    """Yield five vectors for ever: what a robot may say, drawn without the cost of hypothesis."""
    dice = random.Random(seed)
    while True:
        yield [[dice.choice([0.0, 5e-324, *4 * [dice.uniform(-30.0, 30.0)]])
                for _ in range(2)] for _ in range(5)]


def number(spec: Parameter) -> st.SearchStrategy[float]:
    """Draw from both ends of what is allowed, from beyond, and from between."""
    low, high = spec.bounds
    ends = [low, high, -low, -high, 0.0, 5e-324, 2.2e-308, 1e-300, 1e300, 1.7e308, math.inf,
            LEAST, LARGEST]
    between = st.floats(max(low, -100.0), min(high, 100.0))
    return st.one_of(between, st.sampled_from(ends), st.floats(low, high))


def values(config: type[Config]) -> st.SearchStrategy[dict[str, Any]]:
    """Draw some parameters of a configuration."""
    drawn: dict[str, st.SearchStrategy[Any]] = {}
    for name, spec in config.parameters().items():
        if name in FIXED:
            continue
        if spec.kind == 'float':
            drawn[name] = st.sampled_from([1e-9, 1e-6, 1e-3, 0.1, 10.0]) if (
                name == 'control_period') else number(spec)
        elif spec.kind == 'float[]':
            drawn[name] = st.lists(number(spec), min_size=2, max_size=2)
            if spec.shape == 'nn':
                drawn[name] |= st.tuples(number(spec), number(spec), number(spec)).map(
                    lambda x: [x[0], x[1], x[1], x[2]])
        elif spec.kind == 'str':
            drawn[name] = st.sampled_from(spec.choices)
        elif spec.kind == 'bool':
            drawn[name] = st.booleans()
        else:
            drawn[name] = st.integers(0, 1000)
    return st.fixed_dictionaries({}, optional=drawn)


def accepted(config: type[C], given_: dict[str, Any]) -> C:
    """Return the configuration with those of the values that are allowed one by one."""
    taken = {}
    for name, value in given_.items():
        try:
            config.from_mapping({name: value})
        except ParameterError:
            continue
        taken[name] = value
    return config.from_mapping(taken)


@pytest.mark.parametrize(('urdf', 'delay'), [(False, 0), (True, 0), (False, 2)])
@LIMITED
@given(values(ControllerConfig), values(ControllerConfig), seeds)
def test_the_law(urdf: bool, delay: int, first: dict[str, Any], second: dict[str, Any], seed: int
                 ) -> None:
    """
    Every torque is finite and within its limit, also after a change of the parameters.

    A prediction, of the law or over samples of delay, may overflow: then there is no torque.
    """
    config = accepted(ControllerConfig, first).changed({'input_delay': delay})
    law = Controller(config, UrdfModel(two_links(), ('a', 'b')) if urdf else TwoLink())
    for _ in range(2):
        for q, dq, q_d, dq_d, ddq_d in islice(rows(seed), STEPS):
            sample = law.try_step(q, dq, q_d, dq_d, ddq_d, [(q_d, dq_d, ddq_d)] * delay)
            if sample is None:
                assert delay or config.law in ('extended_state_observer', 'observer_feedback')
                law.reset(bumpless=True)
                continue
            assert math.isfinite(sum(sample.tau) + sum(sample.v))
            assert all(abs(x) <= limit for x, limit in zip(sample.tau, config.effort_limit))
            assert config.law != 'chattering' or all(
                abs(x) <= k for x, k in zip(sample.robust, config.ka))
        config = config.changed({name: value for name, value in accepted(
            ControllerConfig, second).as_mapping().items()
            if not ControllerConfig.parameters()[name].read_only})
        law.configure(config)


@settings(LIMITED, max_examples=10)
@given(values(PlantConfig), seeds)
def test_the_plant(given_: dict[str, Any], seed: int) -> None:
    """It moves by finite numbers, or says in one line that the motion diverged."""
    config = accepted(PlantConfig, given_).changed({'integration_step': 10.0})
    plant = Plant(config)
    try:
        for tau, *_ in islice(rows(seed), STEPS // 2):
            plant.step(tau)
            plant.brake(not plant.braking)
            assert math.isfinite(sum(plant.q) + sum(plant.dq))
            assert all(math.isfinite(sum(row)) for row in (*plant.measured, plant.applied))
    except CtcError as error:
        assert 'the motion of the plant diverged' in str(error)


@LIMITED
@given(values(ReferenceConfig), st.integers(0, 10 ** 18))
def test_the_motion(given_: dict[str, Any], t: int) -> None:
    point = Sinusoid(accepted(ReferenceConfig, given_)).at(t)
    assert all(math.isfinite(x) for row in point for x in row)
