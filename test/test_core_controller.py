"""The laws (2) and (6) against the equations written out in numpy."""

import dataclasses
import math
from typing import Any

import numpy as np
from oracles import Array, Generic, inclusion_by_enumeration, paper_c, paper_g, paper_m
import pytest

from ctc_chattering.core.controller import Controller, ControllerConfig, LAWS, Sample
from ctc_chattering.core.switching import SWITCHINGS
from ctc_chattering.core.two_link import TwoLink
from ctc_chattering.errors import ParameterError

Inputs = tuple[list[float], list[float], list[float], list[float], list[float]]
FULL = {'kp': [90.0, 20.0, 20.0, 130.0], 'kv': [40.0, -8.0, -8.0, 55.0], 'ka': [10.0, 4.0],
        'lambda': 7.0, 'b': 1.3, 'control_period': 0.002}


def _config(**values: Any) -> ControllerConfig:
    return ControllerConfig.from_mapping(values)


def _inputs(rng: np.random.Generator) -> Inputs:
    """Return a random q, dq, q_d, dq_d, ddq_d."""
    q, dq, q_d, dq_d, a = (s * rng.normal(size=2) for s in (2.0, 3.0, 2.0, 3.0, 20.0))
    return q.tolist(), dq.tolist(), q_d.tolist(), dq_d.tolist(), a.tolist()


class ByHand:
    """The paper's equations with full matrices, and the filter's exact sampled solution."""

    def __init__(self, values: dict[str, Any]) -> None:
        self.kp, self.kv = (np.array(values[k]) for k in ('kp', 'kv'))
        self.kp, self.kv = (
            np.diag(k) if k.size == 2 else k.reshape(2, 2) for k in (self.kp, self.kv))
        self.ka = np.diag(values['ka'])
        self.lambda_, self.b, self.h = (
            values['lambda'], values['b'], values['control_period'])
        self.xi = np.zeros(2)

    def step(self, chattering: bool, rows: Inputs) -> tuple[Array, Array]:
        """Return tau and v."""
        q, dq, q_d, dq_d, ddq_d = (np.array(row) for row in rows)
        e, de = q_d - q, dq_d - dq
        m, c, g = paper_m(rows[0]), paper_c(rows[0], rows[1]), paper_g(rows[0])
        v = self.xi - self.b * de
        tau = m @ (ddq_d + self.kv @ de + self.kp @ e) + c @ dq + g - c @ v
        if chattering:
            tau = tau - self.ka @ np.sign(v)
        decay = np.exp(-self.lambda_ * self.h)
        bracket = self.b * ((self.lambda_ * np.eye(2) - self.kv) @ de - self.kp @ e)
        self.xi = decay * self.xi + (1.0 - decay) / self.lambda_ * bracket
        return tau, v


@pytest.mark.parametrize('law', LAWS)
@pytest.mark.parametrize('gains', [
    {}, {'kp': [90.0, 130.0], 'kv': [40.0, 55.0]}, {'kp': [90.0, 130.0]},
    {'kp': [90.0, 0.0, 0.0, 130.0]}])
def test_law_by_hand(law: str, gains: dict[str, list[float]]) -> None:
    """Check 200 samples at random states, with full, diagonal and mixed gains, to 1e-10."""
    rng = np.random.default_rng(4)
    values = {**FULL, **gains}
    controller, oracle = Controller(_config(law=law, **values)), ByHand(values)
    for _ in range(200):
        rows = _inputs(rng)
        tau, v = oracle.step(law == 'chattering', rows)
        sample = controller.step(*rows)
        np.testing.assert_allclose(sample.tau, tau, rtol=1e-12, atol=1e-10)
        np.testing.assert_allclose(sample.v, v, rtol=1e-12, atol=1e-10)


def _gap(sample: Sample) -> float:
    parts = np.array(sample.inverse_dynamics) - sample.compensation - sample.chattering
    return float(np.abs(parts - sample.tau).max())


