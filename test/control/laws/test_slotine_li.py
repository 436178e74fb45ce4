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

"""Slotine and Li's adaptive law, with the level of friction as its parameter."""

import copy
from typing import Any

from ctc_chattering.control.controller import Controller, ControllerConfig
from laws import error, GAINS, H, inputs, KP, KV, rattles, run, Terms
import numpy as np
from oracles import Array

GAMMA, GIVEN, WIDTH = np.array([150.0, 40.0]), np.array([2.0, 3.0]), 0.3
VALUES: dict[str, Any] = {'adaptation_gain': GAMMA.tolist(), 'friction_level': GIVEN.tolist(),
                          'friction_velocity': WIDTH}
SLOPE = np.linalg.inv(KV) @ KP


class ByHand:
    """The law in terms of dq_r and s."""

    def __init__(self) -> None:
        self.level = GIVEN

    def step(self, at: Terms, frozen: Any = None) -> Array:
        """Return the torque and adapt; `frozen` says which joints do not."""
        dq_r, ddq_r = at.dq_d + SLOPE @ at.e, at.ddq_d + SLOPE @ at.de
        s, y = dq_r - at.dq, np.tanh(dq_r / WIDTH)
        damping = np.diag(1.0 / np.diag(np.linalg.inv(at.M))) @ KV
        tau: Array = (at.M @ ddq_r + at.C @ dq_r + at.G + damping @ s + self.level * y)
        change = H * GAMMA * y * s
        if frozen is not None:
            change = np.where(frozen, 0.0, change)
        self.level = np.maximum(self.level + change, 0.0)
        return tau


def test_joints_at_their_limit_do_not_adapt() -> None:
    """Check 200 samples with limits, with and without anti-windup."""
    most = np.array([150.0, 20.0])
    for on in (True, False):
        hand, rng, frozen = ByHand(), np.random.default_rng(6), 0
        law = Controller(ControllerConfig.from_mapping({
            **GAINS, **VALUES, 'law': 'slotine_li', 'effort_limit': most.tolist(),
            'anti_windup': on}))
        for _ in range(200):
            rows = inputs(rng, 1.0)
            probe = copy.copy(hand)
            cut = (np.abs(probe.step(Terms(rows))) > most) & on
            wanted = hand.step(Terms(rows), cut)
            frozen += int(cut.sum())
            np.testing.assert_allclose(
                law.step(*rows).tau, np.clip(wanted, -most, most), rtol=1e-10, atol=1e-9)
        assert (frozen > 50) == on


def test_the_level_is_that_of_the_friction_and_the_error_shrinks() -> None:
    """Check f̂ = 9.9 N·m and 4 N·m to a tenth after a few seconds, and e against law (2)."""
    levels: dict[str, Any] = {'coulomb_friction': [9.9, 4.0]}
    gains: dict[str, Any] = {'adaptation_gain': [1000.0, 200.0]}
    found = run('slotine_li', 6.0, plant=levels, **gains)
    law, robust = Controller(ControllerConfig.from_mapping({'law': 'slotine_li', **gains})), []
    for k in range(len(found.t)):
        rows = (x[k].tolist() for x in (found.q, found.dq, found.q_d, found.dq_d, found.ddq_d))
        robust.append(np.abs(law.step(*rows).robust))
    np.testing.assert_allclose(np.max(robust[-1000:], axis=0), [9.9, 4.0], rtol=0.1)
    plain = error(run('compensation', 6.0, plant=levels))
    assert (error(found) < 0.2 * plain).all()


def test_it_starts_from_the_given_level() -> None:
    """Check that the right level, given, is as good at once as the adapted one later."""
    gains: dict[str, Any] = {'adaptation_gain': [0.0, 0.0]}
    right, none = (error(run('slotine_li', 6.0, friction_level=[f] * 2, **gains))
                   for f in (9.9, 0.0))
    assert (right < 0.2 * none).all()


def test_too_fast_an_adaptation_rattles() -> None:
    """Check condition (5), h Γ < K: on joint 2, K is about 0.55 · 50 N·m·s/rad."""
    most = 0.55 * 50.0 / 1e-3
    assert rattles('slotine_li', {'adaptation_gain': [100.0, 0.6 * most]},
                   {'adaptation_gain': [100.0, 2.0 * most]})
