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

"""The controller: one call of `step` per sample, by the law that its parameters name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import chain, islice
from math import isfinite
from typing import Any, NamedTuple

from ctc_chattering.compiled.compilable import RECORDS
from ctc_chattering.compiled.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.control import step as steps
from ctc_chattering.control.controller_config import ControllerConfig, LAWS
from ctc_chattering.control.laws.base import Law, law_class, Stability
from ctc_chattering.control.step import Arrival, CompiledStep, Memories, PlainStep, REGULAR
from ctc_chattering.dynamics.compiled_model import Arm, arm_of
from ctc_chattering.dynamics.model import Model, Scaled
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import as_ctc_error, CtcError, ParameterError
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.time_grid import period_ns, seconds
from ctc_chattering.parameters import vector
from ctc_chattering.trajectory.buffer import Point
import numpy as np

__all__ = ['LAWS', 'Controller', 'ControllerConfig', 'Sample']


class Sample(NamedTuple):
    """
    What one control step computed; every vector is a list of n floats.

    e, de and v belong to the state; what follows to the torque, which under an input delay is for
    the state predicted over it.

    Attributes
    ----------
    tau : list of float
        Torque to send, within the limits [N·m].
    e, de : list of float
        Errors q_d - q [rad] and dq_d - dq [rad/s].
    v : list of float
        Filtered error [rad/s].
    nominal : list of float
        What model and feedback ask for: M [ddq_d + Kv de + Kp e] + C dq + G under most laws [N·m].
    compensation : list of float
        C v, which the laws (2) and (6) subtract; 0 under the others [N·m].
    robust : list of float
        What is subtracted against the perturbation: Ka sgn(v) under (6), however switched [N·m].
    saturation_error : list of float, or None
        What the limits have taken from the torque [N·m]; None for nothing.

    """

    tau: Vector
    e: Vector
    de: Vector
    v: Vector
    nominal: Vector
    compensation: Vector
    robust: Vector
    saturation_error: Vector | None


class Controller:
    """
    The sampled controller: one call of `step` per state.

    Contract: `step` takes the state and the reference at sample k and returns the torque to hold
    until sample k + 1. It reads no clock. By the stamps of the states it goes on by as many
    periods as have passed (`control.step`); without stamps that is one a call.

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
        Which joints turn endlessly. Positions that `step` takes count turns all the same.
    settings, law : ControlSettings, Law
        What is common to all laws, and the law in force.
    memories : Memories
        What is remembered: by the control step, by the law, and of the last sample.
    transit : array, shape (4 input_delay, n)
        Torques in transit.
    compiled : bool
        Whether steps are machine code, as of the last change of law, gains or memories.

    """

    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        n = len(config.joint_names)
        self.model = known = model or model_of(config)
        if self.model.n != n:
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        if (config.inertia_scale, config.gravity_scale) != (1.0, 1.0):
            self.model = Scaled(self.model, config.inertia_scale, config.gravity_scale)
        self.continuous = config.which_are_continuous(known.continuous)
        self._arm: Arm | None = None
        if config.compiled:
            self._arm = arm_of(known, config.inertia_scale, config.gravity_scale)
        self.transit = np.zeros((steps.ROWS * config.input_delay, n))
        self._period = period_ns(config.control_period)
        #: Whether there was a step, and its law with name and memory if another one follows.
        self._started = False
        self._replaced: tuple[str, Law, Any] | None = None
        self._use(config)
        self.reset()

    def _use(self, config: ControllerConfig) -> None:
        self.law = law_class(config.law).made(config, seconds(self._period))
        self.config = config
        self.settings = steps.control_settings(config, self.model.effort_limits)

    def check(self, config: ControllerConfig) -> None:
        """Raise `CtcError` if the law of a configuration cannot be made."""
        with as_ctc_error(f'the law {config.law} cannot be made'):
            law_class(config.law).made(config, seconds(self._period)).initial()

    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ is preserved, so that v has no step (unless b itself changes). The same
        law keeps integrals and estimates; `taken_over` says how another one takes over.
        """
        memories = self.memories
        name, law, memory = self._replaced or (self.config.law, self.law, memories.law)
        self._use(config)
        goes_on = self._started and config.law == name
        self._replaced = (name, law, memory) if self._started and not goes_on else None
        self.memories = memories._replace(
            law=self.law.reconfigured(memory) if goes_on else self.law.initial())

    def reset(self, bumpless: bool = False, held: Vector | None = None) -> None:
        """
        Start again: no estimate, no torque in transit, and ξ = 0.

        Parameters
        ----------
        bumpless : bool
            Start with v = 0 instead, so that the first torque is the inverse dynamics alone.
        held : sequence of float, shape (n,), optional
            Torque that is still held, from which `effort_rate_limit` goes on; 0 if left out.

        """
        n = self.model.n
        self.transit[:] = 0.0
        self._started, self._replaced = False, None
        self._bumpless = bumpless
        #: Stamp of the last state, and how long after its sample it was measured [ns].
        self._t: int | None = None
        self._offset = 0
        #: Periods after it that were answered without a state: the rows that the step took, how
        #: long after their instant the sample was [ns], and the torque in force, shape (n,) [N·m];
        #: memories and transit before them.
        self._answered: list[tuple[Array, int, Array]] = []
        self._measured: tuple[Memories, Array]
        zero = np.zeros(n)
        tau = zero if held is None else vector('held', held, n)
        self.memories = Memories(
            steps.ControlMemory(zero, tau, zero, float(-self.config.input_delay), 0.0),
            self.law.initial(), steps.LastSample(zero, zero, zero))

    @property
    def memories(self) -> Memories:
        """Return what is remembered; that which is set is used from the next step on."""
        return self._memories if self._made is None else self._made.memories

    @memories.setter
    def memories(self, memories: Memories) -> None:
        if self._t is not None:
            self._t += len(self._answered) * self._period
        self._answered = []
        self._memories = memories
        self._made: PlainStep | CompiledStep | None = None

    @property
    def _stepper(self) -> PlainStep | CompiledStep:
        """Return what computes the steps until the next change; it is made for the first one."""
        if self._made is None:
            compiled = self.compiled_step()
            self._made = (compiled if compiled is not None and compiled.compiled else PlainStep(
                self.settings, self.law, self._memories, self.transit, self.model))
        return self._made

    def compiled_step(self) -> CompiledStep | None:
        """Return the step from now on as machine code takes it; None where it cannot."""
        if isinstance(self._made, CompiledStep):
            return self._made
        arm = self.arm
        return None if arm is None else CompiledStep(
            self.settings, self.law, self.memories, self.transit, arm)

    @property
    def arm(self) -> Arm | None:
        """Return the numbers of the model; None if it or the law cannot be machine code."""
        return self._arm if type(self.memories.law) in RECORDS else None

    @property
    def compiled(self) -> bool:
        """Whether steps are machine code."""
        return self._stepper.compiled

    @property
    def computed_by(self) -> str:
        """Return what computes the steps, machine code or plain Python."""
        return MACHINE_CODE if self.compiled else PLAIN_PYTHON

    @property
    def stability(self) -> Stability:
        """Return how the loop is doing, as the law sees it."""
        return self.law.stability(self._stepper.law_memory)

    def _begin(self, rows: Array) -> None:
        """Begin with v = 0, or take over from another law, for `rows` as of `step`."""
        memories = self.memories
        if self._bumpless:
            memories = memories._replace(control=memories.control._replace(
                xi=self.settings.filter.b * (rows[3] - rows[1])))
        if self._replaced:
            memories = steps.taken_over(
                self.settings, self._replaced[1:], self.law, memories, self.model, rows)
        self._replaced, self._bumpless = None, False
        self.memories = memories

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
             ahead: Sequence[Point] = (), t: int | None = None, at: int | None = None,
             late: int = 0) -> Sample:
        """
        Return the torque for this sample, and what it is made of.

        Where the period of a state is over, or has been answered by `predicted_step`, the law
        takes the state as of its stamp, and the torque in force for that period; what is returned
        is for the present period.

        Parameters
        ----------
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        q_d, dq_d, ddq_d : sequence of float, shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
        ahead : sequence of (q_d, dq_d, ddq_d)
            The same for the next samples, as many as `input_delay` says.
        t, at : int, optional
            Stamp of the state, and instant of the reference, best `instant`; by default t [ns].
        late : int
            Periods that have passed since t; without an answer, the torque sent last is in force.

        """
        rows = self._rows(q, dq, q_d, dq_d, ddq_d, ahead)
        if self._bumpless or self._replaced:
            self._begin(rows)
        self._started = True
        answered = self.predicted_periods
        #: Before which the next period begins, if none is late.
        end = None if self._t is None else self._t + (answered + 1) * self._period
        if t is None or (not late and (end is None or (t == end and not self._offset))):
            self._t, self._answered = t, []
            return self._step(rows, REGULAR)
        missed, offset = self._follows(t)
        after = t - offset - (t if at is None else at)
        if missed < answered and end is not None and t < end:
            sample = self._merged(missed, rows, offset, after, t)
        else:
            self._t, self._offset, self._answered = t, offset, []
            for k in range(missed - answered, 0, -1):
                self._step(rows, Arrival(0.0, (after - k * self._period) / 1e9, 0.0, 1.0))
            sample = self._step(rows, Arrival(offset / 1e9, after / 1e9, 1.0, float(late > 0)))
        for k in range(self.predicted_periods + 1, late + 1):
            sample = self._predict(rows, after + k * self._period, k < late)
        return sample

    def instant(self, t: int) -> int:
        """Return at which instant the law takes a state of stamp `t` in `step` [ns]."""
        return t - self._follows(t)[1]

    def _follows(self, t: int) -> tuple[int, int]:
        """Return the `periods` of a state of stamp `t` since the last one that was measured."""
        if self._t is None:
            return 0, 0
        return steps.periods(self._period, self._offset, t - self._t)

    @property
    def predicted_periods(self) -> int:
        """Return how many periods after the last state `predicted_step` has answered."""
        return len(self._answered)

    def predicted_step(self, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                       ahead: Sequence[Point] = (), periods: int = 1) -> Sample | None:
        """
        Return what `step` does for the state that is predicted some periods after the last one.

        None without a state with a stamp, where another law is to take over, or where it leaves
        the range of numbers.

        Parameters
        ----------
        q_d, dq_d, ddq_d, ahead
            As of `step`, for the `instant` of a stamp so many periods after the last one.
        periods : int
            In all but the last of which the torque sent last is in force.

        """
        zero = (0.0,) * self.model.n
        rows = self._rows(zero, zero, q_d, dq_d, ddq_d, ahead)
        if self._t is None or self._replaced:
            return None
        for k in range(periods - 1, -1, -1):
            sample = self._finite(self._predict, rows, -k * self._period, k > 0)
        return sample

    def _predict(self, rows: Array, after: int, kept: bool) -> Sample:
        """Go on by a period without a state, at a sample `after` the instant of `rows` [ns]."""
        if not self._answered:
            self._measured = self.memories, self.transit.copy()
        sample = self._step(rows, Arrival(0.0, after / 1e9, 0.0, float(kept)))
        self._answered.append((rows, after, np.array(sample.tau)))
        return sample

    def _merged(self, missed: int, rows: Array, offset: int, after: int, t: int) -> Sample:
        """Take a state whose period has been answered; return the sample of the last period."""
        answered, (memories, self.transit[:]) = self._answered, self._measured
        for k, (rows_before, after_before, tau) in enumerate(answered):
            self._stepper.memories = memories._replace(
                control=memories.control._replace(held=tau))
            if k == missed:
                sample = self._step(rows, Arrival(offset / 1e9, after / 1e9, 1.0, 1.0))
                self._measured = self.memories, self.transit.copy()
                self._t, self._offset, self._answered = t, offset, answered[k + 1:]
            else:
                sample = self._step(rows_before, Arrival(0.0, after_before / 1e9, 0.0, 1.0))
            memories = self.memories
        return sample

    def _step(self, rows: Array, arrival: Arrival) -> Sample:
        made = self._stepper.step(rows, arrival)
        return Sample(*made[:7], made[7] if any(made[7]) else None)  # type: ignore[call-arg]

    def _rows(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
              ahead: Sequence[Point]) -> Array:
        """Return q, dq and all points as rows, shape (5 + 3 d, n); raise `CtcError` if wrong."""
        delay, given = self.config.input_delay, (q, dq, q_d, dq_d, ddq_d)
        try:
            rows = np.array((*given, *islice(chain.from_iterable(ahead), 3 * delay)), float)
            if rows.shape == (5 + 3 * delay, self.model.n):
                return rows
        except (TypeError, ValueError, OverflowError):
            pass
        raise CtcError(str(ParameterError(
            'q, dq, q_d, dq_d, ddq_d, ahead', (*given, ahead), f'{self.model.n} numbers each, and '
            f'{delay} points ahead, as input_delay says')))

    def try_step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                 ahead: Sequence[Point] = (), t: int | None = None, at: int | None = None,
                 late: int = 0) -> Sample | None:
        """
        Return what `step` does; None where that leaves the range of numbers.

        The law must then be `reset`.
        """
        return self._finite(self.step, q, dq, q_d, dq_d, ddq_d, ahead, t, at, late)

    @staticmethod
    def _finite(step: Callable[..., Sample], *arguments: Any) -> Sample | None:
        """Return the sample of a step; None where that leaves the range of numbers."""
        try:
            sample = step(*arguments)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # 1 / 0, sin(inf)
            return None
        return sample if isfinite(sum(sample.tau) + sum(sample.v)) else None

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M(q) v of equation (9) [J]."""
        at, x = (vector(name, values, self.model.n) for name, values in (('q', q), ('v', v)))
        return 0.5 * float(x @ np.array(self.model.mass_matrix(at.tolist())) @ x)