@pytest.mark.parametrize('law', LAWS)
def test_parts_add_up_to_the_torque(law: str) -> None:
    """Check tau and every part at random states."""
    rng = np.random.default_rng(0)
    controller = Controller(_config(law=law, **FULL))
    for _ in range(100):
        q, dq, q_d, dq_d, _ = rows = _inputs(rng)
        sample = controller.step(*rows)
        assert _gap(sample) == 0.0
        assert sample.e == (np.array(q_d) - q).tolist()
        assert sample.de == (np.array(dq_d) - dq).tolist()
        np.testing.assert_allclose(sample.compensation, paper_c(q, dq) @ sample.v, atol=1e-12)
        expected = np.array([10.0, 4.0]) * np.sign(sample.v) * (law == 'chattering')
        assert list(sample.chattering) == expected.tolist()
        assert controller.lyapunov(q, sample.v) == pytest.approx(
            0.5 * np.array(sample.v) @ paper_m(q) @ sample.v)


def test_on_the_reference_the_torque_is_the_feedforward() -> None:
    """Check e = de = 0: v stays 0, sgn(0) = 0, and tau is M ddq_d + C dq_d + G."""
    rng = np.random.default_rng(1)
    controller = Controller(_config(**FULL))
    for _ in range(20):
        q, dq, _, _, a = _inputs(rng)
        sample = controller.step(q, dq, q, dq, a)
        assert list(sample.v) == [0.0, 0.0] == list(sample.chattering)
        np.testing.assert_allclose(
            sample.tau, paper_m(q) @ a + paper_c(q, dq) @ dq + paper_g(q), atol=1e-11)


def test_closed_loop_is_equation_7() -> None:
    """Check M (dv/dt + λ v) + C v + Ka sgn(v) = 0 with dv/dt from (4), for b = 1."""
    rng = np.random.default_rng(2)
    kv, kp = (np.array(FULL[k]).reshape(2, 2) for k in ('kv', 'kp'))
    controller = Controller(_config(**{**FULL, 'b': 1.0}))
    for _ in range(50):
        q, dq, _, _, ddq_d = rows = _inputs(rng)
        sample = controller.step(*rows)
        v = np.array(sample.v)
        ddq = np.array(TwoLink().forward_dynamics(q, dq, sample.tau))
        rate = -(ddq_d - ddq + kv @ sample.de + kp @ sample.e) - 7.0 * v
        left = paper_m(q) @ (rate + 7.0 * v) + paper_c(q, dq) @ v + [10.0, 4.0] * np.sign(v)
        assert np.abs(left).max() < 1e-9


def test_effort_limit_bites_and_is_off_by_default() -> None:
    """Check that each joint is cut at its own limit and sign, and the parts are not cut."""
    q, dq, q_d, dq_d, a = [0.0, 0.0], [0.0, 0.0], [3.0, -3.0], [0.0, 0.0], [0.0, 0.0]
    free = Controller(ControllerConfig()).step(q, dq, q_d, dq_d, a)
    assert ControllerConfig().effort_limit == (math.inf, math.inf)
    assert abs(free.tau[0]) > 1000.0
    assert abs(free.tau[1]) > 30.0
    limited = Controller(_config(effort_limit=[100.0, 30.0])).step(q, dq, q_d, dq_d, a)
    assert limited.tau == np.clip(free.tau, [-100.0, -30.0], [100.0, 30.0]).tolist()
    assert limited.tau[0] == 100.0
    assert abs(limited.tau[1]) == 30.0
    assert limited.inverse_dynamics == free.inverse_dynamics
    one = Controller(_config(effort_limit=[math.inf, 30.0])).step(q, dq, q_d, dq_d, a)
    assert list(one.tau) == [free.tau[0], limited.tau[1]]
    wide = Controller(_config(effort_limit=[1e9, 1e9])).step(q, dq, q_d, dq_d, a)
    assert wide.tau == free.tau


