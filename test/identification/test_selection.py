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

"""Terms that are selected, and corrected bodies, on windows that they were not fitted to."""

from __future__ import annotations

import dataclasses

from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.identification import friction
from ctc_chattering.identification.attribution import causes, Explanation
from ctc_chattering.identification.bodies import left_over
from ctc_chattering.identification.findings import Severity
from ctc_chattering.identification.friction import joint_friction, select, Selected
from ctc_chattering.identification.least_squares import Data, Term, TermKind
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.identification.model_verdict import ModelVerdict
from ctc_chattering.identification.windows import STRIBECK
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np
import pytest
import urdfs

#: Windows.
COUNT = 400
#: Coulomb friction [N·m].
COULOMB = 2.0


def random_windows(rotor: Array, scale: float = 1.0, gear: float = 0.0, noise: float = 1e-3,
                   band: float = 0.0, part: float = 1.0) -> tuple[Data, ErrorColumns]:
    """
    Return windows, and the columns of the arm's errors.

    Parameters
    ----------
    rotor : ndarray, shape (COUNT, 2) or what broadcasts to it
        Inertia of the rotors in each window [kg·m²].
    scale : float
        Torque at the joint over that of the signal.
    gear : float
        Part of what gears transmit that is friction.
    noise : float
        Of the torque [N·m].
    band : float
        What the drives take of each command [N·m].
    part : float
        By which the torque of the second joint is smaller.

    """
    model = UrdfModel(urdfs.two_links(), urdfs.TWO_LINKS)
    columns = ErrorColumns.of(model)
    assert columns is not None
    rng = np.random.default_rng(3)
    states = rng.normal(size=(COUNT, 3, 2))
    _, dq, ddq = states.transpose(1, 0, 2)
    parts = np.array([1.0, part])
    base = parts * [model.inverse_dynamics(*(x.tolist() for x in state)) for state in states]
    way = np.sign(dq)
    friction = way * (COULOMB + gear * np.abs(base))
    torque = (base + rotor * ddq + friction + noise * rng.normal(size=(COUNT, 2))) / scale
    torque += band * np.sign(torque)
    more = parts[:, None] * [columns.at(*state) for state in states]
    return dataclasses.replace(
        Data.at(way, dq, torque, more), t=np.arange(float(COUNT)), base=base, load=np.abs(base),
        stribeck=np.zeros((COUNT, 2, len(STRIBECK))), residual=torque - base,
        floor=np.full(2, 1e-4)), columns


def held(scale: float, gear: float = 0.0, blur: float = 0.0) -> list[bool]:
    """Return whether the intervals of Coulomb friction contain the truth; load is blurred."""
    data, columns = random_windows(np.zeros(2), scale, gear)
    data = dataclasses.replace(data, load=np.hypot(data.load, blur))
    found = select(data, ('a', 'b'), columns, causes(columns, ('a', 'b'), [], np.ones(2)))
    numbers = [joint_friction(found, i).coulomb for i in range(2)]
    assert all(x.value is not None for x in numbers)
    return [abs((x.value or 0.0) - COULOMB) <= x.half for x in numbers]


