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
The sampled controller, by the law that its parameters name.

Nodes, simulation and users hold a `Controller`. It makes the law from a `ControllerConfig`, and
has the control step computed as plain Python or machine code. Between samples it changes gains and
laws, resets, and answers states that come late or not at all.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import auto, Enum
from math import isfinite
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.handover import take_over
from ctc_chattering.control.irregular_sample import (
    locate_sample,
    missing_state,
    REGULAR,
    SampleIrregularity,
)
from ctc_chattering.control.laws.base import Law, Stability
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.control.payload_ramp import PayloadRamp
from ctc_chattering.control.sample import ControlMemory, LastSample, Memories, TRANSIT_ROWS
from ctc_chattering.control.settings import ControlSettings
from ctc_chattering.control.step import PlainStep
from ctc_chattering.dynamics.compiled_model import arm_of, ArmNumbers
from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import checked_vector
from ctc_chattering.trajectory.buffer import Point
import numpy as np

__all__ = ['Controller', 'ControllerConfig', 'Sample']

#: Errors of a step that leaves the range of numbers: 1 / 0, sin(inf).
_OUT_OF_RANGE = (ArithmeticError, ValueError, np.linalg.LinAlgError)


class Sample(NamedTuple):
    """
    Result of one control step.

    Its fields are lists of n floats.

    e, de and v belong to the measured state, the terms to the torque. Under an input delay the
    torque is for the state predicted over it.

    Attributes
    ----------
    tau : list of float
        Torque to send, within the limits [N·m].
    e, de : list of float
        Errors q_d - q [rad] and dq_d - dq [rad/s].
    v : list of float
        Filtered error [rad/s].
    nominal : list of float
        Torque by model and feedback: M [ddq_d + Kv de + Kp e] + C dq + G under most laws [N·m].
    compensation : list of float
        C v, which the laws (2) and (6) subtract, 0 under the others [N·m].
    robust : list of float
        Term subtracted against the perturbation: Ka sgn(v) under (6), however switched [N·m].
    saturation_error : list of float, or None
        Torque that the limits have taken, or None for nothing [N·m].

    """

    tau: Vector
    e: Vector
    de: Vector
    v: Vector
    nominal: Vector
    compensation: Vector
    robust: Vector
    saturation_error: Vector | None

    @property
    def is_finite(self) -> bool:
        """Return whether torque and filtered error are in the range of numbers."""
        return isfinite(sum(self.tau) + sum(self.v))


class Phase(Enum):
    """
    Phase of a controller: how its next step begins.

    `reset` leads to a start, a step to `RUNNING`. Another law leads from `RUNNING` to `HANDOVER`,
    and the same law back.
    """

    #: With ξ = 0.
    START = auto()
    #: With v = 0.
    BUMPLESS_START = auto()
    #: From the last sample.
    RUNNING = auto()
    #: With the torque of another law (`handover.py`).
    HANDOVER = auto()


class ReplacedLaw(NamedTuple):
    """The law before a hand-over."""

    name: str
    law: Law
    memory: Any


class PredictedPeriod(NamedTuple):
    """
    A period that was answered without a state.

    Attributes
    ----------
    rows : ndarray, shape (5 + 3 d, n)
        Those that the step took.
    reference_offset : int
        Time from the instants of the reference to the sample [ns].
    tau : ndarray, shape (n,)
        Torque in force [N·m].

    """

    rows: Array
    reference_offset: int
    tau: Array


