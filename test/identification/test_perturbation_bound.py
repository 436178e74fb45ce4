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

"""ka holds P at the limits, single outliers do not count, and drives bound what is asked for."""

from __future__ import annotations

import dataclasses
from functools import cache

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.identification.findings import Estimate, Reason, Severity
from ctc_chattering.identification.gains import torque_rate
from ctc_chattering.identification.identify import Identification
from ctc_chattering.identification.perturbation import (
    measure_perturbation,
    MeasuredPerturbation,
    tail_bound,
)
from ctc_chattering.identification.perturbation_bound import bound_perturbation, MARGIN
from ctc_chattering.numerics.linear_algebra import Array
from identified_robots import identified, Recorded
import numpy as np
import pytest


# Made where a test needs them: not in each process that collects tests.
def made() -> Recorded:
    return identified(12.0)[0]


def base() -> Identification:
    return identified(12.0)[1]


@cache
def measured() -> MeasuredPerturbation:
    return measure_perturbation(base(), False)


def with_torque(found: Identification, added: Array) -> Identification:
    """Return an identification of a run with more torque, shape (J, n) [N·m]."""
    data = found.fit.data
    data = dataclasses.replace(data, torque=data.torque + added)
    return dataclasses.replace(found, fit=dataclasses.replace(found.fit, data=data))


class Limited(TwoLink):
    """The paper's arm with limits."""

    velocity_limits = (6.0, 8.0)
    effort_limits = (500.0, 200.0)


def test_friction_at_the_limits_is_that_of_the_robot() -> None:
    found = bound_perturbation(base(), measured(), Limited(9.81), False)
    largest = np.array(made().plant.coulomb_friction) + np.multiply(
        made().plant.viscous_friction, [6.0, 8.0])
    assert found.friction == pytest.approx(largest, rel=1e-2)
    assert (found.ka >= 0.999 * MARGIN * largest).all() and (found.ka < 1.3 * largest).all()
    assert found.velocity.tolist() == [6.0, 8.0] and not found.findings


def test_without_limits_the_speed_of_the_run_counts() -> None:
    found = bound_perturbation(base(), measured(), made().model, False)
    assert found.peak == pytest.approx(measured().peak, rel=0.02)
    fastest = np.abs(base().fit.data.windows.velocity).max(axis=0)
    assert (found.velocity <= fastest).all() and (found.velocity > 0.8 * fastest).all()


def test_ka_is_cut_to_what_the_drive_gives() -> None:
    model = Limited(9.81)
    model.effort_limits = (500.0, 12.0)
    found = bound_perturbation(base(), measured(), model, False)
    assert found.ka[1] == 12.0
    (finding,) = found.findings
    assert (finding.reason, finding.severity, finding.joint) == (
        Reason.KA_CUT, Severity.CARE, 1)
    assert finding.values['effort'] == 12.0


@pytest.mark.parametrize('size', [30.0, 185.0])
def test_an_outlier_is_named_and_does_not_count(size: float) -> None:
    added = np.zeros_like(base().fit.data.torque)
    k = int(np.flatnonzero(base().fit.data.used.all(axis=1))[40])
    added[k, 0] = size
    run = measure_perturbation(with_torque(base(), added), False)
    assert run.peak == pytest.approx(measured().peak, rel=0.02)
    (finding,) = run.outliers()
    assert (finding.reason, finding.joint) == (Reason.OUTLIERS, 0)
    assert finding.values['t'] == run.t[k]
    assert not list(measured().outliers())


def test_the_tail_is_that_of_the_distribution() -> None:
    rng = np.random.default_rng(0)
    sizes = np.abs(rng.laplace(size=(300, 2400)))
    bounds = np.array([tail_bound(x) for x in sizes])
    assert np.median(bounds / sizes.max(axis=1)) == pytest.approx(1.0, abs=0.1)
    assert (bounds <= sizes.max(axis=1)).all()
    assert tail_bound(np.append(sizes[0], 1e3)) < 1.05 * sizes[0].max()


def test_errors_of_the_model_are_in_the_perturbation() -> None:
    error = 5.0 * np.sin(measured().t)[:, None] * [1.0, 0.0]
    assert measure_perturbation(with_torque(base(), error), False).tail[0] > 3.0


def test_the_rate_is_within_what_drives_give() -> None:
    """Told is the lower end of the interval, and what is given before that."""
    needed = np.array([2000.0, 100.0])
    rate = [Estimate(1200.0, 200.0, 'N*m/s'), Estimate(5000.0, 1000.0, 'N*m/s')]
    found, (slow,) = torque_rate(dataclasses.replace(base(), rate=rate), needed)
    late = 1.0 + 2e3 * base().timing.delays[0][2]
    assert found == pytest.approx([1000.0, 4000.0 / late[1]])
    assert (slow.reason, slow.joint) == (Reason.SLOW_DRIVE, 0)
    assert (slow.values['rate'], slow.values['needed']) == (1000.0, 2000.0)
    assert torque_rate(base(), needed, (300.0, 300.0)).rate.tolist() == [300.0, 300.0]
    # Drives that begin without torque carry the arm within 0.03 s, if that is more.
    free = dataclasses.replace(base(), rate=[])
    assert torque_rate(free, needed, weight=np.array([120.0, 1.0])).rate[0] == 4000.0
    _, (unknown,) = torque_rate(free, needed)
    assert unknown.reason == Reason.NO_RATE


def test_ka_holds_the_largest_viscous_friction_of_its_interval() -> None:
    """A slow run shows little of it, and ka is for the limit of the velocity."""
    viscous = base().friction[1].viscous
    wide = dataclasses.replace(viscous, half=viscous.half + 0.5)
    friction = [base().friction[0], dataclasses.replace(base().friction[1], viscous=wide)]
    before, after = (bound_perturbation(x, measured(), Limited(9.81), False).friction
                     for x in (base(), dataclasses.replace(base(), friction=friction)))
    assert after - before == pytest.approx([0.0, 0.5 * 8.0])
