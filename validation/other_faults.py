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

"""Faults that `ctc identify` was not built for, drawn by a seed."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses

from ctc_chattering.bags.recording import Recording
from ctc_chattering.trajectory.motions import Route
from faulty_case import Case, Made, Rng
from faulty_robots import Faulty, played
from identified_robots import arm, motion
import numpy as np
from rigid_bodies import Array
from scipy.signal import lfilter  # type: ignore[import-untyped]


def _usual(robot: Faulty) -> Array:
    """Return torques of the healthy robot in 6 s of its usual motion, shape (N, n) [N·m]."""
    return played(robot, motion(arm(robot.name), 6.0, 0), 0).command


def _asymmetric(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return friction that differs by 40 % with the direction."""
    return robot.with_physics(
        offset=0.2 * rng.choice((-1.0, 1.0), robot.n) * robot.physics.coulomb)


def _quadratic(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    return robot.with_physics(quadratic=rng.uniform(0.2, 0.5, robot.n) * robot.physics.coulomb,
                              band=rng.uniform(0.05, 0.3, robot.n))


def _end_stop(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    stop = np.full(robot.n, np.inf)
    i = int(rng.integers(robot.n))
    stop[i] = arm(robot.name).centre[i] + 0.6 * arm(robot.name).amplitude[i]
    return robot.with_physics(stop=stop)


def _balance(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return a spring on joint 2 that carries a part of the weight."""
    size = np.zeros(robot.n)
    size[1] = rng.uniform(0.3, 0.8) * np.abs(_usual(robot)[:, 1]).max()
    return robot.with_physics(cogging=size, waves=1.0)


def _cable(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return cables that pull linearly with the angle."""
    stiffness = rng.uniform(0.2, 0.6, robot.n) * robot.physics.coulomb
    return robot.with_physics(cogging=stiffness / 0.05, waves=0.05)


def _eccentric(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return encoders with an error once in a turn."""
    size, phase = rng.uniform(1e-3, 5e-3, robot.n), rng.uniform(0.0, 6.28, robot.n)
    return Case(robot, 'none', lambda x: dataclasses.replace(
        x, q=x.q + size * np.sin(x.q + phase)))


def _torque_ripple(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return drives whose torque per command varies with the angle."""
    size, waves = rng.uniform(0.03, 0.08, robot.n), rng.uniform(4.0, 60.0, robot.n)

    def alter(x: Recording) -> Recording:
        assert x.command is not None
        return dataclasses.replace(x, command=x.command / (1.0 + size * np.sin(waves * x.q)))
    return Case(robot, 'none', alter)


def _saturated(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return drives that silently do less than is commanded at the largest torques."""
    most = np.abs(_usual(robot)).max(axis=0)
    return Case(robot.with_physics(saturation=np.maximum(
        rng.uniform(0.85, 0.95, robot.n) * most, 1.2 * robot.physics.coulomb)))


def _lost_second(robot: Faulty, rng: Rng, duration: float) -> Case:
    at = rng.uniform(0.2, 0.8) * duration

    def alter(x: Recording) -> Recording:
        kept = (x.t < at) | (x.t > at + 1.0)
        assert x.dq is not None and x.command is not None
        return dataclasses.replace(x, t=x.t[kept], q=x.q[kept], dq=x.dq[kept],
                                   command=x.command[kept])
    return Case(robot, 'none', alter)


def _half_rate(robot: Faulty, _rng: Rng, _duration: float) -> Faulty:
    return dataclasses.replace(robot, period=2e-3)


def _no_velocities(robot: Faulty, _rng: Rng, _duration: float) -> Case:
    return Case(robot, 'none', lambda x: dataclasses.replace(x, dq=None))


def _scaled(robot: Faulty, parts: Array) -> Callable[[Route], Route]:
    """Return what makes a motion smaller, joint by joint."""
    centre = np.array(arm(robot.name).centre)

    def slower(route: Route) -> Route:
        q, dq, ddq = np.array(route.points).transpose(1, 0, 2)
        points = list(zip(*(tuple(map(tuple, x.tolist())) for x in (
            centre + parts * (q - centre), parts * dq, parts * ddq))))
        return Route(route.names, route.times, points)
    return slower


def _two_degrees(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return a motion in which one joint moves by 2 degrees only."""
    parts = np.ones(robot.n)
    i = int(rng.integers(robot.n))
    parts[i] = np.radians(1.0) / arm(robot.name).amplitude[i]
    return Case(robot, slower=_scaled(robot, parts))


def _slow_motion(robot: Faulty, _rng: Rng, _duration: float) -> Case:
    """Return a motion of a tenth of the amplitude, so ten times as slow."""
    return Case(robot, slower=_scaled(robot, np.full(robot.n, 0.1)))


def _coarse_stamps(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return stamps of whole milliseconds of a clock that reads a little late."""
    def alter(x: Recording) -> Recording:
        return dataclasses.replace(
            x, t=np.floor((x.t + 4e-4 * rng.random(len(x.t)) + 2e-4) * 1e3) * 1e-3)
    return Case(robot, 'none', alter)


def _filtered(robot: Faulty, _rng: Rng, _duration: float) -> Case:
    """Return an effort that goes through a low-pass of 20 Hz."""
    part = 1.0 - np.exp(-2.0 * np.pi * 20.0 * robot.period)

    def alter(x: Recording) -> Recording:
        assert x.effort is not None
        first = (1.0 - part) * x.effort[:1]
        return dataclasses.replace(x, command=None, effort=lfilter(
            [part], [1.0, part - 1.0], x.effort, axis=0, zi=first)[0])
    return Case(robot, 'motor', alter)


def _wrong_robot(robot: Faulty, _rng: Rng, _duration: float) -> Case:
    """Return a robot that is given for another one with the same joints."""
    return Case(robot, believed={'ur5': 'ur10', 'ur10': 'ur5'}.get(robot.name, ''))


def _directed_load(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return gears whose friction grows with the load in one direction only, as worm gears."""
    return robot.with_physics(load=rng.uniform(0.03, 0.08, robot.n),
                              load_bias=rng.choice((-1.0, 1.0), robot.n))


def _zero_off(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return a robot of which one joint's zero is off by 3 degrees."""
    shift = np.zeros(robot.n)
    shift[rng.integers(robot.n)] = np.radians(3.0) * rng.choice((-1.0, 1.0))
    return Case(robot, 'none', lambda x: dataclasses.replace(x, q=x.q + shift))


def _clipped_late(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return an effort that is 3 samples late and clipped, without commands."""
    part = rng.uniform(0.6, 0.85)

    def alter(x: Recording) -> Recording:
        assert x.effort is not None
        most = part * np.abs(x.effort).max(axis=0)
        late = np.concatenate((x.effort[:1].repeat(3, axis=0), x.effort[:-3]))
        return dataclasses.replace(x, command=None, effort=np.clip(late, -most, most))
    return Case(robot, 'motor', alter)


def _slow_velocities(robot: Faulty, _rng: Rng, _duration: float) -> Case:
    """Return velocities that go through a low-pass of 5 Hz, which positions do not."""
    part = 1.0 - np.exp(-2.0 * np.pi * 5.0 * robot.period)
    return Case(robot, 'none', lambda x: dataclasses.replace(
        x, dq=lfilter([part], [1.0, part - 1.0], x.dq, axis=0)))


def _creeping(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return friction that rises below speeds at which the usual motion hardly is."""
    return robot.with_physics(stribeck=rng.uniform(0.3, 0.9, robot.n) * robot.physics.coulomb,
                              stribeck_speed=rng.uniform(4e-3, 0.02, robot.n))


def _velocity_times(factor: float, one: bool = False) -> Made:
    """Return velocities in another unit, or with the other sign; of one joint or of all."""
    def fault(robot: Faulty, rng: Rng, _duration: float) -> Case:
        size = np.full(robot.n, factor)
        if one:
            size = np.where(np.arange(robot.n) == rng.integers(robot.n), factor, 1.0)

        def alter(x: Recording) -> Recording:
            assert x.dq is not None
            return dataclasses.replace(x, dq=x.dq * size)
        return Case(robot, 'none', alter)
    return fault


def _joint_delay(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return commands of which one joint's act some samples later than the others'."""
    i, late = int(rng.integers(robot.n)), int(rng.integers(2, 6))

    def alter(x: Recording) -> Recording:
        assert x.command is not None
        command = x.command.copy()
        command[:-late, i] = x.command[late:, i]
        return dataclasses.replace(x, command=command)
    return Case(robot, 'none', alter, own_delay=np.eye(robot.n)[i] * late)


def _dead_band(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return drives that do nothing for small commands, and less for larger ones."""
    band = rng.uniform(0.08, 0.15, robot.n) * robot.physics.coulomb

    def alter(x: Recording) -> Recording:
        assert x.command is not None
        return dataclasses.replace(x, command=x.command + band * np.sign(x.command))
    return Case(robot, 'none', alter, band=band)


def _fading_torque(robot: Faulty, rng: Rng, _duration: float) -> Case:
    """Return motors whose torque per command falls with the torque, as iron saturates."""
    most = np.abs(_usual(robot)).max(axis=0)
    part = rng.uniform(0.1, 0.25, robot.n)

    def alter(x: Recording) -> Recording:
        assert x.command is not None
        # Torque c (1 - a |c|) of a command c; the command for a torque is what is recorded.
        a = part / most
        size = np.minimum(np.abs(x.command), 0.24 / a)
        return dataclasses.replace(x, command=np.sign(x.command) * (
            1.0 - np.sqrt(1.0 - 4.0 * a * size)) / (2.0 * a))
    return Case(robot, 'none', alter)


def _real_arm(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return rotors, a tool, and a last joint that friction holds, at once."""
    sizes = robot.physics.coulomb.mean() * 0.5 + robot.physics.coulomb * 0.5
    coulomb, bodies = robot.physics.coulomb.copy(), robot.physics.bodies
    coulomb[-1] *= 300.0
    mass = bodies.mass.copy()
    mass[-2] += rng.uniform(0.3, 0.8)
    return robot.with_physics(rotor=rng.uniform(0.02, 0.08, robot.n) * sizes,
                              coulomb=coulomb).with_bodies(mass=mass)


#: What may be wrong besides, by name.
OTHER_FAULTS: Mapping[str, Made] = {
    'asymmetric': _asymmetric, 'quadratic': _quadratic, 'end_stop': _end_stop,
    'balance': _balance, 'cable': _cable, 'eccentric': _eccentric,
    'torque_ripple': _torque_ripple, 'saturated': _saturated, 'lost_second': _lost_second,
    'half_rate': _half_rate, 'no_velocities': _no_velocities, 'two_degrees': _two_degrees,
    'slow_motion': _slow_motion, 'coarse_stamps': _coarse_stamps, 'filtered': _filtered,
    'wrong_robot': _wrong_robot, 'directed_load': _directed_load, 'zero_off': _zero_off,
    'clipped_late': _clipped_late, 'slow_velocities': _slow_velocities,
    'creeping': _creeping, 'velocity_degrees': _velocity_times(180.0 / np.pi),
    'velocity_sign': _velocity_times(-1.0, True), 'velocity_scale': _velocity_times(1.25, True),
    'joint_delay': _joint_delay, 'dead_band': _dead_band, 'fading_torque': _fading_torque,
    'real_arm': _real_arm}
