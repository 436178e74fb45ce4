"""The step in arrays, against the step in lists with the same model and the same measurements."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from oracles import Array, random_spd
import pytest
from urdfs import PANDA, panda, two_links

from ctc_chattering.core.array_model import ArrayModel
from ctc_chattering.core.controller import Controller, ControllerConfig, Sample
from ctc_chattering.core.model import Model, Rows, Vector
from ctc_chattering.core.plant import Plant, PlantConfig
from ctc_chattering.core.switching import SWITCHINGS
from ctc_chattering.core.two_link import TwoLink
from ctc_chattering.core.urdf import UrdfModel

FRICTION = (5.0, 5.0, 5.0, 5.0, 2.0, 2.0, 1.0)
WIDE = (15.0, 16.0, 17.0, 18.0, 6.0, 6.0, 3.0)
START = (0.0, -0.5, 0.0, -2.0, 0.0, 1.6, 0.8)
FIELDS = ('tau', 'e', 'de', 'v', 'inverse_dynamics', 'compensation', 'chattering')


class Lists(Model):
    """Another model without its arrays."""

    def __init__(self, model: Model) -> None:
        self.inner, self.n = model, model.n
        self.effort_limits = model.effort_limits

    def mass_matrix(self, q: Vector) -> Rows:
        return self.inner.mass_matrix(q)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        return self.inner.coriolis_matrix(q, dq)

    def gravity_torque(self, q: Vector) -> Vector:
        return self.inner.gravity_torque(q)

    def potential_energy(self, q: Vector) -> float:
        return self.inner.potential_energy(q)


class Arrays(ArrayModel):
    """The paper's arm with arrays that hold what the lists do."""

    n = 2
    gravity = 9.81

    def __init__(self) -> None:
        self.mass, self.coriolis, self.moment = np.zeros((2, 2)), np.zeros((2, 2)), np.zeros(2)
        self.arm = TwoLink()

    def mass_matrix(self, q: Vector) -> Rows:
        return self.arm.mass_matrix(q)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:
        return self.arm.coriolis_matrix(q, dq)

    def gravity_torque(self, q: Vector) -> Vector:
        return self.arm.gravity_torque(q)

    def potential_energy(self, q: Vector) -> float:
        return self.arm.potential_energy(q)

    def evaluator(self, q: Array, dq: Array) -> Callable[[], None]:
        def fill() -> None:
            at, going = q.tolist(), dq.tolist()
            self.mass[:] = self.arm.mass_matrix(at)
            self.coriolis[:] = self.arm.coriolis_matrix(at, going)
            self.moment[:] = [g / 9.81 for g in self.arm.gravity_torque(at)]
        return fill


def config(**changes: Any) -> ControllerConfig:
    return ControllerConfig(**{
        'model': 'urdf', 'joint_names': PANDA, 'ka': WIDE, 'switching': 'implicit_observer',
        **changes})


def same(made: Sample, wanted: Sample, size: float = 1e-9) -> None:
    for name in FIELDS:
        a, b = getattr(made, name), getattr(wanted, name)
        assert len(a) == len(b)
        assert all(type(x) is float for x in a)
        scale = 1.0 + np.abs(b).max()
        np.testing.assert_allclose(a, b, rtol=0, atol=size * scale, err_msg=name)
    assert (made.excess is None) == (wanted.excess is None)
    if made.excess is not None and wanted.excess is not None:
        scale = 1.0 + np.abs(wanted.tau).max()
        np.testing.assert_allclose(made.excess, wanted.excess, rtol=0, atol=size * scale)


def pair(settings: ControllerConfig) -> tuple[Controller, Controller, Plant]:
    """Return controllers with and without arrays, and a plant that shares the first's model."""
    model = UrdfModel(panda(), PANDA)
    made = Controller(settings, model)
    plant = Plant(PlantConfig(model='urdf', joint_names=PANDA, coulomb_friction=FRICTION,
                              initial_position=START), model)
    return made, Controller(settings, Lists(UrdfModel(panda(), PANDA))), plant


