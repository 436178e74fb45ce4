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

"""The control step as machine code against plain Python: random states, settings, changes."""

from __future__ import annotations

import inspect
from typing import Any

from ctc_chattering.compiled import compilable
from ctc_chattering.compiled.build import build
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.controller import Controller, ControllerConfig
from ctc_chattering.control.irregular_sample import REGULAR, SampleIrregularity
from ctc_chattering.control.laws.registry import law_class, LAWS, SWITCHINGS
from ctc_chattering.control.step import PlainStep
from ctc_chattering.dynamics.compiled_model import arm_of
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from machine_code import compile_step
import numpy as np
import pytest
from urdfs import PANDA, panda

VARIANTS = [(law, switching) for law in LAWS
            for switching in (SWITCHINGS if law == 'chattering' else ('sign',))]
COMPILED = [('compensation', 'sign'), ('chattering', 'sign'), ('chattering', 'implicit_observer'),
            ('observer_feedback', 'sign')]
#: At its sample; before it; lost, with another reference; not come; late.
SAMPLES = (REGULAR, *(SampleIrregularity(*x) for x in (
    (-3e-4, 0.0, 1.0, 0.0), (0.0, -2e-3, 0.0, 1.0), (0.0, 0.0, 0.0, 0.0), (2e-4, 1e-4, 1.0, 1.0))))


def random_values(rng: np.random.Generator, n: int) -> dict[str, Any]:
    """Return gains and limits that reach every branch."""
    def each(low: float, high: float) -> list[float]:
        return [float(x) for x in rng.uniform(low, high, n)]

    def some(values: dict[str, Any]) -> dict[str, Any]:
        return {name: x for name, x in values.items() if rng.random() < 0.5}

    return {'kp': each(50.0, 400.0), 'kv': each(20.0, 60.0), 'ka': each(5.0, 30.0), **some({
        'lambda': rng.uniform(5.0, 40.0), 'b': rng.uniform(0.5, 2.0), 'boundary_layer': 0.5,
        'observer_bandwidth': rng.uniform(100.0, 2000.0), 'effort_limit': each(20.0, 200.0),
        'effort_rate_limit': each(1e3, 1e5), 'anti_windup': False, 'inertia_scale': 1.1,
        'gravity_scale': 0.9, 'friction_level': each(1.0, 9.0), 'actuator_lag': each(0.0, 3e-3),
        'torque_rate_limit': each(1e3, 1e5), 'input_delay': int(rng.integers(1, 4)),
        'control_period': 2e-3, 'friction_learning': 0.0})}


def model_of(n: int) -> tuple[Model, dict[str, Any]]:
    if n == 2:
        return TwoLink(), {}
    names = PANDA[:n]
    return UrdfModel(panda(), names), {'model': 'urdf', 'joint_names': list(names)}


def same(found: Any, right: Any) -> None:
    """Check records of records to 1e-10 of the largest number of each field."""
    for name, x, y in zip(right._fields, found, right):
        if hasattr(y, '_fields'):
            same(x, y)
        else:
            np.testing.assert_allclose(
                x, y, rtol=0.0, atol=1e-10 * max(1.0, np.abs(y).max()), err_msg=name)


def compiled_step(plain: Controller, model: Model) -> CompiledStep:
    """Return the step to come of a controller as machine code."""
    c = plain.config
    arm = arm_of(model, c.inertia_scale, c.gravity_scale)
    assert arm is not None

    def made() -> CompiledStep:
        return CompiledStep(
            plain.settings, plain.law, plain.memories, plain.transit.copy(), arm)
    found = made()
    if not found.compiled:
        for code in found.codes:
            build(code)
        found = made()
    return found


