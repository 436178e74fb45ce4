"""
The simulated robot: equation (1) with set-valued Coulomb friction, under a held torque.

Between changes of stick and slide the motion is smooth and a Runge-Kutta step of fourth order
follows it. Where a sliding joint comes to rest, or a stuck one is overloaded, the instant is
located within the step, the modes are determined again there, and the rest of the step goes on.

The coordinates are the positions of the joints or, with elastic joints, of links and motors
(`dynamics/elastic_model.py`); drives and friction act on the motors, the disturbance on the links.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import exp, inf

from ctc_chattering.arguments import checked
from ctc_chattering.dynamics.elastic_model import Elastic
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.event_location import first_negative
from ctc_chattering.numerics.linear_algebra import Vector
from ctc_chattering.numerics.runge_kutta import Dynamics, step
from ctc_chattering.simulation.friction import bit_mask, excess, modes
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.simulated_robot import plus, Robot

#: Changes of mode that one step may hold; beyond it the step ends in the mode it is in.
_MAX_EVENTS = 50
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

    """

    @checked(config=PlantConfig, model=(Model, type(None)))
    def __init__(self, config: PlantConfig, model: Model | None = None) -> None:
        self.model = self._coupled = model or model_of(config)
        if self.model.n != len(config.joint_names):
            raise CtcError(f'joint_names: {list(config.joint_names)} are not allowed with a model '
                           f'of {self.model.n} joints')
        motors: Sequence[int] = range(self.model.n)
        longest = inf
        #: Positions and velocities of links and motors; None for rigid joints.
        self._coordinates: tuple[Vector, Vector] | None = None
        if config.elastic:
            elastic = self._coupled = Elastic(
                self.model, config.joint_stiffness, config.joint_damping, config.motor_inertia)
            motors, start = elastic.motors, config.initial_position
            self._coordinates = elastic.start(start, config.initial_velocity)
            longest = _STEP_RATE / elastic.rate(start)
        self._encoders = motors if config.encoder_side == 'motor' else range(self.model.n)
        super().__init__(config, motors, longest)
        self.modes: tuple[int, ...] = (0,) * self._coupled.n
        self.configure(config)

    @checked(config=PlantConfig)
    def configure(self, config: PlantConfig) -> None:
        """Use another friction or disturbance from the next step on."""
        super().configure(config)
        self._velocity_friction = None
        viscous = self._viscous_friction()
        if any(viscous) or any(config.stribeck_friction):
            self._velocity_friction = list(zip(*map(self._on_motors, (
                viscous, config.stribeck_friction, config.stribeck_velocity))))
        self._set_breakaway()

    def _set_breakaway(self) -> None:
        """Set the friction at rest, and have the modes decided again."""
        self._breakaway = self._on_motors([
            a + b for a, b in zip(self._coulomb_friction(), self.config.stribeck_friction)])
        self._rubbing = [i for i, x in enumerate(self._breakaway) if x > 0.0]
        self._decided = False

    def _on_motors(self, values: Vector) -> Vector:
        """Return values of the joints as those of the coordinates; 0 for links with a motor."""
        if self._coordinates is None:
            return values
        return plus([0.0] * self._coupled.n, self._motors, values)

    def _seen(self) -> tuple[Vector, Vector]:
        """Return what the encoders see: motors or links."""
        if self._coordinates is None:
            return self.q, self.dq
        q, dq = self._coordinates
        return [q[i] for i in self._encoders], [dq[i] for i in self._encoders]

    def _move(self, t: float, tau: Vector) -> None:
        """Go on by one control period in as many steps as `integration_step` asks for."""
        if self._loaded:
            self._set_breakaway()
        if self._coordinates is not None:
            self.q, self.dq = self._coordinates
            tau = self._on_motors(tau)
        if not self._decided or self._stuck or 0.0 in self.dq:
            self._decide(t, tau)
        h = self._h
        for i in range(self._substeps):
            self._advance(t + i * h, h, tau)
        if self._coordinates is not None:
            self._coordinates = self.q, self.dq
            self.q, self.dq = self.q[:self.n], self.dq[:self.n]

    def _decide(self, t: float, tau: Vector) -> None:
        """Set the modes from the state and the load at time `t`."""
        load = self._torque(t, tau)
        if self._velocity_friction:
            signs = [(x > 0.0) - (x < 0.0) for x in self.dq]
            load = self._minus_velocity_friction(self.dq, load, signs)
        self.modes = modes(self._coupled, self.q, self.dq, load, self._breakaway)
        mode = self.modes
        self._stuck = [i for i in self._rubbing if not mode[i]]
        self._sliding = [i for i in self._rubbing if mode[i]]
        self._fixed_joints = bit_mask(self._stuck)
        self._friction = [x * m for x, m in zip(self._breakaway, mode)]
        self._decided = True

    def _advance(self, t: float, h: float, tau: Vector) -> None:
        """Integrate over `h` [s] from `t` [s], through any change of mode."""
        load = [a - f for a, f in zip(tau, self._friction)]
        for _ in range(_MAX_EVENTS):
            q, dq = self._runge_kutta(t, h, load)
            held = self._margin(t + h, q, dq, load)
            if held >= 0.0:
                self.q, self.dq = q, dq
                return
            s = self._locate(t, h, load, held)
            self.q, dq = self._runge_kutta(t, s, load)
            mode = self.modes
            self.dq = [x if x * m >= 0.0 else 0.0 for x, m in zip(dq, mode)]
            t, h = t + s, h - s
            self._decide(t, tau)
            load = [a - f for a, f in zip(tau, self._friction)]
        self.q, self.dq = self._runge_kutta(t, h, load)

    def _margin(self, t: float, q: Vector, dq: Vector, load: Vector) -> float:
        """Return how far the joint nearest to it is from leaving its mode; negative if it has."""
        mode = self.modes
        margin = inf
        for i in self._sliding:
            x = dq[i] * mode[i]
            if x < margin:
                margin = x
        if self._stuck:
            u = self._torque(t, load)
            if self._velocity_friction:
                u = self._minus_velocity_friction(dq, u, mode)
            beyond = max(excess(self._coupled, q, dq, u, self._breakaway, self._stuck))
            if -beyond < margin:
                margin = -beyond
        return margin

    def _locate(self, t: float, h: float, load: Vector, held: float) -> float:
        """
        Return an instant after `t` [s], to 1e-12 h late, at which a joint first left its mode.

        Parameters
        ----------
        t, h : float
            Start and length of the step [s].
        load : sequence of float, shape (n,)
            Torque less sliding friction [N·m].
        held : float
            What `_margin` is at the end of the step: negative.

        """
        def margin(s: float) -> float:
            q, dq = self._runge_kutta(t, s, load)
            return self._margin(t + s, q, dq, load)

        return first_negative(margin, h, held, 1e-12 * h)

    def _sliding_dynamics(self, q: Vector, dq: Vector, u: Vector, fixed_joints: int) -> Vector:
        """Return ddq where friction depends on the velocity; `u` has its value near rest off."""
        u = self._minus_velocity_friction(dq, u, self.modes)
        return self._coupled.forward_dynamics(q, dq, u, fixed_joints)

    def _minus_velocity_friction(self, dq: Vector, u: Vector, mode: Sequence[int]) -> Vector:
        """Return `u` less what friction at the velocity `dq` exceeds its value near rest by."""
        assert self._velocity_friction is not None
        return [
            x - viscous * v + (fall * m * (1.0 - exp(-(r := v / speed) * r)) if fall else 0.0)
            for x, v, m, (viscous, fall, speed) in zip(u, dq, mode, self._velocity_friction)]

    def _runge_kutta(self, t: float, h: float, load: Vector) -> tuple[Vector, Vector]:
        """Return q and dq after one step of fourth order in the present modes."""
        dynamics: Dynamics = self._coupled.forward_dynamics
        if self._velocity_friction:
            dynamics = self._sliding_dynamics
        loads = (load, load, load)
        if self._varying:
            loads = (self._torque(t, load), self._torque(t + 0.5 * h, load, 0.5 * h),
                     self._torque(t + h, load))
        return step(dynamics, self.q, self.dq, loads, self._fixed_joints, h)
