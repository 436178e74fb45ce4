"""
M, C, G and accelerations of the models that compiled code has, against Pinocchio.

Not compiled: the tests of the compiled plant show that compiling changes rounding only.
"""

from __future__ import annotations

from typing import Any

from ctc_chattering.batch.records import record
from ctc_chattering.dynamics.arm import arm_of, body_scratch
from ctc_chattering.dynamics.compiled_model import CompiledModel, evaluate
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.scaled_model import Scaled
from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.errors import CtcError
import numpy as np
import pytest
from urdfs import joint, link, PANDA, panda, urdf


def branching() -> str:
    """Return a robot with two arms, a slide, skew axes, a fixed joint and one to be locked."""
    skew = '0.6 0 0.8'
    return urdf([
        link('base', 9.0, inertia=(1.0, 1.0, 1.0)),
        link('trunk', 4.0, (0.1, 0.2, 0.3), (0.3, 0.2, 0.4)),
        link('left', 2.0, (0.0, 0.1, 0.2), (0.05, 0.04, 0.03)),
        link('slide', 1.0, (0.1, 0.0, 0.3), (0.01, 0.02, 0.03)),
        link('right', 1.5, (0.2, -0.1, 0.1), (0.02, 0.03, 0.04)),
        link('tool', 0.7, (0.0, 0.0, 0.2), (0.01, 0.01, 0.02)),
        link('wrist', 0.5, (0.0, 0.05, 0.1), (0.004, 0.005, 0.006)),
        joint('turn', 'continuous', 'base', 'trunk', skew, '0.1 0 0.5', rpy='0.3 0.2 -0.4'),
        joint('shoulder', 'revolute', 'trunk', 'left', '0 1 0', '0 0.2 0.4', rpy='1 0 0.5'),
        joint('lift', 'prismatic', 'left', 'slide', '-0.6 0.8 0', '0 0 0.3', rpy='0 0.7 0'),
        joint('other', 'revolute', 'trunk', 'right', '1 0 0', '0 -0.2 0.4', rpy='0.2 0.1 0'),
        joint('bent', 'revolute', 'right', 'wrist', '0 0 1', '0 0 0.2', rpy='0.4 0 0'),
        joint('held', 'fixed', 'wrist', 'tool', xyz='0 0 0.1', more='', rpy='0 0.3 0')])


def robots() -> dict[str, Model]:
    return {
        'two links': TwoLink(9.81), 'panda': UrdfModel(panda(), PANDA),
        'branching': UrdfModel(branching(), ('lift', 'other', 'turn', 'shoulder'), 3.7,
                               {'bent': 0.6})}


@pytest.mark.parametrize('name', list(robots()))
@pytest.mark.parametrize('scales', [(1.0, 1.0), (0.8, 1.3)])
def test_the_terms_of_the_model(name: str, scales: tuple[float, float]) -> None:
    model = robots()[name]
    scaled = model if scales == (1.0, 1.0) else Scaled(model, *scales)
    n, rng = model.n, np.random.default_rng(5)
    arm = record(arm_of(model, model.gravity, *scales))  # type: ignore[attr-defined]
    body, M, C, G = record(body_scratch(n)), np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
    for _ in range(5):
        q, dq, u = rng.uniform(-2.0, 2.0, (3, n))
        evaluate(arm, q, dq, body, M, C, G)
        for found, right in zip((M, C, G), scaled.evaluate(q, dq)):
            np.testing.assert_allclose(found, right, rtol=0, atol=1e-12 * np.abs(right).max())
        mask, at = int(rng.integers(2 ** n)), (q.tolist(), dq.tolist())
        compiled = CompiledModel(arm, body)
        terms: tuple[tuple[Any, Any], ...] = (
            (compiled.forward_dynamics(q, dq, u, mask),
             scaled.forward_dynamics(*at, u.tolist(), mask)),
            (compiled.reaction(q, dq, u, mask), scaled.reaction(*at, u.tolist(), mask)),
            *zip(compiled.mass_and_bias(q, dq), scaled.mass_and_bias(*at)))
        for found, right in terms:
            size = np.abs(right).max()
            np.testing.assert_allclose(found, right, rtol=0, atol=1e-10 * (1.0 + size))


def test_joints_of_different_arms_do_not_act_on_each_other() -> None:
    """The oracle, Pinocchio, has zeros there too; that they are seen needs a state in motion."""
    model = robots()['branching']
    M, C = np.ones((4, 4)), np.ones((4, 4))
    arm = record(arm_of(model, 3.7))
    evaluate(arm, np.full(4, 0.3), np.full(4, 0.7), record(body_scratch(4)), M, C, np.zeros(4))
    for a, b in ((0, 1), (1, 0), (1, 3), (3, 1)):
        assert M[a, b] == C[a, b] == 0.0
    assert (np.abs(M[:, 2]) > 1e-3).all()


def test_another_model_is_refused() -> None:
    with pytest.raises(CtcError, match='no compiled dynamics for the model Scaled'):
        arm_of(Scaled(TwoLink(), 1.0, 1.0), 9.81)