def check(law: str, switching: str, n: int, seed: int) -> None:
    """Compare steps after another law, regular or not, each from the memory of the plain one."""
    rng = np.random.default_rng(seed)
    model, names = model_of(n)
    config = ControllerConfig.from_mapping({
        **names, **random_values(rng, n), 'law': 'integral', 'switching': switching,
        'compiled': False})
    plain = Controller(config, model)
    # The observer takes a jump of the position for a force, over h².
    size = 10.0 ** (rng.uniform(-7.0, -4.0) if law == 'observer_feedback' else rng.uniform(-4, 0))
    start, h = rng.normal(size=n), plain.settings.period
    for k in range(20):
        if k == 5:
            plain.configure(config.changed({'law': law}))
        t = h * np.arange(k, k + 1 + config.input_delay)[:, np.newaxis]
        points = np.stack((start + np.sin(9.0 * t), 9.0 * np.cos(9.0 * t) + 0.0 * start,
                           -81.0 * np.sin(9.0 * t) + 0.0 * start), axis=1)
        q, dq = points[0, :2] + size * rng.normal(size=(2, n))
        if k > 5:
            step = compiled_step(plain, model)
            transit = plain.transit.copy()
            right = PlainStep(plain.settings, plain.law, plain.memories, transit, plain.model)
            irregularity = SAMPLES[k % len(SAMPLES)]
            rows = np.concatenate(((q, dq), points.reshape(-1, n)))
            for found, wanted in zip(
                    step.step(rows, irregularity), right.step(rows, irregularity)):
                np.testing.assert_allclose(
                    found, wanted, rtol=0.0, atol=1e-10 * max(1.0, np.abs(wanted).max()))
            for records in zip(step.memories, right.memories):
                same(*records)
            np.testing.assert_allclose(step.records.transit, transit, rtol=1e-10, atol=1e-9)
        plain.step(q, dq, points[0, 0], points[0, 1], points[0, 2], points[1:].tolist())
        assert not plain.compiled


def test_methods_of_one_name_take_as_much_in_all_records() -> None:
    """Compiled code looks up a method by its name, whatever the class."""
    assert all(map(law_class, LAWS))
    taken: dict[str, set[int]] = {}
    for kind in compilable.RECORDS:
        for name, method in inspect.getmembers(kind, inspect.isfunction):
            if not name.startswith('_') and kind.__module__.startswith('ctc_chattering.'):
                taken.setdefault(name, set()).add(len(inspect.signature(method).parameters))
    assert not {name: counts for name, counts in taken.items() if len(counts) > 1}


# What other tests need is compiled, too; the rest, half a minute each, by `.ci/run`.
@pytest.mark.parametrize(('law', 'switching', 'n'), [
    *((*variant, 2) for variant in VARIANTS if variant in COMPILED),
    *(pytest.param(*variant, 2, marks=pytest.mark.slow)
      for variant in VARIANTS if variant not in COMPILED),
    *(pytest.param(law, 'sign', 3, marks=pytest.mark.slow)
      for law in ('integral', 'observer_feedback')),
    *(pytest.param(*variant, 7, marks=pytest.mark.slow) for variant in VARIANTS)])
def test_a_step_is_that_of_plain_python(law: str, switching: str, n: int) -> None:
    for seed in range(4):
        check(law, switching, n, seed)


@pytest.mark.parametrize('where', [0, 1, 3])
def test_numbers_that_overflow_are_no_sample(where: int) -> None:
    """They would be a torque of inf or nan."""
    for compiled in (False, True):
        law = Controller(ControllerConfig(law='compensation', compiled=compiled))
        if compiled:
            compile_step(law)
        rest = [0.1, 0.2]
        assert law.try_step(rest, rest, rest, rest, rest) is not None
        assert law.compiled == compiled
        q, dq, q_d, dq_d = ([1e308, -1e308] if i == where else rest for i in range(4))
        with np.errstate(all='ignore'):
            assert law.try_step(q, dq, q_d, dq_d, rest) is None
        law.reset()
        assert law.try_step(rest, rest, rest, rest, rest) is not None