def motion(t: float) -> tuple[list[float], list[float], list[float]]:
    """Return a desired position, velocity and acceleration that is different for each joint."""
    w = np.linspace(3.0, 8.0, 7)
    return ((np.array(START) + 0.2 * (1 - np.cos(w * t))).tolist(),
            (0.2 * w * np.sin(w * t)).tolist(), (0.2 * w * w * np.cos(w * t)).tolist())


def follow(made: Controller, listed: Controller, plant: Plant, count: int = 60, first: int = 0
           ) -> list[Sample]:
    """Let both answer what the plant does under the first; return the samples of the second."""
    samples = []
    for k in range(first, first + count):
        q, dq = plant.measured
        desired = motion(k * 1e-3)
        sample, wanted = made.step(q, dq, *desired), listed.step(q, dq, *desired)
        same(sample, wanted)
        np.testing.assert_allclose(made.filter.state, listed.filter.state, atol=1e-9)
        np.testing.assert_allclose(made.observer.estimate, listed.observer.estimate, atol=1e-7)
        made.lyapunov(START, [1.0] * 7)  # asks the model for something else in between
        plant.step(sample.tau)
        samples.append(wanted)
    return samples


@pytest.mark.parametrize(('law', 'switching'), [
    ('compensation', 'sign'), *(('chattering', x) for x in SWITCHINGS)])
@pytest.mark.parametrize('limit', [float('inf'), 30.0])
def test_closed_loop(law: str, switching: str, limit: float) -> None:
    """Check every quantity of every sample, with torques that are limited and not."""
    limits = (limit, 11.0, limit, 5.0, limit, 12.0, 1.5) if limit < 1e9 else (limit,) * 7
    samples = follow(*pair(config(law=law, switching=switching, effort_limit=limits)))
    assert (max(abs(s.tau[1]) for s in samples) == 11.0) == (limit < 1e9)


@pytest.mark.parametrize('switching', SWITCHINGS)
@pytest.mark.parametrize('anti_windup', [False, True])
def test_limits(switching: str, anti_windup: bool) -> None:
    """Check limits of torque and of its rate, and a restart without a bump in between."""
    made, listed, plant = pair(config(
        switching=switching, anti_windup=anti_windup, effort_limit=(30.0,) * 7,
        effort_rate_limit=(2e4, 2e4, float('inf'), 3e3, 2e3, 1e3, 500.0)))
    samples = follow(made, listed, plant, 30)
    assert any(s.excess is not None for s in samples)
    for controller in (made, listed):
        controller.reset(bumpless=True, held=samples[-1].tau)
    again = follow(made, listed, plant, 30, 30)
    np.testing.assert_allclose(again[0].v, 0.0, atol=1e-12)
    assert np.abs(np.subtract(again[0].tau, samples[-1].tau)[6]) <= 0.5 * (1 + 1e-12)


@pytest.mark.parametrize('switching', ['implicit', 'implicit_observer'])
@pytest.mark.parametrize('part', [0.0, 0.5, 0.97])
def test_gains_that_friction_exceeds(switching: str, part: float) -> None:
    """Check the box problem and the cut, where a few joints or all are at their bounds."""
    ka = tuple(part * x for x in FRICTION[:4]) + WIDE[4:]
    settings = config(switching=switching, ka=ka)
    samples = follow(*pair(settings))
    hits = [sum(abs(z) == k for z, k in zip(s.chattering, ka)) for s in samples]
    assert max(hits) >= (1 if switching == 'implicit' and part > 0.9 else 2)
    assert all(abs(z) <= k for s in samples for z, k in zip(s.chattering, ka))


