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
A control law as a linear system.

The system follows from differences of the law's own code.

`runs/stability.py` calls `linear_law` with a configuration, and `loop_margins.py` closes the loop.
A `Controller` runs with a model of constant M̂, without C and G, in a steady motion of 1 rad/s:
friction has one sign there, and nothing is at rest. Central differences of its step give, for
deviations of its whole memory::

    x⁺ = A x + B y + E r,     τ = C x + D y + F r,     y = (q, dq)                        (LL1)

r are deviations of the reference, q_d, dq_d and ddq_d at the sample and at those of the delay.

Differences of two sizes must agree, which they do not for a law that is not linear there. States
that y does not reach, or that do not reach τ, are left out.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.records import load, packed
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.irregular_sample import REGULAR
from ctc_chattering.control.laws.registry import law_class, switching_class
from ctc_chattering.control.sample import Memories, TRANSIT_ROWS
from ctc_chattering.control.step import PlainStep
from ctc_chattering.dynamics.model import Model
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Array, Flags, Rows, Vector
from ctc_chattering.parameters import matrix
import numpy as np

#: Size of the differences [rad].
_DIFFERENCE = 1e-9
#: Another size, with which they must agree [rad].
_LARGER_DIFFERENCE = 1e-8
#: Below this fraction of its largest value, a difference is rounding.
_ROUNDING = 1e-8
#: Samples after which nothing shows the start, without a delay.
_SETTLING_SAMPLES = 4


class LinearLaw(NamedTuple):
    """A law near a steady motion, (LL1), with m states."""

    #: Shape (m, m).
    A: Array
    #: Shape (m, 2 n).
    B: Array
    #: Shape (n, m).
    C: Array
    #: Shape (n, 2 n).
    D: Array
    #: Shape (m, 3 n (1 + delay)), or (m, 0) where the reference is left out.
    E: Array
    #: Shape (n, 3 n (1 + delay)), or (n, 0).
    F: Array

    def response(self) -> Array:
        """Sum the torques in ten samples after y."""
        state = self.B
        delayed = 0.0 * self.D
        for _ in range(9):
            delayed = delayed + self.C @ state
            state = self.A @ state
        return self.D + delayed

    def one_joint(self) -> LinearLaw:
        """Return the first of joints that are independent and equal."""
        n = len(self.D)
        columns = np.array([0, n])
        of_reference = np.arange(0, self.F.shape[1], n)
        whole = LinearLaw(
            self.A,
            self.B[:, columns],
            self.C[:1],
            self.D[:1, columns],
            self.E[:, of_reference],
            self.F[:1, of_reference])
        inputs = np.hstack([whole.B, whole.E])
        return whole.only(_reach(whole.A, inputs))

    def only(self, states: Flags) -> LinearLaw:
        """Return the system of some of its states."""
        of_states = np.ix_(states, states)
        return self._replace(
            A=self.A[of_states],
            B=self.B[states],
            C=self.C[:, states],
            E=self.E[states])


def _reach(A: Array, B: Array) -> Flags:
    """Return the states that B reaches through A."""
    reached: Flags = np.array(B.any(axis=1))
    for _ in A:
        reached = reached | A[:, reached].any(axis=1)
    return reached


class Frozen(Model):
    """
    A robot with a constant M, without C and G.

    Parameters
    ----------
    mass : array, shape (n, n)
        M [kg·m²].

    """

    def __init__(self, mass: Array) -> None:
        self.n = len(mass)
        self._mass = mass.tolist()

    def mass_matrix(self, q: Vector) -> Rows:  # noqa: ARG002
        """Return M, shape (n, n)."""
        return list(self._mass)

    def coriolis_matrix(self, q: Vector, dq: Vector) -> Rows:  # noqa: ARG002
        """Return 0, shape (n, n)."""
        return [[0.0] * self.n] * self.n

    def gravity_torque(self, q: Vector) -> Vector:  # noqa: ARG002
        """Return 0, shape (n,)."""
        return [0.0] * self.n

    def potential_energy(self, q: Vector) -> float:  # noqa: ARG002
        """Return 0."""
        return 0.0


def linear_law(config: ControllerConfig, mass: Array, with_reference: bool = False) -> LinearLaw:
    """
    Return the law of a configuration as a linear system.

    Parameters
    ----------
    config : ControllerConfig
        Law, gains, and the assumed drives. Limits do not matter. Friction as it is configured and
        learned is not linear but bounded by Ka, and is left out.
    mass : array, shape (n, n)
        M̂ of the controller [kg·m²].
    with_reference : bool
        Whether the reference is an input as well.

    Raises
    ------
    CtcError
        If the law is not linear near a steady motion.

    """
    rows = tuple(map(tuple, mass.tolist()))
    return _linear_law(config, classes_in_force(config), rows, with_reference)


