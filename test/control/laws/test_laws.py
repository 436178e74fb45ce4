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

"""The bounds that the page of the laws names, and errors of laws beside those of others."""

from __future__ import annotations

from typing import Any

from laws import error, rattles, run
import numpy as np
from oracles import paper_m
import pytest

#: 1.33, the largest eigenvalue of M⁻¹ diag(D), 1 / D the diagonal of M⁻¹.
_INVERSE = np.linalg.inv(paper_m([np.pi, np.pi / 2]))
_EIGENVALUE = float(np.linalg.eigvals(_INVERSE / np.diag(_INVERSE)).max())
#: Values on both sides of a bound: below it the loop is calm, above it rattles or diverges.
BOUNDS: list[tuple[str, dict[str, Any], dict[str, Any], dict[str, Any]]] = [
    ('compensation', {'kv': 1900.0}, {'kv': 2100.0}, {}),  # c h Kv < 2, with M̂ = c M
    ('friction_feedforward', {'kv': 900.0}, {'kv': 1100.0}, {'inertia_scale': 2.0}),
    ('momentum_observer', {'inertia_scale': 1.9}, {'inertia_scale': 2.3},  # c < 2.1
     {'momentum_gain': 3000.0}),
    ('super_twisting', {'inertia_scale': 1.8}, {'inertia_scale': 2.2}, {}),
    ('slotine_li', {'adaptation_gain': [100.0, 1.65e4]},  # h Γ < K, about 0.55 · 50 N·m·s/rad
     {'adaptation_gain': [100.0, 5.5e4]}, {}),
    ('pd_gravity', {'kv': 1900.0 / _EIGENVALUE}, {'kv': 2100.0 / _EIGENVALUE},
     {'amplitude': 0.0, 'offset': 0.05, 'friction': 0.0})]


@pytest.mark.parametrize(('law', 'calm', 'wild', 'more'), BOUNDS, ids=lambda x: str(x)[:40])
def test_a_bound_from_both_sides(law: str, calm: dict[str, Any], wild: dict[str, Any],
                                 more: dict[str, Any]) -> None:
    assert rattles(law, calm, wild, duration=1.5, **more)


#: A law, its values, and how much smaller its error is than that of other values.
BETTER: list[tuple[str, dict[str, Any], str, dict[str, Any], float]] = [
    ('friction_feedforward', {'friction_level': 9.9}, 'compensation', {}, 0.2),
    ('integral', {'kv': 300.0, 'kp': 3e4, 'ki': 1e6}, 'integral',
     {'kv': 300.0, 'kp': 3e4, 'ki': 0.0}, 0.6),
    ('momentum_observer', {'momentum_gain': 50.0}, 'compensation', {}, 0.5),
    ('momentum_observer', {'momentum_gain': 300.0}, 'momentum_observer',
     {'momentum_gain': 50.0}, 0.5),
    ('super_twisting', {}, 'compensation', {}, 0.1)]


@pytest.mark.parametrize(('law', 'values', 'than', 'others', 'factor'), BETTER)
def test_the_error_under_friction_shrinks(law: str, values: dict[str, Any], than: str,
                                          others: dict[str, Any], factor: float) -> None:
    found, other = error(run(law, 2.0, **values)), error(run(than, 2.0, **others))
    assert (found < factor * other).all()


@pytest.mark.parametrize(('law', 'values'), [
    ('integral', {}), ('pid_kalman', {'estimator_bandwidth': 300.0})])
def test_an_integral_does_not_wind_up(law: str, values: dict[str, Any]) -> None:
    """Check the error after a second at the limit: without anti-windup it is far larger."""
    good, bad = (error(run(
        law, 3.0, 0.0, 0.5, 0.0, anti_windup=on, kv=60.0, kp=1200.0, ki=8000.0,
        effort_limit=[60.0, 10.0], **values)) for on in (True, False))
    assert (good < 0.05 * bad).all()
