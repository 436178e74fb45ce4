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
"""Terms of friction that are selected by torque that was not fitted."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses

from ctc_chattering.identification import selection
from ctc_chattering.identification.friction_terms import TermKind
from ctc_chattering.identification.regression import Fit, mean_sign
from ctc_chattering.identification.selection import select
from ctc_chattering.identification.windows import Windows
from ctc_chattering.numerics.linear_algebra import Array
from made_up_windows import NO_BODIES, observed, velocities, windows
import numpy as np
import pytest

COUNT = 800
COULOMB = 2.0
NOISE = 0.02


def selected(extra: Callable[[Windows], Array], commanded: bool = True, seed: int = 0) -> Fit:
    """Return the fit of friction with a further torque of the first of two joints."""
    velocity, rng = velocities(COUNT, 2, seed), np.random.default_rng((seed, 1))
    load = 8.0 * np.sin(0.3 * np.arange(COUNT))[:, None] * [1.0, 0.7]
    rows = windows(velocity, load)
    torque = load + COULOMB * np.sign(velocity) + 0.5 * velocity
    torque[:, 0] += extra(rows)
    torque += NOISE * rng.normal(size=torque.shape)
    return select(observed(rows, torque), NO_BODIES, commanded).best


def added(solution: Fit, joint: int = 0) -> set[TermKind]:
    """Return the terms of a joint that not all joints have."""
    kinds = {solution.unknowns.term(k).kind for k in solution.unknowns.of_joint(joint)}
    return kinds - {TermKind.COULOMB, TermKind.VISCOUS, TermKind.OFFSET}


def coefficient(solution: Fit, kind: TermKind) -> float:
    return float(solution.unknowns.row(0, kind) @ solution.value)


@pytest.mark.parametrize('seed', range(4))
def test_plain_friction_needs_no_further_term(seed: int) -> None:
    solution = selected(lambda _: np.zeros(COUNT), seed=seed)
    assert not added(solution, 0) and not added(solution, 1)


def test_stribeck_friction_with_its_velocity() -> None:
    """A velocity between two of those that columns are prepared for."""
    solution = selected(lambda rows: 1.5 * np.sign(rows.velocity[:, 0]) * np.exp(
        -np.square(rows.velocity[:, 0] / 0.12)))
    assert added(solution) == {TermKind.STRIBECK} and not added(solution, 1)
    index = solution.unknowns.index(0, TermKind.STRIBECK)
    assert index is not None
    assert solution.unknowns.term(index).stribeck_velocity == pytest.approx(0.12, rel=0.05)
    assert coefficient(solution, TermKind.STRIBECK) == pytest.approx(1.5, rel=0.05)
    assert coefficient(solution, TermKind.COULOMB) == pytest.approx(COULOMB, rel=0.02)


def test_friction_of_the_load_is_that_of_the_torque_of_the_model() -> None:
    solution = selected(lambda rows: 0.1 * rows.load[:, 0])
    assert added(solution) == {TermKind.LOAD}
    assert coefficient(solution, TermKind.LOAD) == pytest.approx(0.1, rel=0.05)


def test_only_commands_have_a_dead_band() -> None:
    def band(rows: Windows) -> Array:
        friction = COULOMB * rows.direction[:, 0] + 0.5 * rows.velocity[:, 0]
        return 0.5 * np.sign(rows.model_torque[:, 0] + friction)

    solution = selected(band)
    assert added(solution) == {TermKind.DEAD_BAND}
    assert coefficient(solution, TermKind.DEAD_BAND) == pytest.approx(0.5, rel=0.1)
    assert TermKind.DEAD_BAND not in added(selected(band, commanded=False))


def test_friction_of_a_coupled_joint() -> None:
    solution = selected(lambda rows: 1.2 * rows.direction[:, 1] + 0.8 * rows.velocity[:, 1])
    assert added(solution) == {TermKind.COUPLED_COULOMB, TermKind.COUPLED_VISCOUS}
    assert coefficient(solution, TermKind.COUPLED_COULOMB) == pytest.approx(1.2, rel=0.05)
    assert coefficient(solution, TermKind.COUPLED_VISCOUS) == pytest.approx(0.8, rel=0.05)


def test_a_torque_that_is_mostly_friction_does_not_explain_itself() -> None:
    """Without any load, friction is no part of the load."""
    velocity = velocities(COUNT, 1, 3)
    torque = COULOMB * np.sign(velocity) + 0.5 * velocity + NOISE * np.random.default_rng(
        3).normal(size=velocity.shape)
    solution = select(observed(windows(velocity), torque), NO_BODIES, False).best
    assert not added(solution)
    assert coefficient(solution, TermKind.COULOMB) == pytest.approx(COULOMB, rel=0.01)


def test_a_dead_band_that_has_the_sign_of_the_motion_is_not_told_from_friction(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Torque of a light joint has that sign but at reversals, where a joint may stick."""
    velocity = velocities(COUNT, 1, 3)
    load = 0.3 * np.sin(0.3 * np.arange(COUNT))[:, None]
    rows = windows(velocity, load)
    torque = load + COULOMB * np.sign(velocity) + 0.5 * velocity
    sticking = mean_sign(torque) - rows.direction
    data = observed(rows, torque + 2.0 * sticking)
    solution = select(data, NO_BODIES, True).best
    assert not added(solution)
    assert coefficient(solution, TermKind.COULOMB) == pytest.approx(COULOMB, rel=0.02)
    limits = dataclasses.replace(selection.SELECTION, max_alike=1.1)
    monkeypatch.setattr(selection, 'SELECTION', limits)
    assert TermKind.DEAD_BAND in added(select(data, NO_BODIES, True).best)