class Controller:
    """
    The sampled controller: one call of `step` per state.

    Contract: `step` takes the state and the reference at sample k and returns the torque to hold
    until sample k + 1. It reads no clock. By the stamps of the states it goes on by as many
    periods as have passed (`control.irregular_sample`). Without stamps that is one a call.

    Parameters
    ----------
    config : ControllerConfig
        Law and gains.
    model : Model, optional
        In place of the one that the configuration names.

    Attributes
    ----------
    config : ControllerConfig
        In force.
    model : Model
        With `inertia_scale` and `gravity_scale`.
    continuous : tuple of bool, shape (n,)
        True for joints that turn endlessly. Positions that `step` takes count turns all the same.
    settings, law : ControlSettings, Law
        Settings common to all laws, and the law in force.
    memories : Memories
        Memory of the control step and of the law, and the last sample.
    transit : array, shape (4 input_delay, n)
        Torques in transit.
    compiled : bool
        Whether steps are machine code, as of the last change of law, gains or memories.

    """

    _phase: Phase
    #: The law before, until it is taken over.
    _replaced: ReplacedLaw | None
    #: Stamp of the last state, and its time after its sample [ns].
    _stamp: int | None
    _offset: int
    #: Periods since then that were answered without a state, and memories and transit before them.
    _predicted: list[PredictedPeriod]
    _snapshot: tuple[Memories, Array]
    #: Computes the steps until the next change, and holds the memories. The first step makes it.
    _stepper: PlainStep | CompiledStep | None
    #: Until then, the memories.
    _memories: Memories

    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        unscaled = model or model_of(config)
        if unscaled.n != len(config.joint_names):
            raise CtcError(
                f'joint_names: {list(config.joint_names)} are not allowed with a model '
                f'of {unscaled.n} joints')
        self._period = period_ns(config.control_period)
        self._payload = PayloadRamp(unscaled, config, self._period)
        self._use_model(config)
        self.continuous = config.which_are_continuous(unscaled.continuous)
        self.transit = np.zeros((TRANSIT_ROWS * config.input_delay, unscaled.n))
        self._use(config)
        self.reset()

    def _use_model(self, config: ControllerConfig) -> None:
        """Take the model with the present payload."""
        loaded = self._payload.model
        scales = config.inertia_scale, config.gravity_scale
        self.model = loaded if scales == (1.0, 1.0) else Scaled(loaded, *scales)
        self._arm = arm_of(loaded, *scales) if config.compiled else None

    def advance_payload(self) -> None:
        """Have a payload that was set enter the model by a sample."""
        if self._payload.changing and self._payload.advance():
            self._use_model(self.config)
            stepper = self._stepper
            if isinstance(stepper, CompiledStep) and self._arm is not None:
                stepper.arm.fill(self._arm)
            elif isinstance(stepper, PlainStep):
                stepper.use_model(self.model)

    def _make_law(self, config: ControllerConfig) -> Law:
        law: Law = law_class(config.law).from_config(config, seconds(self._period))
        return law

    def _use(self, config: ControllerConfig) -> None:
        self.law = self._make_law(config)
        self.config = config
        self.settings = ControlSettings.from_config(config, self.model.effort_limits)

    def check(self, config: ControllerConfig) -> None:
        """Raise `CtcError` if a law cannot be made."""
        self._payload.check(config)
        with as_ctc_error(f'the law {config.law} cannot be constructed'):
            self._make_law(config).initial()

    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from now on.

        The filter state ξ is preserved, so that v has no step (unless b itself changes). The same
        law keeps integrals and estimates. Another one takes over (`control.handover`).
        """
        memories = self.memories
        self._payload.request(config)
        old = self._replaced or ReplacedLaw(self.config.law, self.law, memories.law)
        self._use(config)
        law_memory, self._replaced = self.law.initial(), None
        if self._phase in (Phase.RUNNING, Phase.HANDOVER):
            self._phase = Phase.RUNNING
            if config.law == old.name:
                law_memory = self.law.reconfigured(old.memory)
            else:
                self._phase, self._replaced = Phase.HANDOVER, old
        self.memories = memories._replace(law=law_memory)

    def reset(self, bumpless: bool = False, held: Vector | None = None) -> None:
        """
        Start again.

        There is no estimate then, no torque in transit, and ξ = 0. A payload that was set has
        entered the model, unless a torque is held.

        Parameters
        ----------
        bumpless : bool
            Start with v = 0 instead, so that the first torque is the inverse dynamics alone.
        held : sequence of float, shape (n,), optional
            Torque that is still held, from which `effort_rate_limit` goes on. The default is 0.

        """
        if not isinstance(bumpless, (bool, np.bool_)):
            raise ParameterError('bumpless', bumpless, 'true or false')
        if held is None:
            self._payload.finish()
            self.advance_payload()
        zero = np.zeros(self.model.n)
        tau = zero if held is None else checked_vector('held', held, self.model.n)
        self.transit[:] = 0.0
        self._phase = Phase.BUMPLESS_START if bumpless else Phase.START
        self._replaced = None
        self._stamp = None
        self._offset = 0
        control = ControlMemory(
            xi=zero,
            held=tau,
            handover_offset=zero,
            handover_samples_left=float(-self.config.input_delay),
            transit_index=0.0)
        last = LastSample(zero, zero, zero)
        self.memories = Memories(control, self.law.initial(), last)

    @property
    def memories(self) -> Memories:
        """Return the memories after the last sample."""
        return self._memories if self._stepper is None else self._stepper.memories

    @memories.setter
    def memories(self, memories: Memories) -> None:
        if self._stamp is not None:
            self._stamp += len(self._predicted) * self._period
        self._memories, self._stepper, self._predicted = memories, None, []

    def _make_stepper(self) -> PlainStep | CompiledStep:
        stepper: PlainStep | CompiledStep | None = self.compiled_step()
        if stepper is None or not stepper.compiled:
            stepper = PlainStep(
                self.settings, self.law, self._memories, self.transit, self.model)
        self._stepper = stepper
        return stepper

    def compiled_step(self) -> CompiledStep | None:
        """Return the next step for machine code, if possible."""
        if isinstance(self._stepper, CompiledStep):
            return self._stepper
        if self.arm is None:
            return None
        return CompiledStep(self.settings, self.law, self.memories, self.transit, self.arm)

    @property
    def arm(self) -> ArmNumbers | None:
        """Return the numbers of a compilable model and law."""
        return self._arm if type(self.memories.law) in RECORDS else None

    @property
    def compiled(self) -> bool:
        """Return whether steps are machine code."""
        return (self._stepper or self._make_stepper()).compiled

    @property
    def computed_by(self) -> str:
        """Return what computes the steps, machine code or plain Python."""
        return MACHINE_CODE if self.compiled else PLAIN_PYTHON

    @property
    def stability(self) -> Stability:
        """Return the stability that the law reports."""
        stepper = self._stepper
        memory = self._memories.law if stepper is None else stepper.law_memory
        return self.law.stability(memory)

    def _begin(self, rows: Array) -> None:
        """Begin as the phase says."""
        memories = self.memories
        if self._phase is Phase.BUMPLESS_START:
            xi = self.settings.filter.b * (rows[3] - rows[1])
            self.memories = memories._replace(control=memories.control._replace(xi=xi))
        elif self._replaced:
            self.memories = take_over(
                self.settings,
                self._replaced.law,
                self._replaced.memory,
                self.law,
                memories,
                self.model,
                rows)
        self._phase, self._replaced = Phase.RUNNING, None

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
             ahead: Sequence[Point] = (), t: int | None = None, at: int | None = None,
             late: int = 0) -> Sample:
        """
        Return the torque for this sample, with its terms.

        Where the period of a state is over, or has been answered by `predicted_step`, the law
        takes the state as of its stamp, and the torque in force for that period. The sample that
        is returned is for the present period.

        Parameters
        ----------
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        q_d, dq_d, ddq_d : sequence of float, shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
        ahead : sequence of (q_d, dq_d, ddq_d)
            The same for the next samples, as many as `input_delay` says.
        t, at : int, optional
            Stamp of the state, and instant of the reference, best `instant`. The default is t
            [ns].
        late : int
            Periods that have passed since t. Without an answer, the torque sent last is in force.

        """
        rows = self._rows(q, dq, q_d, dq_d, ddq_d, ahead)
        self.advance_payload()
        if self._phase is not Phase.RUNNING:
            self._begin(rows)
        predicted, period = len(self._predicted), self._period
        #: Stamp of the next state, if none is late.
        due = None if self._stamp is None else self._stamp + (predicted + 1) * period
        if t is None or (not late and (due is None or (t == due and not self._offset))):
            self._stamp, self._offset, self._predicted = t, 0, []
            return self._step(rows, REGULAR)
        missed, offset = self._locate(t)
        reference_offset = t - offset - (t if at is None else at)
        irregularity = SampleIrregularity(offset / 1e9, reference_offset / 1e9, 1.0, 1.0)
        if due is not None and t < due and missed < predicted:
            sample = self._merge(missed, rows, irregularity)
        else:
            self._predicted = []
            for k in range(missed - predicted, 0, -1):
                self._step(rows, missing_state(reference_offset - k * period, True))
            sample = self._step(rows, irregularity._replace(keeps_torque=float(late > 0)))
        self._stamp, self._offset = t, offset
        for k in range(len(self._predicted) + 1, late + 1):
            sample = self._predict(rows, reference_offset + k * period, k < late)
        return sample

    def instant(self, t: int) -> int:
        """
        Return the instant at which `step` takes a state.

        The stamp of the state is `t` [ns].
        """
        stamp = self._stamp
        if stamp is None or (t - stamp == self._period and not self._offset):
            return t
        return t - self._locate(t)[1]

    def _locate(self, t: int) -> tuple[int, int]:
        """Return `locate_sample` for a state of stamp `t`."""
        if self._stamp is None:
            return 0, 0
        return locate_sample(self._period, self._offset, t - self._stamp)

    @property
    def predicted_periods(self) -> int:
        """Return the number of periods answered without a state."""
        return len(self._predicted)

    def predicted_step(self, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                       ahead: Sequence[Point] = (), periods: int = 1) -> Sample | None:
        """
        Return the sample of `step` for a predicted state.

        The state is that some periods after the last one. Return None without a state with a
        stamp, where another law is to take over, or where it leaves the range of numbers.

        Parameters
        ----------
        q_d, dq_d, ddq_d, ahead
            As of `step`, for the `instant` of a stamp so many periods after the last one.
        periods : int
            In all but the last of which the torque sent last is in force.

        """
        zero = (0.0,) * self.model.n
        rows = self._rows(zero, zero, q_d, dq_d, ddq_d, ahead)
        if self._stamp is None or self._phase is Phase.HANDOVER:
            return None
        try:
            for k in range(periods - 1, -1, -1):
                sample = self._predict(rows, -k * self._period, k > 0)
        except _OUT_OF_RANGE:
            return None
        return sample if sample.is_finite else None

    def _predict(self, rows: Array, reference_offset: int, keeps_torque: bool) -> Sample:
        """Go on by a period without a state."""
        if not self._predicted:
            self._snapshot = self.memories, self.transit.copy()
        sample = self._step(rows, missing_state(reference_offset, keeps_torque))
        self._predicted.append(PredictedPeriod(rows, reference_offset, np.array(sample.tau)))
        return sample

    def _merge(self, missed: int, rows: Array, irregularity: SampleIrregularity) -> Sample:
        """
        Compute predicted periods again with a measured state.

        Parameters
        ----------
        missed : int
            Index of the state's period.
        rows, irregularity
            Of the state, as of `_step`.

        Returns
        -------
        Sample
            Of the last period.

        """
        periods, (memories, self.transit[:]) = self._predicted, self._snapshot
        stepper = self._stepper or self._make_stepper()
        for k, period in enumerate(periods):
            stepper.memories = memories._replace(
                control=memories.control._replace(held=period.tau))
            if k == missed:
                sample = self._step(rows, irregularity)
                self._snapshot = stepper.memories, self.transit.copy()
                self._predicted = periods[k + 1:]
            else:
                sample = self._step(period.rows, missing_state(period.reference_offset, True))
            memories = stepper.memories
        return sample

    def _step(self, rows: Array, irregularity: SampleIrregularity) -> Sample:
        stepper = self._stepper or self._make_stepper()
        *values, saturation_error = stepper.step(rows, irregularity)
        return Sample(*values, saturation_error if any(saturation_error) else None)  # type: ignore

    def _rows(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
              ahead: Sequence[Point]) -> Array:
        """
        Return q, dq and all points as rows.

        Their shape is (5 + 3 d, n). Other input raises `CtcError`.
        """
        delay = self.config.input_delay
        vectors = [q, dq, q_d, dq_d, ddq_d]
        try:
            for point in ahead[:delay]:
                vectors.extend(point)
            rows = np.array(vectors, float)
            if rows.shape == (5 + 3 * delay, self.model.n):
                return rows
        except (TypeError, ValueError, OverflowError):
            pass
        needed = f'{self.model.n} numbers each, and {delay} points ahead, as input_delay says'
        values = q, dq, q_d, dq_d, ddq_d, ahead
        raise CtcError(str(ParameterError('q, dq, q_d, dq_d, ddq_d, ahead', values, needed)))

    def try_step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                 ahead: Sequence[Point] = (), t: int | None = None, at: int | None = None,
                 late: int = 0) -> Sample | None:
        """
        Return the sample of `step`, or None.

        None is for a step that leaves the range of numbers. The law must then be `reset`.
        """
        try:
            sample = self.step(q, dq, q_d, dq_d, ddq_d, ahead, t, at, late)
        except _OUT_OF_RANGE:
            return None
        return sample if sample.is_finite else None

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M v of (9) [J]."""
        position = checked_vector('q', q, self.model.n)
        error = checked_vector('v', v, self.model.n)
        mass = np.array(self.model.mass_matrix(position.tolist()))
        return 0.5 * float(error @ mass @ error)
