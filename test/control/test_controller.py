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

"""The laws (2) and (6) against the equations written out in numpy."""

import dataclasses
import math
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig, Sample
from ctc_chattering.control.controller_config import SWITCHINGS
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.errors import ParameterError
import numpy as np
from oracles import (
    Array,
    estimate_of,
    Generic,
    Masses,
    paper_c,
    paper_g,
    paper_m,
)
import pytest

PAPER = ('compensation', 'chattering')
Inputs = tuple[list[float], list[float], list[float], list[float], list[float]]
FULL = {'kp': [90.0, 20.0, 20.0, 130.0], 'kv': [40.0, -8.0, -8.0, 55.0], 'ka': [10.0, 4.0],
        'lambda': 7.0, 'b': 1.3, 'control_period': 0.002}


def _config(**values: Any) -> ControllerConfig:
    return ControllerConfig.from_mapping(values)


def _inputs(rng: np.random.Generator) -> Inputs:
    """Return a random q, dq, q_d, dq_d, ddq_d."""
    q, dq, q_d, dq_d, a = (s * rng.normal(size=2) for s in (2.0, 3.0, 2.0, 3.0, 20.0))
    return q.tolist(), dq.tolist(), q_d.tolist(), dq_d.tolist(), a.tolist()


def _gap(sample: Sample) -> float:
    parts = np.array(sample.nominal) - sample.compensation - sample.robust
    return float(np.abs(parts - sample.tau).max())


@pytest.mark.parametrize('law', PAPER)
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
        assert list(sample.robust) == expected.tolist()
        assert controller.lyapunov(q, sample.v) == pytest.approx(
            0.5 * np.array(sample.v) @ paper_m(q) @ sample.v)


def test_on_the_reference_the_torque_is_the_feedforward() -> None:
    """Check e = de = 0: v stays 0, sgn(0) = 0, and tau is M ddq_d + C dq_d + G."""
    rng = np.random.default_rng(1)
    controller = Controller(_config(**FULL))
    for _ in range(20):
        q, dq, _, _, a = _inputs(rng)
        sample = controller.step(q, dq, q, dq, a)
        assert list(sample.v) == [0.0, 0.0] == list(sample.robust)
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
        ddq = TwoLink().forward(*map(np.array, (q, dq, sample.tau)))
        rate = -(ddq_d - ddq + kv @ sample.de + kp @ sample.e) - 7.0 * v
        left = paper_m(q) @ (rate + 7.0 * v) + paper_c(q, dq) @ v + [10.0, 4.0] * np.sign(v)
        assert np.abs(left).max() < 1e-9