def test_filter_lives_on_when_gains_change() -> None:
    """Check that v has no step at a change, and that law (2) only loses the chattering term."""
    rng = np.random.default_rng(3)
    steady, changing = (Controller(_config(**FULL)) for _ in range(2))
    for _ in range(30):
        rows = _inputs(rng)
        steady.step(*rows)
        changing.step(*rows)
    changing.configure(changing.config.changed({'law': 'compensation'}))
    rows = _inputs(rng)
    a, b = steady.step(*rows), changing.step(*rows)
    assert (a.v, a.inverse_dynamics, a.compensation) == (b.v, b.inverse_dynamics, b.compensation)
    assert any(a.v)
    assert list(b.chattering) == [0.0, 0.0]
    np.testing.assert_allclose(np.subtract(b.tau, a.tau), a.chattering, atol=1e-9)
    changing.configure(changing.config.changed({'kp': [1.0, 2.0], 'kv': [3.0, 4.0]}))
    rows = _inputs(rng)
    after = changing.step(*rows)
    assert after.v == steady.step(*rows).v
    q, dq, _, _, ddq_d = rows
    acceleration = ddq_d + np.array([3.0, 4.0]) * after.de + np.array([1.0, 2.0]) * after.e
    np.testing.assert_allclose(
        after.inverse_dynamics, paper_m(q) @ acceleration + paper_c(q, dq) @ dq + paper_g(q),
        rtol=1e-12)


def test_a_model_can_be_given() -> None:
    """Check that the generic model gives the closed form's torque; gravity comes from config."""
    rng = np.random.default_rng(6)
    rows = _inputs(rng)
    named = Controller(_config(**FULL)).step(*rows)
    given = Controller(_config(**FULL), Generic()).step(*rows)
    np.testing.assert_allclose(given.tau, named.tau, rtol=1e-12)
    floating = Controller(_config(gravity=0, **FULL)).step(*rows)
    np.testing.assert_allclose(np.subtract(named.tau, floating.tau), paper_g(rows[0]), atol=1e-9)


def test_defaults_are_the_paper_s() -> None:
    """Check section 4's numbers."""
    c = ControllerConfig()
    assert (c.kp, c.kv, c.ka) == ((100.0, 100.0), (50.0, 50.0), (10.0, 10.0))
    assert (c.lambda_, c.b, c.gravity, c.law) == (10.0, 1.0, 9.81, 'chattering')


def test_periods_are_on_the_grid() -> None:
    """Check that the period is refused off the nanoseconds, and the config is frozen."""
    with pytest.raises(ParameterError, match='control_period'):
        _config(control_period=1.5e-9)
    with pytest.raises(dataclasses.FrozenInstanceError):
        ControllerConfig().law = 'compensation'  # type: ignore[misc]


def _near(rng: np.random.Generator, size: float = 3e-3) -> Inputs:
    """Return a state near the desired one, where the implicit term has all its cases."""
    q, dq, _, _, a = _inputs(rng)
    return (q, dq, (q + size * rng.normal(size=2)).tolist(),
            (dq + size * rng.normal(size=2)).tolist(), a)


@pytest.mark.parametrize('switching', ['implicit', 'implicit_observer'])
def test_implicit_laws_by_hand(switching: str) -> None:
    """
    Check z ∈ Ka Sgn(v⁺), where M v⁺ / (b h) = M y / (b h) - C v - P̂ - z, by enumeration.

    y is exp(-λ h) v + (b h - c)(Kv de + Kp e), c = b (1 - exp(-λ h)) / λ; rests and bounds occur.
    """
    rng = np.random.default_rng(8)
    controller, rests, bounds = Controller(_config(switching=switching, **FULL)), 0, 0
    kp, kv = (np.array(FULL[name]).reshape(2, 2) for name in ('kp', 'kv'))
    decay, ka = np.exp(-7.0 * 0.002), np.array([10.0, 4.0])
    for k in range(300):
        rows = _near(rng)
        s = controller.step(*rows)
        mass, v = paper_m(rows[0]), np.array(s.v)
        free = decay * v + 1.3 * (0.002 - (1 - decay) / 7.0) * (kv @ s.de + kp @ s.e)
        wanted = (mass @ free / (1.3 * 0.002) - paper_c(rows[0], rows[1]) @ v
                  - controller.observer.estimate)
        z = inclusion_by_enumeration(mass, wanted, ka)
        np.testing.assert_allclose(s.chattering, z, atol=1e-8)
        assert _gap(s) == 0.0
        rests += int((np.abs(z) < 0.999 * ka).sum())
        bounds += int((np.abs(z) > 0.999 * ka).sum())
        assert any(controller.observer.estimate) == (switching == 'implicit_observer' and k > 0)
    assert rests > 30
    assert bounds > 30


