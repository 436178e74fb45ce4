"""The laws (2) and (6) against the equations written out in numpy."""

import dataclasses
import math
from typing import Any

import numpy as np
from oracles import Array, Generic, paper_c, paper_g, paper_m
import pytest

from ctc_chattering.core.controller import Controller, ControllerConfig, LAWS, Sample
from ctc_chattering.core.two_link import TwoLink
from ctc_chattering.errors import ParameterError

FULL = {'kp': [90.0, 20.0, 20.0, 130.0], 'kv': [40.0, -8.0, -8.0, 55.0], 'ka': [10.0, 4.0],
        'lambda': 7.0, 'b': 1.3, 'control_period': 0.002}


def _config(**values: Any) -> ControllerConfig:
    return ControllerConfig.from_mapping(values)


def _inputs(rng: np.random.Generator) -> list[list[float]]:
    """Return a random q, dq, q_d, dq_d, ddq_d."""
    return [(scale * rng.normal(size=2)).tolist() for scale in (2.0, 3.0, 2.0, 3.0, 20.0)]


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

    def step(self, chattering: bool, rows: list[list[float]]) -> tuple[Array, Array]:
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
