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

"""
Design of the learning filter from what is known.

Simulation, reference node and `ctc learn` call `design_filter` with the configuration of the
controller. With the response T of the loop to its reference (RR1), e_j = e_0 - T r_j. So (RL1)
gives, at each frequency, for the distance of r_j from its limit::

    d_j+1 = Q (I - L T) d_j,     |Q (I - L T)|₂ < 1 for each T that is possible           (RL2)

That is the condition of convergence. It is checked with M̂ at several positions of the motion, and
with M̂ = ρ M. L minimises the mean of |e_j+1|² + β |r_j+1 - r_j|² over these T, and is then scaled
by the learning gain. With E, the mean over them::

    L = γ (E[Tᴴ T] + β I)⁻¹ E[Tᴴ]                                                         (RL3)
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from typing import NamedTuple

from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError, ParameterError
from ctc_chattering.learning.learner import MAX_GAP_NS
from ctc_chattering.learning.learning_filter import LearningFilter, low_pass
from ctc_chattering.learning.motion import RepeatedMotion
from ctc_chattering.margins.linear_law import (
    classes_in_force,
    is_proportional,
    joints_are_equal,
    linear_law,
)
from ctc_chattering.margins.loop_margins import Loops
from ctc_chattering.margins.reference_response import reference_response
from ctc_chattering.numerics.linear_algebra import Array, ComplexArray
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.trajectory.reference import ReferenceConfig
import numpy as np

#: ρ for which convergence is checked: what a motor feels at half of a resonance differs as much.
_RATIOS = (0.75, 1.0, 1.0 / 0.75)
#: ρ for which L is made. Rotors that nobody gave make light links up to 3 times as heavy.
_DESIGN_RATIOS = (0.4, 0.6, 1.0, 1.5)
#: β of (RL3).
_CHANGE_WEIGHT = 0.05
#: Largest contraction: 8 passes then leave 2/3 of an error, at the worst frequency and robot.
_MAX_CONTRACTION = 0.95
#: Cut-off frequency over the rate of the reported errors, and over the lowest resonance, at most.
#: Up to half of it, loops that oscillated with the resonance diverged.
_MAX_CUTOFF_PER_RATE = 0.25
_MAX_CUTOFF_PER_RESONANCE = 0.25
#: Lowest frequency that is examined, and lowest cut-off frequency that is tried [Hz].
_LOWEST_FREQUENCY = 0.1
_LOWEST_CUTOFF = 0.5
#: Number of frequencies, and of cut-off frequencies.
_FREQUENCIES = 60
_CUTOFFS = 60


def filter_for(motion: RepeatedMotion, reference: ReferenceConfig, controller: ControllerConfig,
               model: Model) -> LearningFilter:
    """
    Return the learning filter for a motion.

    Its joints are in the order of the reference.

    Parameters
    ----------
    motion : RepeatedMotion
        Motion along which M̂ is evaluated.
    reference : ReferenceConfig
        ``learning_gain`` and ``learning_cutoff``.
    controller : ControllerConfig
        Law, gains, and what is known of the loop.
    model : Model
        Model of the controller, without its payload.

    Raises
    ------
    CtcError
        As `design_filter`, and for a reference of further joints.

    """
    names = controller.joint_names
    if {*names} != {*reference.joint_names}:
        raise CtcError('learning: the reference must have the joints of the controller')
    if controller.state_decimation * period_ns(controller.control_period) > MAX_GAP_NS:
        raise CtcError(f'learning: with state_decimation {controller.state_decimation}, errors '
                       f'come too rarely; allowed: one in {seconds(MAX_GAP_NS):g} s or less')
    to_controller = [reference.joint_names.index(name) for name in names]
    to_reference = [names.index(name) for name in reference.joint_names]
    unscaled = controller.changed({'inertia_scale': 1.0, 'gravity_scale': 1.0})
    model = Controller(unscaled, model).model  # With its payload, of which the law then is free.
    controller = controller.changed({'payload_mass': 0.0})
    masses = [np.array(model.mass_matrix([q[i] for i in to_controller]))
              for q in motion.positions()]
    designed = design_filter(
        controller, masses, reference.learning_gain, reference.learning_cutoff)
    return designed.reordered(to_reference)


def design_filter(config: ControllerConfig, masses: Sequence[Array], gain: float, cutoff: float
                  ) -> LearningFilter:
    """
    Return a filter with which learning converges.

    Parameters
    ----------
    config : ControllerConfig
        Law, gains, and what is known of drives, delay and resonance.
    masses : sequence of array, shape (n, n)
        M̂ at several positions of the motion [kg·m²].
    gain : float
        γ of (RL3), from 0 to 1.
    cutoff : float
        f_c [Hz], 0 for the highest that converges.

    Raises
    ------
    CtcError
        If the law is not linear near a steady motion, or (RL2) fails.

    """
    key = tuple(tuple(map(tuple, mass.tolist())) for mass in masses)
    return _designed(config, classes_in_force(config), key, gain, cutoff)


@lru_cache(32)
def _designed(
        config: ControllerConfig,
        classes: tuple[type, ...],  # noqa: ARG001
        masses: tuple[tuple[tuple[float, ...], ...], ...],
        gain: float,
        cutoff: float) -> LearningFilter:
    """Return a filter, and keep it: it takes up to a second."""
    period = seconds(period_ns(config.control_period))
    frequencies = np.geomspace(_LOWEST_FREQUENCY, 0.45 / period, _FREQUENCIES)
    loops = _loops(config, [np.array(mass) for mass in masses], period)
    checked, responses = (_responses(loops, len(masses[0]), frequencies, ratios)
                          for ratios in (_RATIOS, _DESIGN_RATIOS))
    adjoint = responses.conj().swapaxes(-2, -1)
    identity = np.eye(responses.shape[-1])
    weighted = (adjoint @ responses).mean(axis=0) + _CHANGE_WEIGHT * identity
    L: ComplexArray = np.asarray(
        gain * np.linalg.solve(weighted, adjoint.mean(axis=0)), np.complex128)
    norms = np.linalg.norm(identity - L @ checked, 2, axis=(-2, -1)).max(axis=0)

    def contraction(f_c: float) -> float:
        return float((low_pass(frequencies, f_c) * norms).max())

    highest = min(
        _MAX_CUTOFF_PER_RATE / (config.state_decimation * period),
        _MAX_CUTOFF_PER_RESONANCE * config.resonance)
    candidates = np.geomspace(_LOWEST_CUTOFF, highest, _CUTOFFS).tolist()
    converging = [f_c for f_c in candidates if contraction(f_c) <= _MAX_CONTRACTION]
    if not converging:
        raise CtcError(f'learning: no cut-off frequency from {_LOWEST_CUTOFF:g} Hz on converges '
                       f'under law {config.law} with these gains and learning_gain {gain:g}')
    largest = converging[-1]
    if cutoff and not (cutoff <= highest and contraction(cutoff) <= _MAX_CONTRACTION):
        raise ParameterError(
            'learning_cutoff', cutoff,
            f'at most {largest:.3g} Hz, up to which learning converges under law {config.law}')
    chosen = cutoff or largest
    return LearningFilter(frequencies, L, chosen, contraction(chosen))


class _PossibleLoops(NamedTuple):
    """Stable loops that a law may have."""

    stable: Sequence[Loops]
    #: Whether T may also be 1, as in ideal sliding.
    slides: bool


def _responses(loops: _PossibleLoops, n: int, frequencies: Array, ratios: Sequence[float]
               ) -> ComplexArray:
    """Return T at frequencies [Hz], shape (loops and ratios, K, n, n)."""
    omega = 2.0 * np.pi * frequencies
    identity = np.eye(n)
    responses = []
    if loops.slides:
        responses.append(np.broadcast_to(identity.astype(complex), (1, len(omega), n, n)))
    for possible in loops.stable:
        joints = identity if possible.joints_are_equal else np.ones_like(identity)
        responses += [joints * reference_response(possible, omega, ratio) for ratio in ratios
                      if possible.radius(ratio) < 1.0]
    return np.concatenate(responses)


def _loops(config: ControllerConfig, masses: Sequence[Array], period: float) -> _PossibleLoops:
    """
    Return the loops of a law.

    A law that acts on v need not be linear, or its linear loop stable: it then switches. Its loops
    are those of its equations without the robust term, and it may slide.
    """
    try:
        return _PossibleLoops(_linear_loops(config, masses, period), slides=False)
    except CtcError:
        if not law_class(config.law).acts_on_v:
            raise
    without_term = config.changed({'law': 'compensation'})
    return _PossibleLoops(_linear_loops(without_term, masses, period), slides=True)


def _linear_loops(config: ControllerConfig, masses: Sequence[Array], period: float
                  ) -> list[Loops]:
    """
    Return the loops of a linear law.

    Where all joints are equal they are those of one joint. They have the lag that is known and the
    one that is assumed, and the velocity of a difference and of a sensor. Those that are unstable
    are left out, since the robot is not theirs.
    """
    identity = np.eye(len(masses[0]))
    lags = {config.known_lag, config.assumed_lag}
    laws = [linear_law(config, identity, with_reference=True)]
    of_first = linear_law(config, masses[0], with_reference=True)
    if is_proportional(of_first, laws[0], masses[0]):
        masses = [identity]  # T does not depend on M̂.
        if all(joints_are_equal(config, np.array(lag)) for lag in lags):
            laws, masses = [laws[0].one_joint()], [np.eye(1)]
    else:
        laws = [of_first]
        laws += [linear_law(config, mass, with_reference=True) for mass in masses[1:]]
    stable = []
    for lag, differenced in product(lags, (True, False)):
        of_joints = np.array(lag[:len(masses[0])])
        loops = Loops(laws, masses, period, of_joints, config.input_delay, differenced)
        if loops.radius() < 1.0:
            stable.append(loops)
    if not stable:
        raise CtcError(f'learning: law {config.law} is unstable with these gains, lag and delay')
    return stable
