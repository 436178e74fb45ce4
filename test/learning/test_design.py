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


"""The learning filter of a law, in time on the linear loop from which it follows."""

from __future__ import annotations

import dataclasses
from functools import cache
import sys
from types import ModuleType
from typing import Any, NamedTuple

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.control.laws.registry import law_class, LAWS
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.learning.design import design_filter, filter_for
from ctc_chattering.learning.learning_filter import LearningFilter, low_pass
from ctc_chattering.learning.motion import motion_of
from ctc_chattering.margins.linear_law import linear_law
from ctc_chattering.margins.loop_margins import Loops
from ctc_chattering.margins.reference_response import reference_response
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.runs.conditions import merge_overrides
from ctc_chattering.runs.recommended import gains_by_rule
from ctc_chattering.runs.stability import masses_of
from ctc_chattering.trajectory.reference import make_motion
import numpy as np
import pytest

GAIN = 0.7
LAG = 2e-3
#: Ratios M̂ over M that are promised.
RATIOS = (0.75, 1.0, 1.0 / 0.75)
#: Samples of a pass of 1 s, and passes after which the loop has settled.
COUNT = 1000
SETTLING_PASSES = 4
#: Laws without a linear response.
NOT_LINEAR = {'chattering', 'super_twisting'}


@cache
def setup_of(robot: str, law: str, lag_is_known: bool = True, **controller: Any) -> Setup:
    """Return an arm with drives, a known delay and gains by rule."""
    path = find_config(robot)
    n = len(parameter_file.load(path).plant.joint_names)
    known: dict[str, Any] = {'actuator_lag': [LAG if lag_is_known else np.inf] * n}
    if law == 'chattering':
        known['switching'] = 'implicit_observer'
    overrides: dict[str, Any] = {
        'plant': {'actuator_lag': [LAG] * n, 'velocity_sensor': 'difference', 'input_delay': 1},
        'controller': {'law': law, 'input_delay': 1, **known}}
    gains = {'controller': gains_by_rule(parameter_file.load(path, overrides))}
    with_gains = merge_overrides(overrides, gains)
    return parameter_file.load(path, merge_overrides(with_gains, {'controller': controller}))


def designed(setup: Setup, cutoff: float = 0.0) -> LearningFilter:
    return design_filter(setup.controller, masses_of(setup), GAIN, cutoff)


