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
Foreign robots for the study of learning: two engines behind one set of drives and sensors.

Neither engine is of the package. `IndependentArm` is `independent_plant`, `MujocoArm` is the arm
in MuJoCo of `arms_study`. Both have bodies that differ from the URDF by up to 10 %, rotors, dry
friction with a Stribeck part, drives with a lag, a rate limit and a delay, and, as a case, elastic
joints and a load. `ForeignRobot` adds encoders, velocities by difference, lost states and jitter.
It has what the closed loop of the package takes in the place of its own plant.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol

import arms_study
from independent_plant import advance, at_rest, ideal, quantised
import mujoco
import numpy as np
from rigid_bodies import Array, Bodies, dynamics
import robots

#: Nominal dry friction per effort limit, of which the laws that know friction are told.
DRY_PER_EFFORT = 0.04
#: The same where joints stick at reversals.
STICKY_PER_EFFORT = 0.1
#: Stribeck part of the dry friction where joints stick.
STICKY_STRIBECK = 0.6
#: Velocity at which the Stribeck part has fallen to 1 / e [rad/s].
STRIBECK_VELOCITY = 0.02
#: True numbers of friction and lag over the nominal ones, at most this far from 1.
DEVIATION = 0.25
#: Most states that are lost in a row.
MAX_LOST = 2
#: Steps of the physics in a control period, and the step [s].
STEPS = arms_study.STEPS
STEP_S = arms_study.STEP_S
#: The control period [s].
PERIOD_S = STEPS * STEP_S


@dataclasses.dataclass(frozen=True)
class Case:
    """
    Circumstances of a run.

    Attributes
    ----------
    lost : float
        Share of the states that do not arrive.
    jitter : bool
        Whether states are measured up to a quarter of a period off the grid.
    sticky : bool
        Whether friction is large and larger still near rest.
    resonance : float
        Lowest one of elastic joints [Hz]; 0 for stiff joints.
    encoder : str
        Side of an elastic joint that is measured: link or motor.
    load : float
        Part of the arm's rated load that is picked up between two passes.
    stopped : bool
        Whether a pass is stopped in its middle, and goes on later.

    """

    lost: float = 0.0
    jitter: bool = False
    sticky: bool = False
    resonance: float = 0.0
    encoder: str = 'link'
    load: float = 0.0
    stopped: bool = False

    @property
    def dry_per_effort(self) -> float:
        """Return the nominal dry friction per effort limit."""
        return STICKY_PER_EFFORT if self.sticky else DRY_PER_EFFORT


@dataclasses.dataclass(frozen=True)
class Truth:
    """
    Numbers of an arm that no law is told, each of shape (n,).

    Attributes
    ----------
    coulomb, stribeck, viscous : ndarray
        Friction [N·m], its Stribeck part [N·m], and per velocity [N·m·s/rad].
    lag : ndarray
        Of the drives [s].

    """

    coulomb: Array
    stribeck: Array
    viscous: Array
    lag: Array


def draw_truth(case: Case, effort: Array, velocity: Array, rng: np.random.Generator) -> Truth:
    """Return drawn numbers of an arm with these limits of torque [N·m] and velocity [rad/s]."""
    n = len(effort)
    coulomb = case.dry_per_effort * effort * rng.uniform(1.0 - DEVIATION, 1.0 + DEVIATION, n)
    viscous = arms_study.VISCOUS * effort / velocity * rng.uniform(0.5, 1.5, n)
    lag = arms_study.LAG_S * rng.uniform(1.0 - DEVIATION, 1.0 + DEVIATION, n)
    return Truth(coulomb, STICKY_STRIBECK * coulomb * case.sticky, viscous, lag)


class Engine(Protocol):
    """Physics of an arm with its drives."""

    def links(self) -> Array:
        """Return the true positions of the links, shape (n,) [rad]."""

    def motors(self) -> Array:
        """Return the true positions of the motors, shape (n,) [rad]."""

    def go_on(self, command: Array, steps: int) -> None:
        """Receive a command [N·m], and go on by steps of `STEP_S`."""

    def pick(self, mass: float) -> None:
        """Pick up a load [kg]."""