@lru_cache(maxsize=16)  # Margins of loop, masses and rotors need the same ones.
def _linear_law(
        config: ControllerConfig,
        classes: tuple[type, ...],  # noqa: ARG001
        mass: tuple[tuple[float, ...], ...],
        with_reference: bool) -> LinearLaw:
    motion = _SteadyMotion(_without_limits(config), np.array(mass), with_reference)
    scale = motion.sensitivity()
    change = motion.differences(_DIFFERENCE, scale)
    larger = motion.differences(_LARGER_DIFFERENCE, scale)
    gap = np.abs(change - larger).max()
    largest = np.abs(change).max()
    if not gap <= 1e-3 * largest:
        name = f'{config.law} {config.switching_in_force}'.strip()
        raise CtcError(
            f'law {name} is not linear near a steady motion; its stability is not computed')
    return _minimal(change, scale, motion.states, 2 * len(mass))


def classes_in_force(config: ControllerConfig) -> tuple[type, ...]:
    """
    Return the classes of law and switching.

    What is kept for a configuration is kept for them, too: a class of the user's may have become
    another one of the same name.
    """
    switching = config.switching_in_force
    return law_class(config.law), *([switching_class(switching)] if switching else [])


def is_proportional(law: LinearLaw, of_identity: LinearLaw, mass: Array) -> bool:
    """
    Return whether the torque of a law is proportional to M̂.

    Parameters
    ----------
    law, of_identity : LinearLaw
        With M̂ = `mass`, and with M̂ = I.
    mass : array, shape (n, n)
        M̂ [kg·m²].

    """
    response = law.response()
    difference = np.abs(mass @ of_identity.response() - response).max()
    return bool(difference <= 1e-3 * np.abs(response).max())


def joints_are_equal(config: ControllerConfig, lags: Array) -> bool:
    """Return whether joints have equal, uncoupled gains and lags."""
    n = len(lags)
    rows = [lags.tolist()]
    if config.takes('actuator_lag'):
        rows.append(config.assumed_lag)
    if config.takes('ki'):
        rows.append(config.ki)
    gains = [np.array(matrix(x, n)) for x in (config.kp, config.kv)]
    return (all((x == x[0, 0] * np.eye(n)).all() for x in gains)
            and all(len({*row}) == 1 for row in rows))


def _without_limits(config: ControllerConfig) -> ControllerConfig:
    """Return a configuration without limits, friction and model errors."""
    changes: dict[str, object] = {
        'effort_limit': np.inf,
        'effort_rate_limit': np.inf,
        'torque_rate_limit': np.inf,  # Of drives without lag, it would bound any difference.
        'error_limit': np.inf,
        'inertia_scale': 1.0,
        'gravity_scale': 1.0,
        'compiled': False,
    }
    for name in ('friction_level', 'friction_learning'):
        if config.takes(name):
            changes[name] = 0.0
    if config.takes('adaptation_gain'):
        changes['friction_level'] = 1.0  # At 0 the adapted level could not fall.
    return config.changed(changes)