class Loop(NamedTuple):
    """A linear loop that is simulated."""

    closed: Array
    driven: Array
    n: int

    def answer(self, r: Array) -> Array:
        """Return q at the samples of a pass that is repeated, shape (COUNT, n)."""
        omega = 2j * np.pi * np.fft.rfftfreq(COUNT, 1e-3)[:, np.newaxis]
        spectrum = np.fft.rfft(r, axis=0)
        rows = np.hstack([np.fft.irfft(omega ** k * spectrum, COUNT, axis=0) for k in range(3)])
        ahead = np.hstack([np.roll(rows, -k, axis=0)
                           for k in range(self.driven.shape[1] // (3 * self.n))])
        inputs = ahead @ self.driven.T
        x = np.zeros(len(self.closed))
        q = np.empty((COUNT, self.n))
        for _ in range(SETTLING_PASSES):
            for k in range(COUNT):
                q[k] = x[:self.n]
                x = self.closed @ x + inputs[k]
        return q


def loop_of(setup: Setup, mass: Array, ratio: float) -> Loop:
    law = linear_law(setup.controller, mass, with_reference=True)
    loops = Loops([law], [mass], 1e-3, np.full(len(mass), LAG), 1, differenced=True)
    sampled = loops.sampled[0]
    return Loop(sampled.closed(ratio), sampled.driven(ratio), len(mass))


def noise(setup: Setup, highest: float, seed: int = 0) -> Array:
    """Return a periodic signal with all harmonics up to a frequency [Hz]."""
    n = len(setup.plant.joint_names)
    rng = np.random.default_rng(seed)
    spectrum = np.zeros((COUNT // 2 + 1, n), complex)
    last = int(highest)
    spectrum[:last + 1] = rng.standard_normal((last + 1, n))
    spectrum[1:last + 1] += 1j * rng.standard_normal((last, n))
    signal: Array = np.fft.irfft(spectrum, COUNT, axis=0)
    return signal


def harmonics(x: Array) -> Array:
    size: Array = np.linalg.norm(np.fft.rfft(x, axis=0), axis=1)
    return size


def largest_factor(setup: Setup, learning_filter: LearningFilter, lag: float, law: str) -> float:
    """Return the norm of (RL2) between the frequencies of the design, too."""
    config = setup.controller.changed({'law': law})
    frequencies = np.geomspace(0.02, 75.0, 300)
    masses = masses_of(setup)
    laws = [linear_law(config, mass, with_reference=True) for mass in masses]
    loops = Loops(laws, masses, 1e-3, np.full(2, lag), 1, differenced=True)
    gain = learning_filter._gain_at(frequencies)
    change = np.array([gain @ reference_response(loops, 2.0 * np.pi * frequencies, ratio)
                       for ratio in RATIOS])
    norms = np.linalg.norm(np.eye(2) - change, 2, axis=(-2, -1))
    return float((low_pass(frequencies, learning_filter.cutoff) * norms).max())


@pytest.mark.parametrize('law', [
    pytest.param(law, marks=() if law in ('compensation', 'pd_gravity') else pytest.mark.slow)
    for law in sorted({*LAWS} - NOT_LINEAR)])
@pytest.mark.parametrize('lag_is_known', [True, False])
def test_every_law_has_a_filter(law: str, lag_is_known: bool) -> None:
    """An unknown lag may have any value up to the assumed one."""
    setup = setup_of('friction', law, lag_is_known)
    learning_filter = designed(setup)
    assert 10.0 < learning_filter.cutoff <= 25.0
    assert 0.3 <= learning_filter.contraction <= 0.95
    for lag in (LAG,) if lag_is_known else (0.0, 1.5e-3, 3e-3):
        factor = largest_factor(setup, learning_filter, lag, law)
        assert factor < learning_filter.contraction + 0.03


def test_the_gain_is_the_least_squares_solution_for_all_responses() -> None:
    """Columns of L minimise the mean |column of I - T x|² + 0.05 |x|², scaled by the gain."""
    setup = setup_of('friction', 'pd_gravity')
    learning_filter = designed(setup)
    masses = masses_of(setup)
    laws = [linear_law(setup.controller, mass, with_reference=True) for mass in masses]
    omega = 2.0 * np.pi * learning_filter.frequencies
    sensors = [Loops(laws, masses, 1e-3, np.full(2, LAG), 1, differenced)
               for differenced in (True, False)]
    responses = np.concatenate([reference_response(loops, omega, ratio)
                                for loops in sensors for ratio in (0.4, 0.6, 1.0, 1.5)
                                if loops.radius(ratio) < 1.0])
    count = len(responses)
    for of_frequency, gain in zip(responses.swapaxes(0, 1), learning_filter.gain):
        weighted = np.vstack([*of_frequency, (0.05 * count) ** 0.5 * np.eye(2)])
        target = np.vstack([*[np.eye(2)] * count, np.zeros((2, 2))])
        least, *_ = np.linalg.lstsq(weighted, target, rcond=None)
        assert gain == pytest.approx(GAIN * least, abs=1e-6)


def test_it_converges_for_masses_that_are_far_from_those_of_the_model() -> None:
    """Rotors that nobody gave may make a link nearly twice as heavy."""
    setup = setup_of('friction', 'observer_feedback')
    learning_filter = designed(setup)
    e_0 = noise(setup, 20.0, seed=1)
    for ratio in (0.6, 1.5):
        loop = loop_of(setup, masses_of(setup)[0], ratio)
        r = 0.0 * e_0
        for _ in range(8):
            e = e_0 - loop.answer(r)
            r = learning_filter.update(r, e, 1e-3)
        assert np.linalg.norm(e) < 0.35 * np.linalg.norm(e_0)


@pytest.mark.parametrize('law, switching', [
    ('chattering', 'sign'), ('chattering', 'implicit_observer'), ('super_twisting', None)])
def test_a_law_that_is_not_linear_slides_or_is_its_equations_without_the_robust_term(
        law: str, switching: str | None) -> None:
    """Its T is 1, or that of computed torque; the filter converges for both."""
    setup = setup_of('friction', law, **({'switching': switching} if switching else {}))
    with pytest.raises(CtcError, match='not linear'):
        linear_law(setup.controller, np.eye(2))
    learning_filter = designed(setup)
    frequencies = np.geomspace(0.02, 75.0, 300)
    gap = np.eye(2) - learning_filter._gain_at(frequencies)
    sliding = low_pass(frequencies, learning_filter.cutoff) * np.linalg.norm(gap, 2, axis=(1, 2))
    largest = max(sliding.max(), largest_factor(setup, learning_filter, LAG, 'compensation'))
    assert largest < learning_filter.contraction + 0.03
    assert learning_filter.contraction < 0.95


@pytest.mark.parametrize('law', ['compensation', 'observer_feedback'])
def test_it_learns_up_to_a_quarter_of_the_resonance_at_most(law: str) -> None:
    learning_filter = designed(setup_of('friction', law, resonance=20.0))
    assert learning_filter.cutoff == pytest.approx(5.0)
    with pytest.raises(ParameterError, match='at most 5 Hz'):
        designed(setup_of('friction', law, resonance=20.0), 6.0)
    assert designed(setup_of('friction', law), 6.0).cutoff == 6.0


def test_it_learns_up_to_a_quarter_of_the_rate_of_the_reports() -> None:
    cutoffs = [designed(setup_of('friction', 'compensation', state_decimation=decimation)).cutoff
               for decimation in (10, 20)]
    assert cutoffs == pytest.approx([25.0, 12.5])


def test_an_unstable_law_is_refused() -> None:
    setup = setup_of('friction', 'compensation', kp=(1e6, 1e6), kv=(2e3, 2e3))
    with pytest.raises(CtcError, match='law compensation is unstable with these gains'):
        designed(setup)


def test_a_gain_with_which_nearly_nothing_is_learned_is_named() -> None:
    setup = setup_of('friction', 'pd_gravity')
    with pytest.raises(CtcError, match=r'with these gains and learning_gain 0\.03'):
        design_filter(setup.controller, masses_of(setup), 0.03, 0.0)


def test_joints_are_those_of_the_reference() -> None:
    """In another order it is the same filter, and with fewer joints it is refused."""
    setup = setup_of('friction', 'pd_gravity')
    reference = setup.reference
    turned = reference.changed({'joint_names': reference.joint_names[::-1],
                                'center': reference.center[::-1]})
    motions = [motion_of(x, None, make_motion(x)) for x in (reference, turned)]
    same, other = (filter_for(motion, x, setup.controller, model_of(setup.controller))
                   for motion, x in zip(motions, (reference, turned)))
    assert other.gain == pytest.approx(same.gain[:, ::-1, ::-1], abs=1e-9)
    assert np.abs(same.gain[:, 0, 1] - same.gain[:, 1, 0]).max() > 0.01
    fewer = dataclasses.replace(reference, joint_names=('joint1', 'other'))
    with pytest.raises(CtcError, match='must have the joints of the controller'):
        filter_for(motions[0], fewer, setup.controller, model_of(setup.controller))


@pytest.mark.parametrize('robot, law', [
    ('friction', 'pd_gravity'),
    ('friction', 'observer_feedback'),
    ('friction', 'slotine_li'),
    pytest.param('panda', 'pd_gravity', marks=pytest.mark.slow),
    pytest.param('panda', 'slotine_li', marks=pytest.mark.slow),
])
def test_each_harmonic_contracts_in_time(robot: str, law: str) -> None:
    """The distance of two corrections, each with the same errors, for three M̂ and ratios."""
    setup = setup_of(robot, law)
    learning_filter = designed(setup)
    e_0 = noise(setup, 60.0, seed=1)
    largest = 0.0
    masses = masses_of(setup)
    for mass, ratio in zip((masses[0], masses[2], masses[4]), RATIOS):
        loop = loop_of(setup, mass, ratio)
        corrections = [0.0 * e_0, noise(setup, 2.5 * learning_filter.cutoff)]
        for _ in range(2):
            before = harmonics(corrections[1] - corrections[0])
            corrections = [learning_filter.update(r, e_0 - loop.answer(r), 1e-3)
                           for r in corrections]
            after = harmonics(corrections[1] - corrections[0])
            counted = before > 1e-9 * before.max()
            factor = after[counted] / before[counted]
            assert factor.max() < learning_filter.contraction + 0.02
            largest = max(largest, factor.max())
    assert largest > 0.4 * learning_filter.contraction


def test_a_refused_cutoff_diverges_and_the_named_one_converges() -> None:
    """PD on coupled joints, whose response differs much from 1."""
    setup = setup_of('panda', 'pd_gravity')
    highest = designed(setup)
    refused = 7.0 * highest.cutoff
    with pytest.raises(ParameterError) as refusal:
        designed(setup, refused)
    assert refusal.value.name == 'learning_cutoff'
    assert (f'at most {highest.cutoff:.3g} Hz, up to which learning converges under law '
            'pd_gravity') in str(refusal.value)
    loop = loop_of(setup, masses_of(setup)[0], RATIOS[-1])
    e_0 = noise(setup, 60.0)
    growth = {}
    for cutoff in (highest.cutoff, refused):
        learning_filter = dataclasses.replace(highest, cutoff=cutoff)
        r = 0.0 * e_0
        sizes = []
        for _ in range(16):
            e = e_0 - loop.answer(r)
            updated = learning_filter.update(r, e, 1e-3)
            sizes.append(np.linalg.norm(updated - r))
            r = updated
        growth[cutoff] = sizes[15] / sizes[7]
    assert growth[highest.cutoff] < 0.95 ** 8
    assert growth[refused] > 1.0


def resampled(x: Array, rng: np.random.Generator, jitter: float, lost: float) -> Array:
    """Return a pass by every tenth sample, some lost, joined by straight lines as in `Learner`."""
    reports = np.arange(0, COUNT, 10)
    reports = reports[rng.random(len(reports)) >= lost]
    late = rng.uniform(-jitter, jitter, len(reports)) * 10
    reports = np.clip(reports + np.rint(late).astype(int), 0, COUNT - 1)
    grid = np.arange(COUNT)
    return np.column_stack(
        [np.interp(grid, reports, column[reports], period=COUNT) for column in x.T])


@pytest.mark.parametrize('share, regular, irregular', [
    (0.05, 0.01, 0.03), (0.1, 0.035, 0.1), (0.25, 0.20, 0.45)])
def test_the_error_of_resampling_is_bounded(share: float, regular: float, irregular: float
                                            ) -> None:
    """By frequency over the rate of the reports, with a jitter of 0.3 intervals and 10 % lost."""
    rng = np.random.default_rng(0)
    frequency = round(share * 100.0)
    t = 1e-3 * np.arange(COUNT)
    errors = {}
    for jitter, lost in ((0.0, 0.0), (0.3, 0.1)):
        squares = []
        for phase in rng.uniform(0.0, 2.0 * np.pi, 40):
            x = np.sin(2.0 * np.pi * frequency * t + phase)[:, np.newaxis]
            gap = np.fft.rfft(resampled(x, rng, jitter, lost) - x, axis=0)[:26]
            squares.append((np.abs(gap) ** 2).sum() / (0.5 * COUNT) ** 2)
        errors[jitter] = np.sqrt(np.mean(squares))
    assert 0.7 * regular < errors[0.0] < regular
    assert 0.7 * irregular < errors[0.3] < irregular


@pytest.mark.parametrize('law', ['pd_gravity', 'observer_feedback'])
def test_it_converges_with_irregular_samples(law: str) -> None:
    """Decimated, jittered, 10 % lost, and other ones in each pass."""
    setup = setup_of('friction', law)
    learning_filter = designed(setup)
    rng = np.random.default_rng(0)
    e_0 = noise(setup, 0.3 * learning_filter.cutoff)
    for mass, ratio in zip(masses_of(setup)[::2], RATIOS):
        loop = loop_of(setup, mass, ratio)
        r = 0.0 * e_0
        sizes = []
        for _ in range(8):
            e = e_0 - loop.answer(r)
            sizes.append(np.sqrt((e ** 2).mean()))
            r, e = np.split(resampled(np.hstack([r, e]), rng, 0.3, 0.1), 2, axis=1)
            r = learning_filter.update(r, e, 1e-3)
        assert sizes[-1] < 0.1 * sizes[0]
        assert max(sizes[1:]) < sizes[0]


def test_the_filter_of_an_own_law_that_became_another_class_is_not_the_old_one(
        monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType('own_laws')
    monkeypatch.setitem(sys.modules, 'own_laws', module)
    masses = masses_of(setup_of('friction', 'compensation'))
    config = setup_of('friction', 'compensation').controller
    for name in ('compensation', 'pd_gravity'):
        monkeypatch.setattr(module, 'Law', law_class(name), raising=False)
        found, expected = (design_filter(config.changed({'law': law}), masses, GAIN, 4.0)
                           for law in ('own_laws:Law', name))
        np.testing.assert_array_equal(found.gain, expected.gain)