class IndependentArm:
    """
    An arm of `independent_plant`.

    Parameters
    ----------
    arm : robots.Arm
        Description.
    effort : ndarray, shape (n,)
        Effort limits [N·m].
    truth : Truth
    case : Case
    start : ndarray, shape (n,)
        Position at rest [rad].
    seed : int
        Of bodies and rotors.

    """

    def __init__(self, arm: robots.Arm, effort: Array, truth: Truth, case: Case, start: Array,
                 seed: int) -> None:
        rng = np.random.default_rng((seed, 51))
        believed = arm.bodies()
        least, most = np.log(arms_study.Case().rotor)
        rotor = effort * np.exp(rng.uniform(least, most, arm.n))
        stiffness = damping = np.zeros(arm.n)
        if case.resonance:
            mass, bias = np.zeros((arm.n, arm.n)), np.zeros(arm.n)
            dynamics(believed, start, np.zeros(arm.n), mass, bias)
            stiffness, damping = arms_study.springs(mass, effort, case.resonance)
        self._n = arm.n
        self._physics = ideal(_deviating(believed, rng)).changed(
            coulomb=truth.coulomb, stribeck=truth.stribeck, stribeck_speed=STRIBECK_VELOCITY,
            viscous=truth.viscous, rotor=rotor, lag=truth.lag, saturation=effort,
            rate=arms_study.RATE_PER_EFFORT * effort, stiffness=stiffness, damping=damping)
        self._state = at_rest(self._physics, start, arms_study.DELAY)

    def links(self) -> Array:
        """Return the true positions of the links."""
        return np.array(self._state.x[-self._n:])

    def motors(self) -> Array:
        """Return the true positions of the motors."""
        return np.array(self._state.x[:self._n])

    def go_on(self, command: Array, steps: int) -> None:
        """Receive a command, and go on."""
        advance(self._physics, self._state, command, steps, STEP_S)

    def pick(self, mass: float) -> None:
        """Pick up a load."""
        bodies = self._physics.bodies
        masses, centre = bodies.mass.copy(), bodies.centre.copy()
        masses[-1] += mass
        at = np.array([0.0, 0.0, 0.05])
        centre[-1] = (bodies.mass[-1] * centre[-1] + mass * at) / masses[-1]
        self._physics = self._physics._replace(bodies=bodies._replace(mass=masses, centre=centre))


def _deviating(bodies: Bodies, rng: np.random.Generator) -> Bodies:
    """Return bodies whose masses, centres and inertias are wrong."""
    n, wrong = len(bodies.mass), arms_study.MODEL_ERROR
    mass, centre, inertia = 1.0 + rng.uniform(-wrong, wrong, (3, n))
    return bodies._replace(
        mass=bodies.mass * mass, centre=bodies.centre * centre[:, None],
        inertia=bodies.inertia * (mass * inertia)[:, None, None])


class MujocoArm(arms_study.Arm):
    """
    The arm in MuJoCo of `arms_study`, with drawn friction and drives.

    Parameters
    ----------
    arm, effort, truth, case, start, seed
        As of `IndependentArm`.

    """

    def __init__(self, arm: robots.Arm, effort: Array, truth: Truth, case: Case, start: Array,
                 seed: int) -> None:
        elastic = arms_study.Case(resonance=case.resonance, encoder=case.encoder)
        super().__init__(arm.urdf, arm.joints, effort, np.ones(arm.n), start, elastic, seed)
        self._truth = truth
        self._is_elastic = case.resonance > 0.0
        self._decay = np.exp(-STEP_S / truth.lag)
        self._largest_change = arms_study.RATE_PER_EFFORT * effort * STEP_S
        self.model.dof_damping[self.motor] = truth.viscous
        self.model.dof_frictionloss[self.motor] = truth.coulomb
        weight = np.zeros(arm.n)
        dynamics(arm.bodies(), start, np.zeros(arm.n), np.zeros((arm.n, arm.n)), weight)
        self.start(start, weight)

    def motors(self) -> Array:
        """Return the true positions of the motors."""
        return np.array(self.data.qpos[self.motor])

    def go_on(self, command: Array, steps: int) -> None:
        """Receive a command, and go on."""
        truth = self._truth
        self.waiting.append(np.clip(command, -self.effort, self.effort))
        wanted = self.waiting.pop(0)
        for _ in range(steps):
            change = (1.0 - self._decay) * (wanted - self.torque)
            most = self._largest_change
            self.torque = self.torque + np.minimum(np.maximum(change, -most), most)
            self.data.qfrc_applied[self.motor] = self.torque
            if truth.stribeck.any():
                speed = self.data.qvel[self.motor] / STRIBECK_VELOCITY
                self.model.dof_frictionloss[self.motor] = (
                    truth.coulomb + truth.stribeck * np.exp(-speed * speed))
            mujoco.mj_step(self.model, self.data)

    def pick(self, mass: float = 0.0) -> None:
        """Pick up a load."""
        self.case = self.case._replace(payload=mass)
        super().pick()


