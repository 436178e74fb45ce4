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

"""Steps of the compiled plant are those of the plain one, also where parameters change."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ctc_chattering.compiled.build import build
from ctc_chattering.compiled.records import packed
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation.compiled_loop import inputs
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import CompiledPlantStep
import numpy as np
import pytest

EXAMPLES = Path(__file__).parents[2] / 'examples'
#: Samples of one robot.
STEPS = 4


def random_config(base: PlantConfig, rng: np.random.Generator) -> PlantConfig:
    """Return a configuration in which all that a plant has is there by turns."""
    kf = np.array(base.coulomb_friction)

    def each(low: float, high: float) -> list[float]:
        return [float(x) for x in rng.uniform(low, high, len(kf))]

    start = np.array(base.initial_position) + each(-0.3, 0.3)
    values = {
        'coulomb_friction': (kf * each(0.0, 1.5)).tolist(),
        'viscous_friction': (10.0 ** np.array(each(-2.0, 4.0))).tolist(),
        'stribeck_friction': (kf * each(0.0, 0.4)).tolist(), 'load_friction': each(0.0, 0.05),
        'friction_asymmetry': each(-0.4, 0.4), 'disturbance.amplitude': each(0.0, 2.0),
        'disturbance.frequency': each(0.0, 20.0), 'disturbance.push': each(-5.0, 5.0),
        'disturbance.push_duration': 2e-3, 'position_noise': each(0.0, 1e-4),
        'velocity_noise': each(0.0, 5e-3), 'encoder_resolution': each(0.0, 1e-4),
        'velocity_sensor': str(rng.choice(['difference', 'filtered'])), 'sample_loss': 0.5,
        'late_samples': 0.5, 'sample_jitter': 4e-4, 'torque_resolution': each(0.0, 0.1),
        'torque_rate_limit': (5e3 * kf).tolist(), 'actuator_lag': each(0.0, 3e-3),
        'torque_saturation': (5.0 * kf).tolist(), 'input_delay': int(rng.integers(1, 3)),
        'integration_step': 4e-4}
    moving = rng.choice([0.0, 1e-3, 0.5], len(kf)) * each(-1.0, 1.0)
    return base.changed({
        **{name: x for name, x in values.items() if rng.random() < 0.3},
        'initial_position': start.tolist(), 'initial_velocity': moving.tolist(),
        'noise_seed': int(rng.integers(1000))})


def at(plant: Plant) -> Any:
    """Return the numbers of the plain plant as compiled code has its own."""
    return packed(plant.state._replace(motion=plant.state.motion._replace(decided=True)))


def numbers(record: Any) -> Array:
    """Return all numbers of a record and of those in it."""
    return np.concatenate([
        numbers(x) if isinstance(x, np.void) else np.ravel(x).astype(float)
        for x in (record[name] for name in record.dtype.names)])


def compiled(config: PlantConfig, model: Model) -> CompiledPlantStep:
    """Return the machine code of a plant."""
    step = Plant(config, model).compiled_step
    assert step is not None
    for code in step.codes:
        build(code)
    made = Plant(config, model).compiled_step
    assert made is not None
    return made


def compared(config: PlantConfig, model: Model, rng: np.random.Generator) -> tuple[float, int]:
    """Return the largest difference after single steps, and how many modes were seen."""
    plain = Plant(config.changed({'compiled': False}), model)
    given, made = inputs(Plant(config, model), STEPS), compiled(config, model)
    state = made.records.state
    weight = np.array(model.gravity_torque(plain.q))
    kf, largest, modes = np.array(config.coulomb_friction), 0.0, set()
    for k in range(STEPS):
        tau = weight + kf * rng.uniform(-1.6, 1.6, plain.n)
        for name in given.dtype.names:
            made.received[name] = given[k][name]
        made.received['tau'] = tau
        made.call()
        plain.step(tau.tolist())
        modes.add(plain.modes)
        right = at(plain)
        found, wanted = numbers(state), numbers(right)
        largest = max(largest, float(np.max(np.abs(found - wanted) / (1.0 + np.abs(wanted)))))
        for name in state.dtype.names:
            state[name] = right[name]
    return largest, len(modes)


@pytest.mark.parametrize(('name', 'own', 'count'), [
    ('friction', '', 150), pytest.param('panda', '', 60, marks=pytest.mark.slow),
    # Compiled once more for another class.
    pytest.param('friction', 'own_friction:Hyperbolic', 150, marks=pytest.mark.slow)])
def test_one_step_is_the_same(name: str, own: str, count: int, monkeypatch: pytest.MonkeyPatch
                              ) -> None:
    monkeypatch.syspath_prepend(EXAMPLES)
    setup = parameter_file.load(config_directory() / f'{name}.yaml',
                                {'plant': {'friction_model': own}})
    model = model_of(setup.plant, setup.descriptions.get('plant', ''))
    rng, modes = np.random.default_rng(1), 0
    for _ in range(count):
        largest, seen = compared(random_config(setup.plant, rng), model, rng)
        assert largest < 1e-10
        modes += seen
    assert modes > count


#: A plant whose parameters change.
CHANGING = parameter_file.load(None, {'plant': {
    'position_noise': [1e-5, 0.0], 'velocity_noise': [0.0, 1e-3], 'velocity_sensor': 'filtered',
    'encoder_resolution': [1e-4, 0.0], 'sample_loss': 0.1, 'late_samples': 0.1, 'input_delay': 2,
    'actuator_lag': [1e-3, 2e-3], 'torque_rate_limit': [3e4, 2e4], 'duration': 1.0}})
TAU = np.random.default_rng(1).normal([0.0, 0.0], [60.0, 20.0], (400, 2))


def run(config: PlantConfig, changes: dict[int, dict[str, Any]]) -> Array:
    """Return what is seen of a plant, with the brakes on from sample 300 to 350."""
    plant, seen = Plant(config), []
    for k, tau in enumerate(TAU):
        if k in changes:
            plant.configure(plant.config.changed(changes[k]))
        plant.brake(300 <= k < 350)
        assert plant.computed_by == ('machine code' if config.compiled else 'plain Python')
        plant.step(tau)
        seen.append([*plant.q, *plant.dq, *plant.measured[0], *plant.measured[1], *plant.applied,
                     *plant.modes, plant.lost, plant.k, plant.t])
    return np.array(seen, float)


def test_changes_of_parameters_are_those_of_plain_python() -> None:
    compile_setups([CHANGING], print)
    changes = {100: {'coulomb_friction': [3.0, 1.0]}, 200: {'disturbance.push': [40.0, 0.0]}}
    right = run(CHANGING.plant.changed({'compiled': False}), changes)
    np.testing.assert_allclose(run(CHANGING.plant, changes), right, rtol=1e-9, atol=1e-9)
    assert np.abs(run(CHANGING.plant, {}) - right).max() > 1e-3
    assert right[:, 12].sum() > 10


def test_a_change_of_nothing_changes_nothing() -> None:
    """The state that is read back is the whole state, to the last bit."""
    compile_setups([CHANGING], print)
    changes: dict[int, dict[str, Any]] = {k: {} for k in range(3, 290, 7)}
    np.testing.assert_array_equal(run(CHANGING.plant, changes), run(CHANGING.plant, {}))
