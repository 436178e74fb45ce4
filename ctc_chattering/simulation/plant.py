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

"""The simulated robot of a model: equation (1), with rigid or elastic joints."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf, isfinite

from ctc_chattering.dynamics.arm import Arm, arm_of
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.compilable import RECORDS
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.machine_code import MACHINE_CODE, PLAIN_PYTHON
from ctc_chattering.simulation.compiled_plant import CompiledPlantStep
from ctc_chattering.simulation.friction import own_friction
from ctc_chattering.simulation.motion import Acting, advanced, Mechanism, Motion
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.plant_step import PlantParameters, PlantState
from ctc_chattering.simulation.sensor import Measured
from ctc_chattering.simulation.simulated_robot import Robot, ToCoordinates

#: Largest step of the integrator times the fastest eigenvalue of an elastic joint.
_STEP_RATE = 0.2


class Plant(Robot):
    """
    The simulated robot of a `Model`.

    Parameters
    ----------
    config : PlantConfig
        Physics and start.
    model : Model, optional
        Of the links, in place of the one that the configuration names.

    Attributes
    ----------
    modes : tuple of int
        For each coordinate +1 or -1 if it slides, 0 if it sticks or has no friction.
    motion : Motion
        State of the coordinates.
    compiled : bool
        Whether the next step is machine code.

    """

    def __init__(self, config: PlantConfig, model: Model | None = None) -> None:
        self.model = self._coupled = model or model_of(config)
        if self.model.n != len(config.joint_names):
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        start: tuple[Vector, Vector] = config.initial_position, config.initial_velocity
        maps: tuple[ToCoordinates | None, ToCoordinates | None] = None, None
        longest = inf
        self._encoders: Sequence[int] = ()
        if config.elastic:
            elastic = self._coupled = Elastic(
                self.model, config.joint_stiffness, config.joint_damping, config.motor_inertia)
            maps, longest = (elastic.on_motors, elastic.on_links), (
                _STEP_RATE / elastic.rate(config.initial_position))
            start = elastic.start(*start)
            self._encoders = (elastic.motors if config.encoder_side == 'motor'
                              else range(self.model.n))
        self.own = own_friction(config.friction_model, config.joint_names)
        rest = [0.0] * self._coupled.n
        self._motion = Motion(*start, rest, 0, rest, 0.0)
        self._arm: Arm | None = None
        if config.compiled and not config.elastic and type(self.own) in RECORDS and (
                type(self) is Plant):
            self._arm = arm_of(self.model)
        #: The machine code of the steps until the next change; None for plain Python.
        self._compiled: CompiledPlantStep | None = None
        self._prepared = False
        super().__init__(config, *maps, longest)
        self.configure(config)

    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        if self._compiled is not None:
            state = self._compiled.state()
            self.driven, self._motion = state.driven, state.motion
            self.transit = self._compiled.records.transit.tolist()[:config.input_delay]
            self.sensor.shown = state.shown
        self._compiled, self._prepared = None, False
        super().configure(config)
        self.mechanism = Mechanism(self._coupled, self.own, self.mechanics)
        self._motion = self._motion._replace(decided=0.0)

    def compiled_step(self) -> CompiledPlantStep | None:
        """Return the step from now on as machine code takes it; None where it cannot."""
        if self._arm is None:
            return None
        return CompiledPlantStep(
            self._arm, self.own, PlantParameters(
                self.mechanics, self.drives, self.sensor.encoders, self.config.sample_loss,
                self.config.sample_jitter, self.last),
            PlantState(self.k, self.driven, self._motion, Measured(*self.measured),
                       self.offset, self.lost_in_a_row), self.transit)

    @property
    def compiled(self) -> bool:
        """Whether the next step is machine code."""
        if not self._prepared:
            step, self._prepared = self.compiled_step(), True
            self._compiled = step if step is not None and step.compiled else None
        return self._compiled is not None

    @property
    def computed_by(self) -> str:
        """Return what computes the next step."""
        return MACHINE_CODE if self.compiled else PLAIN_PYTHON

    @property
    def motion(self) -> Motion:
        """Return the state of the coordinates."""
        return self._motion if self._compiled is None else self._compiled.state().motion

    @property
    def applied(self) -> Vector:
        """Return the torque of the drives at the end of the last period, shape (n,) [N·m]."""
        return self.driven.torque if self._compiled is None else self._compiled.torque.tolist()

    @property
    def modes(self) -> tuple[int, ...]:
        """Return the modes."""
        return tuple(map(int, self.motion.mode))

    def _seen(self) -> tuple[Vector, Vector]:
        """Return what the encoders see: motors or links."""
        if not self._encoders:
            return self.q, self.dq
        q, dq = self._motion.q, self._motion.dq
        return [q[i] for i in self._encoders], [dq[i] for i in self._encoders]

    def _go_on(self, tau: Vector) -> None:
        """Bring all but `k` to the next sample."""
        if not self.compiled:
            super()._go_on(tau)
            return
        made, config, sensor = self._compiled, self.config, self.sensor
        assert made is not None
        late = self.lateness.random() if config.late_samples else 1.0
        loss = self.loss.random() if config.sample_loss else 1.0
        jitter = self.jitter.random() if config.sample_jitter else 0.5
        noise = sensor.encoders.position_noise, sensor.encoders.velocity_noise
        made.go_on(tau, late, loss, jitter, () if sensor.perfect else map(sensor.noise, noise))
        self.q, self.dq, self.measured, self.offset, self.lost_in_a_row = made.shown()
        if not isfinite(sum(self.q) + sum(self.dq)):
            self.driven = made.state().driven

    def _move(self, now: Acting) -> None:
        """Go on by one control period in as many steps as `integration_step` asks for."""
        self._motion = advanced(self.mechanism, now, self._motion)
        self.q, self.dq = self._motion.q, self._motion.dq
        if self._encoders:
            self.q, self.dq = self.q[:self.n], self.dq[:self.n]