ENGINES: dict[str, type[IndependentArm] | type[MujocoArm]] = {
    'independent': IndependentArm, 'mujoco': MujocoArm}


class ForeignRobot:
    """
    An engine with sensors and a network, as the closed loop of the package takes a plant.

    Parameters
    ----------
    engine : Engine
    case : Case
    count : int
        Samples of the run.
    seed : int
        Of lost states and jitter.

    Attributes
    ----------
    off : ndarray of int, shape (count + 1,)
        From the samples to their states [steps of the physics].
    truth : list of ndarray, shape (n,)
        True positions of the links at the instants of all states so far [rad].
    commands : list of ndarray, shape (n,)
        Torques received so far [N·m].
    feedforward : ndarray, shape (n,)
        Torque that is added to the next command [N·m].

    """

    arm = None  # Nothing here can be the package's machine code.
    period_ns = round(1e9 * PERIOD_S)

    def __init__(self, engine: Engine, case: Case, count: int, seed: int) -> None:
        self._engine = engine
        self._measures_motor = case.resonance > 0.0 and case.encoder == 'motor'
        self.last = count - 1
        offsets, losses = (np.random.default_rng((seed, k)) for k in (52, 54))
        self.off = offsets.integers(-1, 2, count + 1) * case.jitter
        self.off[0] = 0
        self._losses = losses.random(count + 1) < case.lost
        self._losses[0] = False
        self._lost_in_a_row = 0
        self._loads: dict[int, float] = {}
        self.k = 0
        self.truth: list[Array] = []
        self.commands: list[Array] = []
        self._before: tuple[int, Array] | None = None
        self._measure()
        self.n = len(self.truth[0])
        self.feedforward = np.zeros(self.n)
        self.applied = [0.0] * self.n

    def _measure(self) -> None:
        """Read the sensors."""
        self.truth.append(self._engine.links())
        shaft = self._engine.motors() if self._measures_motor else self.truth[-1]
        q = quantised(shaft, np.full(len(shaft), arms_study.ENCODER))
        stamp, last = self._before or (self.stamp - self.period_ns, q)
        dq = 1e9 * (q - last) / (self.stamp - stamp)
        self._before = self.stamp, q
        self.measured = q, dq

    @property
    def q(self) -> list[float]:
        """Return the true positions of the links [rad]."""
        return list(self.truth[-1].tolist())

    @property
    def dq(self) -> list[float]:
        """Return the velocities as they are measured [rad/s]."""
        return list(self.measured[1].tolist())

    @property
    def stamp(self) -> int:
        """Return the time of the present state [ns]."""
        return self.k * self.period_ns + round(1e9 * self.offset)

    @property
    def offset(self) -> float:
        """Return the time from the sample to its state [s]."""
        return float(STEP_S * self.off[self.k])

    @property
    def lost(self) -> bool:
        """Return whether the present state does not arrive."""
        return self._lost_in_a_row > 0

    def configure(self, config: Any) -> None:
        """Take no change: an engine has no parameters of the package."""
        raise NotImplementedError

    def pick_at(self, k: int, mass: float) -> None:
        """Have a load [kg] picked up at a sample."""
        self._loads[k] = mass

    def step(self, tau: Any) -> None:
        """Receive a torque [N·m], and go on to the next state."""
        if self.k in self._loads:
            self._engine.pick(self._loads[self.k])
        command = np.array(tau, float) + self.feedforward
        self.commands.append(command)
        steps = STEPS + int(self.off[self.k + 1] - self.off[self.k])
        self._engine.go_on(command, steps)
        self.applied = command.tolist()
        self.k += 1
        lost = self._losses[self.k] and self._lost_in_a_row < MAX_LOST
        self._lost_in_a_row = self._lost_in_a_row + 1 if lost else 0
        self._measure()