def test_boundary_layer_by_hand() -> None:
    """Check Ka sat(v / width) in the law, inside and outside the layer."""
    rng = np.random.default_rng(9)
    controller = Controller(_config(switching='boundary_layer', boundary_layer=0.02, **FULL))
    inside = 0.0
    for _ in range(100):
        s = controller.step(*_near(rng, 1e-2))
        share = np.clip(np.divide(s.v, 0.02), -1.0, 1.0)
        assert s.chattering == pytest.approx((share * [10.0, 4.0]).tolist(), rel=1e-12)
        inside += (np.abs(share) < 1.0).mean() / 100
    assert 0.1 < inside < 0.95


@pytest.mark.parametrize('switching', SWITCHINGS)
@pytest.mark.parametrize('size', [1e-3, 1.0])
def test_the_term_is_within_the_gain(switching: str, size: float) -> None:
    """Check |tau - inverse + C v| <= Ka at every sample, the estimate being part of it."""
    rng = np.random.default_rng(10)
    controller = Controller(_config(switching=switching, observer_bandwidth=math.inf, **FULL))
    worst = np.zeros(2)
    for _ in range(300):
        s = controller.step(*_near(rng, size))
        both = np.abs([s.chattering, controller.observer.estimate])
        assert (both <= [10.0, 4.0]).all()
        added = np.abs(np.subtract(s.inverse_dynamics, s.compensation) - s.tau)
        assert (added <= [10.0 + 1e-9, 4.0 + 1e-9]).all()
        worst = np.maximum(worst, added)
    assert size < 1.0 or worst == pytest.approx([10.0, 4.0])


@pytest.mark.parametrize('delay', [0, 2])
@pytest.mark.parametrize('switching', SWITCHINGS)
def test_zero_gain_is_compensation(switching: str, delay: int) -> None:
    """Check tau bit for bit for ka = 0, with and without a delay, and that ka > 0 differs."""
    rng = np.random.default_rng(11)
    values = {**FULL, 'input_delay': delay, 'switching': switching}
    plain = Controller(_config(**values, law='compensation'))
    none = Controller(_config(**{**values, 'ka': [0.0, 0.0]}))
    some = Controller(_config(**{**values, 'ka': [0.0, 1e-3]}))
    for _ in range(60):
        rows = _near(rng, 1e-2)
        ahead = [_near(rng)[2:] for _ in range(delay)]
        a, b, c = (law.step(*rows, ahead) for law in (plain, none, some))
        assert a.tau == b.tau
        assert (a.v, a.inverse_dynamics) == (b.v, b.inverse_dynamics)
        assert c.tau != b.tau


@pytest.mark.parametrize('before', SWITCHINGS)
@pytest.mark.parametrize('after', SWITCHINGS)
def test_switching_is_bumpless(before: str, after: str) -> None:
    """Check that ξ, v and all but the term are bit-equal at the change, and ξ, v ever after."""
    rng = np.random.default_rng(12)
    steady, changing = (Controller(_config(switching=before, **FULL)) for _ in range(2))
    for _ in range(20):
        rows = _near(rng)
        steady.step(*rows)
        changing.step(*rows)
    changing.configure(changing.config.changed({'switching': after}))
    assert changing.filter.state == steady.filter.state
    differs = 0
    for _ in range(20):
        rows = _near(rng)
        a, b = steady.step(*rows), changing.step(*rows)
        assert changing.filter.state == steady.filter.state != [0.0, 0.0]
        assert (a.v, a.inverse_dynamics) == (b.v, b.inverse_dynamics)
        step = np.subtract(a.chattering, b.chattering)
        np.testing.assert_allclose(np.subtract(b.tau, a.tau), step, atol=1e-9)
        differs += bool(np.abs(step).max() > 0.01)
    assert (differs > 5) == (before != after)