@pytest.mark.parametrize('most', [3, 0])
def test_a_scale_of_all_torques_is_in_the_intervals(
        most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Named, or beside all errors of the model; without the doubt it is missed."""
    monkeypatch.setattr(friction, '_CAUSES', most)
    assert all(held(0.95))
    if not most:
        monkeypatch.setattr(friction, '_COMMON', 0.0)
        assert not any(held(0.95))


def test_a_load_that_is_not_known_at_its_change_of_sign_is_in_the_intervals(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """Blurred by 0.1 N·m, as by the average over a window; without the doubt it is missed."""
    assert all(held(1.0, 0.1, 0.1))
    monkeypatch.setattr(friction, '_FORM', 0.0)
    monkeypatch.setattr(friction, '_TRUSTED', 0.0)
    assert not any(held(1.0, 0.1, 0.1))


@pytest.mark.parametrize('band', [0.0, 0.3])
def test_a_dead_band_has_a_number_or_is_in_coulomb_friction(band: float) -> None:
    """The second joint has little load: no torque of its drive is against its motion."""
    data, columns = random_windows(np.zeros(2), band=band, part=0.02)
    found = select(data, ('a', 'b'), columns, causes(columns, ('a', 'b'), [], np.ones(2)))
    seen, hidden = ModelVerdict(found, columns, [], ('a', 'b')).dead_band(data, [COULOMB] * 2)
    assert seen.reason.startswith('none above 0.00') if not band else (
        seen.value == pytest.approx(band, rel=0.01))
    assert hidden.reason == 'in Coulomb friction (no torque is against the motion)'
    for i, more in enumerate((0.0, band)):
        assert joint_friction(found, i).coulomb.value == pytest.approx(COULOMB + more, rel=1e-3)
    # Where commands chatter it has no column.
    data = dataclasses.replace(data, bent=data.bent * [[1.0], [0.0]])
    found = select(data, ('a', 'b'), columns, causes(columns, ('a', 'b'), [], np.ones(2)))
    verdict = ModelVerdict(found, columns, [], ('a', 'b'))
    assert verdict.dead_band(data, [COULOMB] * 2)[1].reason == hidden.reason


def test_a_weak_term_goes_though_its_velocity_was_refined_last(
        monkeypatch: pytest.MonkeyPatch) -> None:
    """No velocity fits friction that is none, so the refinement of it does not settle."""
    monkeypatch.setattr(friction, 'further_terms', lambda *_: [Term(TermKind.STRIBECK, 0, 12)])
    data, columns = random_windows(np.zeros(2))
    shown = data.way[..., None] * np.exp(-np.square(data.velocity[..., None] / STRIBECK))
    found = select(dataclasses.replace(data, stribeck=shown), ('a', 'b'), columns)
    assert joint_friction(found, 0).stribeck.shows_none


@pytest.mark.parametrize('part', [0.02, 0.002])
def test_noise_of_a_constant_torque_is_no_fading_torque(part: float) -> None:
    """The square of a torque has its noise, too."""
    data, columns = random_windows(np.zeros(2), noise=0.05, part=part)
    found = select(data, ('a', 'b'), columns, causes(columns, ('a', 'b'), [], np.ones(2)))
    assert found.explanation is not None and not found.explanation.causes
    assert joint_friction(found, 1).coulomb.value == pytest.approx(COULOMB, rel=2e-3)


@pytest.mark.parametrize('noise, severity', [(1e-3, Severity.CARE), (0.3, Severity.NOTE)])
def test_a_cause_that_may_be_none_needs_no_care(noise: float, severity: Severity) -> None:
    data, columns = random_windows(np.array([5e-3, 0.0]), noise=noise)
    cause = next(x for x in causes(columns, ('a', 'b'), [], np.ones(2)) if 'rotor' in x.name)
    found = friction._final(data, TERMS, cause.design, {})
    fit = Explanation((cause,), (np.full(1, 5e-3),), 1.0, np.ones(2))
    (finding,) = ModelVerdict(Selected(*found, {}, cause.design, fit), columns, [], ('a', 'b')
                              ).findings()
    assert finding.severity == severity and 'rotor inertia of a: 0.0' in finding.reason


TERMS = [Term(kind, i) for i in range(2) for kind in (TermKind.FORWARDS, TermKind.BACKWARDS)]


def ratios(rotor: Array) -> Array:
    """Return what corrected bodies leave with these rotors in each window, shape (2,)."""
    data, columns = random_windows(rotor)
    return left_over(data, TERMS, columns, None)


@pytest.mark.parametrize('later', [0.3, -0.3])
def test_a_rotor_that_stays_is_corrected_and_one_that_changes_is_worse(later: float) -> None:
    rotor = np.where(np.arange(COUNT) < COUNT // 2, 0.3, later)[:, None] * np.ones(2)
    found = ratios(rotor)
    assert (found < 0.2).all() if later > 0.0 else (found > 1.3).all(), found


def test_noise_of_a_joint_that_nothing_corrects_is_not_worse() -> None:
    found = ratios(np.array([0.0, 0.3]))
    assert found[0] < 1.01 and found[1] < 0.2, found