class _SteadyMotion:
    """The control step in the motion, over its memory."""

    def __init__(self, config: ControllerConfig, mass: Array, with_reference: bool) -> None:
        controller = Controller(config, Frozen(mass))
        self._period = controller.settings.period
        self._zeros = np.zeros(len(mass))
        self._ones = np.ones(len(mass))
        settling = _SETTLING_SAMPLES + 2 * config.input_delay
        for k in range(-settling, 0):
            point, *ahead = self._reference(k, config.input_delay)
            q, dq, ddq = point
            controller.step(q, dq, q, dq, ddq, ahead)
        control, law_memory, self._last = controller.memories
        if type(law_memory) not in RECORDS:
            raise CtcError(
                f'law {config.law}: its memory is not marked by @record; its stability '
                'is not computed')
        self._transit = controller.transit
        self._stepper = PlainStep(
            controller.settings, controller.law, controller.memories, self._transit,
            controller.model)
        self._layouts = packed(control).dtype, packed(law_memory).dtype
        self._rows = np.concatenate(self._reference(0, config.input_delay))
        memory = self._memory()
        #: Number of values in the memory.
        self.states = len(memory)
        #: Rows of the reference that are inputs.
        self._inputs = len(self._rows) if with_reference else 0
        self._values = np.concatenate([
            memory,
            self._zeros,
            self._ones,
            self._rows[:self._inputs].ravel()])

    def _reference(self, k: int, delay: int) -> list[Any]:
        """Return the points at sample `k` and at those of the delay."""
        points = []
        for index in range(k, k + delay + 1):
            t = index * self._period
            points.append((t * self._ones, self._ones, self._zeros))
        return points

    def _memory(self) -> Array:
        """
        Return the memories of step and law, and the torques in transit in order.

        The last sample counts only where states are irregular.
        """
        control, law_memory, _ = self._stepper.memories
        shift = -TRANSIT_ROWS * int(control.transit_index)
        transit = np.roll(self._transit, shift, axis=0)
        control = control._replace(transit_index=0.0)
        return np.concatenate([
            _pack(control),
            _pack(law_memory),
            transit.ravel()])

    def _step(self, values: Array) -> Array:
        """Return memory and τ a period later."""
        of_control, of_law = self._layouts
        law_begin = of_control.itemsize // 8
        law_end = law_begin + of_law.itemsize // 8
        control, law_memory, transit, inputs = np.split(
            values,
            [law_begin, law_end, self.states])
        self._transit[:] = transit.reshape(self._transit.shape)
        self._stepper.memories = Memories(
            _unpack(control, of_control),
            _unpack(law_memory, of_law),
            self._last)
        given = inputs.reshape(-1, len(self._zeros))
        rows = np.concatenate([given, self._rows[self._inputs:]])
        tau = self._stepper.step(rows, REGULAR)[0]
        return np.concatenate([
            self._memory(),
            tau])

    def sensitivity(self) -> Array:
        """
        Return the effect of noise, shape (m + inputs,).

        The noise is 1 of q, 1 / h of dq and 1 / h² of ddq. The result is 0 for values that it does
        not reach.
        """
        m = self.states
        rng = np.random.default_rng(0)
        of_dq = self._ones / self._period
        of_point = np.concatenate([self._ones, of_dq, of_dq / self._period])
        of_reference = np.tile(of_point, self._inputs // 3)
        noise = np.concatenate([self._ones, of_dq, of_reference])
        undisturbed = self._step(self._values)[:m]
        deviation = np.zeros(m)
        largest = np.zeros(m)
        for _ in range(64):
            y = _DIFFERENCE * noise * rng.standard_normal(len(noise))
            change = np.concatenate([deviation, y])
            disturbed = self._values + change
            deviation = self._step(disturbed)[:m] - undisturbed
            gain = np.abs(deviation) / _DIFFERENCE
            largest = np.maximum(largest, gain)
        memory = self._values[:m]
        rounding = _ROUNDING * np.maximum(np.abs(memory), 1.0)
        reached = np.where(largest > rounding, largest, 0.0)
        return np.concatenate([reached, noise])

    def differences(self, size: float, scale: Array) -> Array:
        """
        Return changes of memory and τ for 1 `scale`.

        Their shape is (m + n, m + inputs).
        """
        m = self.states
        values = self._values
        shape = m + len(self._zeros), len(values)
        change = np.zeros(shape)
        for k in np.flatnonzero(scale):
            d = np.zeros(len(values))
            d[k] = size * scale[k]
            above = self._step(values + d)
            below = self._step(values - d)
            change[:, k] = (above - below) / (2.0 * size)
        of_memory = scale[:m, np.newaxis]
        change[:m] /= np.where(of_memory, of_memory, np.inf)
        return change


def _pack(record: Any) -> Array:
    """Return the numbers of a record."""
    numbers: Array = np.frombuffer(packed(record).tobytes())
    return numbers


def _unpack(numbers: Array, layout: Any) -> Any:
    """Return the record with these numbers."""
    record, = np.frombuffer(numbers.tobytes(), layout)
    return load(record)


def _minimal(change: Array, scale: Array, m: int, size_of_y: int) -> LinearLaw:
    """Return the part between inputs and τ, unscaled."""
    size = np.abs(change)
    largest = size.max(axis=1, keepdims=True, initial=1e-300)
    is_exact = size > _ROUNDING * largest
    change = np.where(is_exact, change, 0.0)
    of_memory, of_torque = np.split(change, [m])
    A, B = np.split(of_memory, [m], axis=1)
    C, D = np.split(of_torque, [m], axis=1)
    memory_scale, input_scale = np.split(scale, [m])
    reaches_torque = _reach(A.T, C.T)
    is_reached = memory_scale > 0.0
    B, E = np.split(B / input_scale, [size_of_y], axis=1)
    D, F = np.split(D / input_scale, [size_of_y], axis=1)
    law = LinearLaw(A, B, C, D, E, F)
    return law.only(reaches_torque & is_reached)
