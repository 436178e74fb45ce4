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

from collections.abc import Sequence
from itertools import chain, islice
from math import isfinite
from typing import Any, NamedTuple, NoReturn

from ctc_chattering.arguments import checked, vector
from ctc_chattering.control.compiled_step import CompiledStep
from ctc_chattering.control.control_step import control_memory, in_transit, step
from ctc_chattering.control.controller_config import ControllerConfig, LAWS
from ctc_chattering.control.evaluation import Context, control_settings, ControlMemory, Models
from ctc_chattering.control.handover import taken_over
from ctc_chattering.control.laws.base import Law
from ctc_chattering.control.laws.registry import law_class
from ctc_chattering.dynamics.arm import Arm, arm_of
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.scaled_model import Scaled
from ctc_chattering.errors import CtcError, ParameterError, refused_as
from ctc_chattering.numerics.linear_algebra import Array, Vector
from ctc_chattering.numerics.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.numerics.time_grid import period_ns, seconds
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
    until sample k + 1. It reads no clock; the filter advances by exactly one period per call.

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
    settings, law : ControlSettings, Law
        What is common to all laws, and the law in force.
    memory : ControlMemory
        What the control step remembers.
    transit : array, shape (4 input_delay, n)
        Torques in transit.

    """

    @checked(config=ControllerConfig, model=(Model, type(None)))
    def __init__(self, config: ControllerConfig, model: Model | None = None) -> None:
        n = len(config.joint_names)
        self.model = known = model or model_of(config)
        if self.model.n != n:
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        if (config.inertia_scale, config.gravity_scale) != (1.0, 1.0):
            self.model = Scaled(self.model, config.inertia_scale, config.gravity_scale)
        self._arm: Arm | None = None
        if config.compiled:
            self._arm = arm_of(known, config.inertia_scale, config.gravity_scale)
        self.transit = in_transit(n, config.input_delay)
        #: Laws that are not in force, with what they remember.
        self._others: dict[str, tuple[Law, Any]] = {}
        self.config, self.law, self._law_memory = config, self._made(config), None
        self.reset()
        self.configure(config)

    @staticmethod
    def _made(config: ControllerConfig) -> Law:
        return law_class(config.law).made(config, seconds(period_ns(config.control_period)))

    def _successor(self, config: ControllerConfig) -> tuple[Law, Any]:
        """Return the law of a configuration, with what it goes on from."""
        law = self._made(config)
        known = {**self._others, self.config.law: (self.law, self.law_memory)}
        before, memory = known.get(config.law, (law, law.initial()))
        return law, law.reconfigured(memory, before)

    def check(self, config: ControllerConfig) -> None:
        """Raise `CtcError` if the law of a configuration cannot be made, or cannot take over."""
        with refused_as(f'the law {config.law} cannot be made'):
            self._successor(config)

    @checked(config=ControllerConfig)
    def configure(self, config: ControllerConfig) -> None:
        """
        Use other gains or another law from the next step on.

        The filter state ξ is preserved, so that v has no step (unless b itself changes), and
        so are integrals and estimates. `handover` says how another law takes over.
        """
        law, memory = self._successor(config)
        self._take_back()
        self._others[self.config.law] = self.law, self._law_memory
        self._others.pop(config.law, None)
        self.config, self.law, self._law_memory = config, law, memory
        self.settings = control_settings(config, self.model.effort_limits)
        self._context = Context(
            self.settings, Models(self.model, self.model, self.model), self.transit)

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
        #: The machine code of the steps until the next change; None for plain Python.
        self._compiled: CompiledStep | None = None
        self._prepared = False
        self._memory = control_memory(
            np.zeros(n) if held is None else vector('held', held, n), self.config.input_delay)
        self.transit[:] = 0.0
        self._law_memory = self.law.initial()
        self._others.clear()
        #: Law of the last step; empty before the first.
        self._before = ''
        self._bumpless = bumpless

    @property
    def compiled(self) -> bool:
        """Whether the next step is machine code."""
        if self._prepared:
            return self._compiled is not None
        step = self.compiled_step()
        return step is not None and step.compiled

    @property
    def computed_by(self) -> str:
        """Return what computes the next step, machine code or plain Python."""
        return MACHINE_CODE if self.compiled else PLAIN_PYTHON

    def compiled_step(self) -> CompiledStep | None:
        """Return the step from now on as machine code takes it; None where it cannot."""
        if self._arm is None:
            return None
        return CompiledStep(self.settings, self.law, self._memory, self._law_memory, self.transit,
                            self._arm)

    @property
    def memory(self) -> ControlMemory:
        """Return what the control step remembers."""
        return self._memory if self._compiled is None else self._compiled.memories()[0]

    @memory.setter
    def memory(self, memory: ControlMemory) -> None:
        self._take_back()
        self._memory = memory

    @property
    def law_memory(self) -> Any:
        """Return what the law in force remembers."""
        return self._law_memory if self._compiled is None else self._compiled.memories()[1]

    @property
    def stability(self) -> tuple[float, float]:
        """Return part of its bandwidth that the law uses, and how long it was too much [s]."""
        memory = self.law_memory
        return self.law.bandwidth_in_use(memory), self.law.out_of_control(memory)

    def _take_back(self) -> None:
        """Go on with what machine code remembers, as plain Python."""
        if self._compiled is not None:
            self._memory, self._law_memory = self._compiled.memories()
        self._compiled, self._prepared = None, False

    def prepare(self, rows: Array) -> None:
        """
        Begin with v = 0, or take over from another law, if the step to come is to do so.

        Parameters
        ----------
        rows : array, shape (5, n)
            Its q, dq, q_d, dq_d, ddq_d.

        """
        if self._bumpless:
            self._memory = self._memory._replace(xi=self.settings.filter.b * (rows[3] - rows[1]))
            self._bumpless = False
        if self._before in self._others:
            self._memory, self._law_memory = taken_over(
                self.settings, self._others[self._before], self.law, self._law_memory,
                self._memory, self.model, rows)
        self._before = self.config.law
        compiled = self.compiled_step()
        self._compiled = compiled if compiled is not None and compiled.compiled else None
        self._prepared = True

    def step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
             ahead: Sequence[Point] = ()) -> Sample:
        """
        Return the torque for this sample, and what it is made of.

        Parameters
        ----------
        q, dq : sequence of float, shape (n,)
            Position [rad] and velocity [rad/s].
        q_d, dq_d, ddq_d : sequence of float, shape (n,)
            Desired position [rad], velocity [rad/s] and acceleration [rad/s²].
        ahead : sequence of (q_d, dq_d, ddq_d)
            The same for the next samples, as many as `input_delay` says.

        """
        try:
            delay = self.config.input_delay
            more = islice(chain.from_iterable(ahead), 3 * delay) if delay else ()
            rows = np.array((q, dq, q_d, dq_d, ddq_d, *more), float)
            wrong = rows.shape != (5 + 3 * delay, self.model.n)
        except (TypeError, ValueError, OverflowError):
            wrong = True
        if wrong:
            self._refuse((q, dq, q_d, dq_d, ddq_d), ahead)
        if not self._prepared:
            self.prepare(rows)
        if self._compiled is not None:
            self._compiled.measured[:], self._compiled.points[:] = rows[:2], rows[2:]
            self._compiled.step()
            made: list[list[float]] = self._compiled.made.tolist()
            return Sample(*made[:7], made[7] if any(made[7]) else None)  # type: ignore[call-arg]
        now, terms, sent, self._memory, self._law_memory = step(
            self._context, self.law, self._memory, self._law_memory, rows[0], rows[1], rows[2:])
        lost = sent.saturation_error
        saturated = lost is not self.settings.zero and lost.any()
        return Sample(
            sent.tau.tolist(), now.e.tolist(), now.de.tolist(), now.v.tolist(),
            terms.nominal.tolist(), terms.compensation.tolist(), terms.robust.tolist(),
            lost.tolist() if saturated else None)

    def _refuse(self, rows: Sequence[Vector], ahead: Sequence[Point]) -> NoReturn:
        """Raise the error for what `step` cannot take."""
        if len(ahead) < self.config.input_delay:
            raise CtcError(str(ParameterError(
                'ahead', ahead, f'{self.config.input_delay} points, as input_delay says')))
        raise CtcError(str(ParameterError(
            'q, dq, q_d, dq_d, ddq_d', rows, f'{self.model.n} numbers each')))

    def try_step(self, q: Vector, dq: Vector, q_d: Vector, dq_d: Vector, ddq_d: Vector,
                 ahead: Sequence[Point] = ()) -> Sample | None:
        """
        Return what `step` does; None where that leaves the range of numbers.

        The law must then be `reset`.
        """
        try:
            sample = self.step(q, dq, q_d, dq_d, ddq_d, ahead)
        except (ArithmeticError, ValueError, np.linalg.LinAlgError):  # 1 / 0, sin(inf)
            return None
        return sample if isfinite(sum(sample.tau) + sum(sample.v)) else None

    def lyapunov(self, q: Vector, v: Vector) -> float:
        """Return V = ½ vᵀ M(q) v of equation (9) [J]."""
        at, x = (vector(name, values, self.model.n) for name, values in (('q', q), ('v', v)))
        return 0.5 * float(x @ np.array(self.model.mass_matrix(at.tolist())) @ x)
