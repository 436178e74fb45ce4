"""The simulated robot of a model: equation (1), with rigid or elastic joints."""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from ctc_chattering.arguments import checked
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.simulation.friction import own_friction
from ctc_chattering.simulation.motion import Acting, advanced, Mechanism, Motion
from ctc_chattering.simulation.plant_config import PlantConfig
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

    """

    @checked(config=PlantConfig, model=(Model, type(None)))
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
        self.motion = Motion(*start, rest, 0, rest, 0.0)
        super().__init__(config, *maps, longest)
        self.configure(config)

    @checked(config=PlantConfig)
    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        super().configure(config)
        self.mechanism = Mechanism(self._coupled, self.own, self.mechanics)
        self.motion = self.motion._replace(decided=0.0)

    @property
    def modes(self) -> tuple[int, ...]:
        """Return the modes."""
        return tuple(map(int, self.motion.mode))

    def _seen(self) -> tuple[Vector, Vector]:
        """Return what the encoders see: motors or links."""
        if not self._encoders:
            return self.q, self.dq
        q, dq = self.motion.q, self.motion.dq
        return [q[i] for i in self._encoders], [dq[i] for i in self._encoders]

    def _move(self, now: Acting) -> None:
        """Go on by one control period in as many steps as `integration_step` asks for."""
        self.motion = advanced(self.mechanism, now, self.motion)
        self.q, self.dq = self.motion.q, self.motion.dq
        if self._encoders:
            self.q, self.dq = self.q[:self.n], self.dq[:self.n]