@pytest.mark.parametrize('gains', ['alike', 'diagonal', 'full'])
def test_gains(gains: str) -> None:
    """Check one gain for all joints, one for each, and matrices; b, λ and bandwidth as well."""
    rng = np.random.default_rng(1)
    kp, kv = (80.0,) * 7, (30.0,) * 7
    if gains == 'diagonal':
        kp, kv = (tuple(rng.uniform(20.0, 90.0, 7).tolist()) for _ in range(2))
    if gains == 'full':
        kp, kv = (tuple((30.0 * random_spd(rng, 7, 0.4)).ravel().tolist()) for _ in range(2))
    follow(*pair(config(kp=kp, kv=kv, lambda_=17.0, b=1.4, observer_bandwidth=400.0)))


def test_changes_while_it_runs() -> None:
    """Check that filter and estimate live on through every law, and are gone after reset."""
    made, listed, plant = pair(config())
    first = 0
    for changes in ({}, {'switching': 'sign'}, {}, {'ka': FRICTION}, {'ka': (0.5,) * 7},
                    {'kp': (70.0,) * 7},
                    {'law': 'compensation'}, {'switching': 'implicit'}, {'b': 1.2}, {}):
        for controller in (made, listed):
            controller.configure(config(**changes))
        follow(made, listed, plant, 15, first)
        first += 15
    assert any(made.observer.estimate)
    for controller in (made, listed):
        controller.reset()
    assert not any(made.observer.estimate)
    assert not any(made.filter.state)
    follow(made, listed, plant, 15, first)


def test_samples_stay_as_they_are() -> None:
    """Check that a later step does not change an earlier sample."""
    made, listed, plant = pair(config())
    sample = made.step(*plant.measured, *motion(0.0))
    wanted = listed.step(*plant.measured, *motion(0.0))
    made.step([1.0] * 7, [2.0] * 7, [3.0] * 7, [4.0] * 7, [5.0] * 7)
    same(sample, wanted)


def test_the_estimate_can_be_set_from_outside() -> None:
    """Check a reset of the observer alone, and of an estimate that is set before the first."""
    settings = config()
    made, listed, plant = pair(settings)
    for controller in (made, listed):
        controller.observer.estimate = [1.0, -2.0, 3.0, -4.0, 0.5, 0.6, -0.7]
        controller.configure(settings)
    follow(made, listed, plant, 5)


@pytest.mark.parametrize('switching', SWITCHINGS)
@pytest.mark.parametrize('model', [Arrays(), UrdfModel(two_links(), ('b', 'a'))])
def test_other_array_models(switching: str, model: ArrayModel) -> None:
    """Check C-ordered arrays, a copy in another order, and random states far from any motion."""
    settings = ControllerConfig(switching=switching, ka=(4.0, 9.0))
    made, listed = Controller(settings, model), Controller(settings, Lists(model))
    rng = np.random.default_rng(5)
    for _ in range(50):
        state = [rng.normal(size=2).tolist() for _ in range(5)]
        same(made.step(*state), listed.step(*state), 1e-8)


def test_with_a_delay_lists_are_used() -> None:
    """Check against the same without arrays, bit for bit."""
    settings = config(input_delay=1)
    model = UrdfModel(panda(), PANDA)
    made, again = Controller(settings, model), Controller(settings, model)
    ahead = [motion(1e-3)]
    step = type(again).step
    assert made.step(START, [0.0] * 7, *motion(0.0), ahead).tau == step(
        again, START, [0.0] * 7, *motion(0.0), ahead).tau


def test_values_that_are_no_numbers_stay_visible() -> None:
    made, _, _ = pair(config())
    q = [float('nan'), *START[1:]]
    assert np.isnan(made.step(q, [0.0] * 7, *motion(0.0)).tau).any()


def test_the_paper_s_arm_has_no_arrays() -> None:
    """Check that its steps are the method's, so that its numbers are what they were."""
    assert 'step' not in vars(Controller(ControllerConfig()))
    assert 'step' in vars(Controller(config(), UrdfModel(panda(), PANDA)))