def test_the_filter_state_is_preserved_when_gains_change() -> None:
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
    assert (a.v, a.nominal, a.compensation) == (b.v, b.nominal, b.compensation)
    assert any(a.v)
    assert list(b.robust) == [0.0, 0.0]
    np.testing.assert_allclose(np.subtract(b.tau, a.tau), a.robust, atol=1e-9)
    changing.configure(changing.config.changed({'kp': [1.0, 2.0], 'kv': [3.0, 4.0]}))
    rows = _inputs(rng)
    after = changing.step(*rows)
    assert after.v == steady.step(*rows).v
    q, dq, _, _, ddq_d = rows
    acceleration = ddq_d + np.array([3.0, 4.0]) * after.de + np.array([1.0, 2.0]) * after.e
    np.testing.assert_allclose(
        after.nominal, paper_m(q) @ acceleration + paper_c(q, dq) @ dq + paper_g(q),
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


@pytest.mark.parametrize('switching', SWITCHINGS)
@pytest.mark.parametrize('size', [1e-3, 1.0])
def test_the_term_is_within_the_gain(switching: str, size: float) -> None:
    """Check |tau - inverse + C v| <= Ka at every sample, the estimate being part of it."""
    rng = np.random.default_rng(10)
    controller = Controller(_config(switching=switching, observer_bandwidth=math.inf, **FULL))
    worst = np.zeros(2)
    for _ in range(300):
        s = controller.step(*_near(rng, size))
        both = np.abs(np.array([s.robust, estimate_of(controller)]))
        assert (both <= [10.0, 4.0]).all()
        added = np.abs(np.subtract(s.nominal, s.compensation) - s.tau)
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
        assert (a.v, a.nominal) == (b.v, b.nominal)
        assert c.tau != b.tau


@pytest.mark.parametrize('before', SWITCHINGS)
@pytest.mark.parametrize('after', SWITCHINGS)
def test_switching_is_bumpless(before: str, after: str) -> None:
    """
    Check that ξ, v and all but the term are bit-equal at the change, and ξ, v ever after.

    At a change the observer forgets one sample; with 1200 rad/s that has gone after five.
    """
    rng = np.random.default_rng(12)
    steady, changing = (Controller(_config(switching=before, observer_bandwidth=1200.0, **FULL))
                        for _ in range(2))
    for _ in range(20):
        rows = _near(rng)
        steady.step(*rows)
        changing.step(*rows)
    changing.configure(changing.config.changed({'switching': after}))
    assert (changing.memories.control.xi == steady.memories.control.xi).all()
    differs = 0
    for _ in range(20):
        rows = _near(rng)
        a, b = steady.step(*rows), changing.step(*rows)
        assert (changing.memories.control.xi == steady.memories.control.xi).all()
        assert changing.memories.control.xi.any()
        assert (a.v, a.nominal) == (b.v, b.nominal)
        step = np.subtract(a.robust, b.robust)
        np.testing.assert_allclose(np.subtract(b.tau, a.tau), step, atol=1e-9)
        differs += bool(np.abs(step).max() > 0.01)
    assert (differs > 5) == (before != after)


STILL = ([0.0, 0.0], [0.0, 0.0])
AWAY = ([3.0, -3.0], [0.0, 0.0], [0.0, 0.0])


@pytest.mark.parametrize('delay', [0, 2])
@pytest.mark.parametrize('switching', SWITCHINGS)
@pytest.mark.parametrize('limits', [
    {'effort_limit': [60.0, 9.0]}, {'effort_rate_limit': [2e4, 3e3]},
    {'effort_limit': [60.0, 9.0], 'effort_rate_limit': [2e4, 3e3]},
    {'effort_limit': [60.0, math.inf], 'effort_rate_limit': [math.inf, 3e3]}, {}])
def test_effort_and_rate_limit_together(
        limits: dict[str, list[float]], switching: str, delay: int) -> None:
    """Check every torque of a random run against numpy's clip, first by the rate, then by size."""
    rng = np.random.default_rng(13)
    law = Controller(_config(switching=switching, input_delay=delay, **limits, **FULL))
    most = np.array(limits.get('effort_limit', [math.inf] * 2))
    step = np.array(limits.get('effort_rate_limit', [math.inf] * 2)) * 0.002
    last, cut, whole = np.zeros(2), 0, 0
    for k in range(100):
        rows = _near(rng, 1e-3) if k % 2 else _inputs(rng)
        s = law.step(*rows, [_near(rng)[2:] for _ in range(delay)])
        wanted = np.array(s.nominal) - s.compensation - s.robust
        tau = np.clip(np.clip(wanted, last - step, last + step), -most, most)
        assert list(s.tau) == tau.tolist()
        assert (s.saturation_error is None) == (tau == wanted).all()
        if s.saturation_error is not None:
            assert list(s.saturation_error) == (wanted - tau).tolist()
            cut += 1
        else:
            whole += 1
        last = tau
    assert (cut > 20) == bool(limits)
    assert limits or whole == 100


def test_a_rate_limit_set_while_running_goes_on_from_the_torque_in_force() -> None:
    """Check that the first torque under it is a step away from the last one without."""
    law = Controller(_config(law='compensation'))
    before = law.step(*STILL, *AWAY).tau
    law.configure(law.config.changed({'effort_rate_limit': [1e3, 2e3]}))
    after = law.step(*STILL, [-3.0, 3.0], *AWAY[1:]).tau
    np.testing.assert_allclose(
        np.subtract(after, before), -np.sign(before) * [1.0, 2.0], rtol=1e-9)


LIMITS = {'effort_limit': [6.0, 2.0], 'effort_rate_limit': [2e3, 1e3]}
MASS = np.array([[2.0, 0.7], [0.7, 0.5]])


def _saturated(switching: str, delay: int, law: str, **values: Any) -> tuple[Array, Array, int]:
    """
    Return by how much v misses a v without limits, the least it could by what is cut, and cuts.

    The plant is two masses in closed form; without limits, the v after next is exactly
    exp(-λ h) v + (b h - c) u - b h M⁻¹ (N - w), with w the torque wanted `delay` samples ago.
    """
    h, b, pole = 1e-3, 1.3, 7.0
    made = Controller(_config(
        switching=switching, input_delay=delay, law=law, b=b, ka=[3.0, 1.0],
        **{'lambda': pole}, **values), Masses(MASS.tolist()))
    decay = math.exp(-pole * h)
    rng, q, dq = np.random.default_rng(19), np.array([0.0, 0.3]), np.array([0.4, 0.0])
    q_d, dq_d = np.zeros(2), np.zeros(2)
    on_way = [(np.zeros(2), np.zeros(2))] * delay
    wanted_v, misses, effects, cuts = None, [], [], 0
    for _ in range(300):
        ddq_d = rng.normal(size=2) * [5.0, 9.0]
        goal = q_d.tolist(), dq_d.tolist(), ddq_d.tolist()
        s = made.step(q.tolist(), dq.tolist(), *goal, [goal] * delay)
        if wanted_v is not None:
            misses.append(np.abs(s.v - wanted_v))
        u = 50.0 * np.array(s.de) + 100.0 * np.array(s.e)
        saturation = np.zeros(2) if s.saturation_error is None else np.array(s.saturation_error)
        cuts += s.saturation_error is not None
        on_way.append((np.array(s.tau), saturation))
        tau, saturation = on_way.pop(0)
        residual = MASS @ (ddq_d + u) - tau - saturation
        wanted_v = (decay * np.array(s.v) + b * (h - (1.0 - decay) / pole) * u
                    - b * h * np.linalg.solve(MASS, residual))
        effects.append(np.abs(b * h * np.linalg.solve(MASS, saturation)))
        a = np.linalg.solve(MASS, tau)
        q, dq = q + h * dq + h * h / 2 * a, dq + h * a
        q_d, dq_d = q_d + h * dq_d, dq_d + h * ddq_d
    return np.array(misses), np.array(effects[:-1]), cuts


@pytest.mark.parametrize('delay', [0, 3])
@pytest.mark.parametrize(('switching', 'law'), [
    *((name, 'chattering') for name in SWITCHINGS), ('sign', 'compensation')])
def test_anti_windup_keeps_what_is_cut_off_out_of_v(
        switching: str, law: str, delay: int) -> None:
    """Check v at every sample: on, as if nothing were cut; off, less what the cut has cost."""
    misses, _, cuts = _saturated(switching, delay, law, **LIMITS)
    assert cuts > 200
    assert misses.max() < 1e-10
    misses, effects, cuts = _saturated(switching, delay, law, anti_windup=False, **LIMITS)
    assert cuts > 200
    assert effects.max() > 0.02
    np.testing.assert_allclose(misses, effects, atol=1e-10)
    misses, effects, cuts = _saturated(switching, delay, law)
    assert (cuts, effects.max()) == (0, 0.0)
    assert misses.max() < 1e-10


@pytest.mark.parametrize('switching', SWITCHINGS)
def test_the_prediction_knows_what_was_cut_off(switching: str) -> None:
    """Check a limited torque sent ahead against the undelayed law of the state it arrives in."""
    h, delay = 1e-3, 3
    values: dict[str, Any] = {'switching': switching, 'ka': [5.0, 5.0], 'observer_bandwidth': 1e-9}
    limit = {'effort_limit': [4.0, 1.5]}
    late = Controller(_config(input_delay=delay, **values, **limit), Masses(MASS.tolist()))
    prompt = Controller(_config(**values), Masses(MASS.tolist()))
    q, dq, sent, cuts = np.array([0.1, -0.1]), np.array([0.3, 0.4]), [np.zeros(2)] * delay, 0
    goals = [([0.1 * math.sin(3.0 * k * h), 0.2], [0.3 * math.cos(3.0 * k * h), 0.0],
              [-0.9 * math.sin(3.0 * k * h), 0.0]) for k in range(1000 + delay)]
    for k in range(1000):
        if k == delay:  # Until then, what was applied is no torque of a limited law.
            prompt.configure(prompt.config.changed(limit))
        s = late.step(q.tolist(), dq.tolist(), *goals[k], goals[k + 1:k + 1 + delay])
        seen = prompt.step(q.tolist(), dq.tolist(), *goals[k])
        assert s.v == pytest.approx(list(seen.v), abs=1e-9)
        sent.append(np.array(s.tau))
        if k >= delay and (switching != 'sign' or np.abs(s.v).min() > 1e-6):
            np.testing.assert_allclose(sent[k], seen.tau, atol=1e-6)
        cuts += s.saturation_error is not None
        a = np.linalg.solve(MASS, sent[k])
        q, dq = q + h * dq + h * h / 2 * a, dq + h * a
    assert 50 < cuts < 950 or switching == 'sign'


@pytest.mark.parametrize('switching', ['sign', 'boundary_layer'])
@pytest.mark.parametrize('gains', [{}, {'b': 0.5}])
def test_bumpless_reset_begins_with_the_inverse_dynamics(
        switching: str, gains: dict[str, float]) -> None:
    """Check the first torque to the last bit from a random state; v = -b de without `bumpless`."""
    rng = np.random.default_rng(15)
    law = Controller(_config(**{**FULL, **gains}, switching=switching))
    for _ in range(20):
        law.step(*_inputs(rng))
        law.reset(bumpless=True)
        s = law.step(*_inputs(rng))
        assert list(s.v) == list(s.robust) == [0.0, 0.0]
        assert list(s.tau) == list(s.nominal)
        assert any(law.step(*_inputs(rng)).v)
        law.reset(bumpless=True)
        law.reset()
        s = law.step(*_inputs(rng))
        assert list(s.v) == [-law.config.b * x for x in s.de]


@pytest.mark.parametrize('value', [[0.0, 1.0], [-1.0, 1.0], [math.nan, 1.0], [1.0] * 3])
@pytest.mark.parametrize('name', ['error_limit', 'effort_rate_limit'])
def test_limits_must_be_positive(name: str, value: list[float]) -> None:
    """Check that none, negative and missing ones are refused; .inf is the default and allowed."""
    with pytest.raises(ParameterError, match=name):
        _config(**{name: value})
    assert getattr(_config(), name) == (math.inf, math.inf)
    assert getattr(_config(**{name: [0.5, math.inf]}), name) == (0.5, math.inf)


def test_the_law_itself_does_not_know_the_error_limit() -> None:
    """Check that torques beyond it are the same to the last bit: the sender decides."""
    a, b = (Controller(_config(error_limit=x)).step(*STILL, *AWAY) for x in (
        [1e-3, 1e-3], [math.inf, math.inf]))
    assert a == b
