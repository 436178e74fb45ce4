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

"""The faults of real arms by name, each drawn by a seed, and a recording with its truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import dataclasses
from typing import Any

from ctc_chattering.identification.recording import Recording
from ctc_chattering.trajectory.waypoints import Route
from faulty_robots import (
    Case,
    Faulty,
    lab_gains,
    Made,
    plain,
    Played,
    played,
    recording_of,
    Rng,
)
import numpy as np
from rigid_bodies import Array, dynamics
from robots import arm, motion
from scipy.signal import lfilter  # type: ignore[import-untyped]


def case(name: str, fault: str, seed: int, duration: float = 25.0) -> Case:
    """Return a robot with a fault of `FAULTS`."""
    rng = np.random.default_rng((seed, 4))
    robot = plain(name, seed)
    found = FAULTS[fault](robot, rng, duration)
    return found if isinstance(found, Case) else Case(
        found, ('none', 'motor')[int(rng.integers(2))])


def recorded(one: Case, seed: int, duration: float = 25.0, route: Route | None = None
             ) -> tuple[Played, Recording]:
    """Return what a case does in the motion of its arm, or another, and the recording of it."""
    usual = motion(arm(one.robot.name), duration, seed)
    seen = played(one.robot, route or (one.slower(usual) if one.slower else usual), seed)
    recording = recording_of(one.robot, seen, one.effort)
    return seen, one.alter(recording) if one.alter else recording


def sizes(robot: Faulty) -> Array:
    """Return a torque of each joint that tells strong from weak ones [N·m]."""
    return np.asarray(robot.physics.coulomb.mean() * 0.5 + robot.physics.coulomb * 0.5, float)


def _link_torque(robot: Faulty, rng: Rng, duration: float) -> Case:
    return Case(_rotor(robot, rng, duration), 'link')


def _stamps_back(robot: Faulty, rng: Rng, duration: float) -> Case:
    at, back = rng.uniform(0.3, 0.7) * duration, 0.35 + 1e-3 * rng.random()

    def alter(x: Recording) -> Recording:
        return dataclasses.replace(x, t=np.where(x.t > at, x.t - back, x.t))
    return Case(robot, 'none', alter)


def _load_light(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    load = np.zeros(robot.n)
    load[0 if robot.name in ('panda', 'ur5') else -1] = rng.uniform(0.05, 0.15)
    load[-1] = rng.uniform(0.05, 0.15)
    return robot.with_physics(load=load)


def _scale_one(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    scale = np.ones(robot.n)
    scale[rng.integers(robot.n)] = 0.95
    return robot.with_physics(scale=scale)


def _rotor(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    return robot.with_physics(rotor=rng.uniform(0.02, 0.08, robot.n) * sizes(robot))


def _tilt(robot: Faulty, rng: Rng, _duration: float, degrees: float = 5.0) -> Faulty:
    way, angle = rng.uniform(0.0, 2.0 * np.pi), np.radians(degrees)
    gravity = 9.81 * np.array([np.sin(angle) * np.cos(way), np.sin(angle) * np.sin(way),
                               -np.cos(angle)])
    return robot.with_bodies(gravity=gravity)


def _centres(robot: Faulty, rng: Rng, _duration: float, size: float = 0.015) -> Faulty:
    shift = rng.normal(size=(robot.n, 3))
    shift *= size / np.linalg.norm(shift, axis=1)[:, None]
    return robot.with_bodies(centre=robot.physics.bodies.centre + shift)


def _heavier(robot: Faulty, body: int, mass: float, place: Array) -> Faulty:
    """Return a robot with a point mass at a place in the frame of a joint."""
    one = robot.physics.bodies
    masses, centres, inertias = one.mass.copy(), one.centre.copy(), one.inertia.copy()
    masses[body] += mass
    centres[body] = (one.mass[body] * one.centre[body] + mass * place) / masses[body]
    for m, away in ((one.mass[body], one.centre[body] - centres[body]),
                    (mass, place - centres[body])):
        inertias[body] = inertias[body] + m * (away @ away * np.eye(3) - np.outer(away, away))
    return robot.with_bodies(mass=masses, centre=centres, inertia=inertias)


def _forearm(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    body = {'panda': 3, 'ur5': 2}.get(robot.name, robot.n - 1)
    return _heavier(robot, body, 1.0, robot.physics.bodies.centre[body]
                    + rng.uniform(-0.05, 0.05, 3))


def _payload(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    place = robot.physics.bodies.centre[-1] * rng.uniform(1.0, 2.0)
    return _heavier(robot, robot.n - 1, rng.uniform(0.5, 2.0), place)


def _springs(robot: Faulty, rng: Rng, gap: float, stiffness: float) -> Faulty:
    rotor = rng.uniform(0.02, 0.08, robot.n) * sizes(robot)
    stiff = stiffness * rng.uniform(0.7, 1.5, robot.n) * sizes(robot)
    robot = robot.with_physics(
        rotor=rotor, stiffness=stiff, damping=2e-4 * stiff, gap=gap)
    # The loop acts on a rotor with gains for the whole inertia; more than this diverges.
    mass, bias = np.empty((robot.n, robot.n)), np.empty(robot.n)
    dynamics(robot.nominal, np.array(arm(robot.name).centre), np.zeros(robot.n), mass, bias)
    most = 0.6 * float((rotor / np.abs(mass).sum(axis=1)).min()) / robot.period
    return dataclasses.replace(
        robot, caution=min(0.4, most / lab_gains(robot)[1]), ahead=0.8)


def _delay_lag(robot: Faulty, rng: Rng, _duration: float) -> Case:
    robot = robot.with_physics(lag=rng.uniform(0.3e-3, 3e-3, robot.n))
    return Case(dataclasses.replace(robot, delay=int(rng.integers(3))), bag=True)


def _rate(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    """Return drives that are too slow for the noise of the commands, but not for the motion."""
    seen = played(robot, motion(arm(robot.name), 6.0, 0), 0)
    fast = np.percentile(np.abs(np.diff(seen.command, axis=0)), 99.0, axis=0) / robot.period
    return robot.with_physics(rate=rng.uniform(0.6, 1.0, robot.n) * fast)


def _ripple(robot: Faulty, rng: Rng, _duration: float) -> Faulty:
    return robot.with_physics(
        ripple=rng.uniform(0.1, 0.25, robot.n), waves=rng.uniform(4.0, 60.0, robot.n),
        phase=rng.uniform(0.0, 2.0 * np.pi, robot.n),
        cogging=rng.uniform(0.03, 0.08, robot.n) * robot.physics.coulomb)


def _wrong_order(robot: Faulty, rng: Rng, _duration: float) -> Case:
    order = np.arange(robot.n)
    i = int(rng.integers(robot.n - 1))
    order[[i, i + 1]] = order[[i + 1, i]]

    def alter(x: Recording) -> Recording:
        assert x.command is not None
        return dataclasses.replace(x, command=x.command[:, order])
    return Case(robot, 'none', alter)


def _currents(robot: Faulty, rng: Rng, _duration: float) -> Case:
    per_ampere = rng.uniform(50.0, 150.0, robot.n) * rng.uniform(0.03, 0.1, robot.n)
    alone = bool(rng.integers(2))

    def alter(x: Recording) -> Recording:
        assert x.effort is not None
        return dataclasses.replace(
            x, effort=x.effort / per_ampere, command=None if alone else x.command)
    return Case(robot, 'motor', alter)


def _encoders(robot: Faulty, _rng: Rng, _duration: float) -> Faulty:
    one = np.ones(robot.n)
    return dataclasses.replace(robot, encoder=1e-4 * one, position_noise=5e-5 * one,
                               velocity_noise=1e-2 * one)


def _everything(robot: Faulty, rng: Rng, duration: float) -> Case:
    robot = _rotor(robot, rng, duration)
    robot = _centres(_tilt(robot, rng, duration, 0.5), rng, duration, 0.003)
    robot = robot.with_bodies(mass=robot.physics.bodies.mass * rng.uniform(0.97, 1.03, robot.n))
    coulomb = robot.physics.coulomb
    robot = robot.with_physics(
        scale=rng.uniform(0.97, 1.03, robot.n), load=rng.uniform(0.0, 0.03, robot.n),
        stribeck=rng.uniform(0.0, 0.2, robot.n) * coulomb, stribeck_speed=0.05,
        offset=rng.uniform(-0.05, 0.05, robot.n) * coulomb, ripple=0.04,
        waves=rng.uniform(4.0, 60.0, robot.n), cogging=0.02 * coulomb, drift=0.05,
        drift_time=0.6 * duration, lag=rng.uniform(0.3e-3, 1.5e-3, robot.n))
    noise = np.full(robot.n, 1e-5)
    return Case(dataclasses.replace(robot, delay=1, encoder=2.0 * noise, position_noise=noise),
                'motor')


def _usual(robot: Faulty) -> Array:
    """Return torques of the healthy robot in 6 s of its usual motion, shape (N, n) [N·m]."""
    return played(robot, motion(arm(robot.name), 6.0, 0), 0).command


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


#: What may be wrong besides, for which `ctc identify` was not built, by name.
OTHER_FAULTS: Mapping[str, Made] = {
    # Friction differs by 40 % with the direction.
    'asymmetric': lambda robot, rng, _duration: robot.with_physics(
        offset=0.2 * rng.choice((-1.0, 1.0), robot.n) * robot.physics.coulomb),
    'quadratic': lambda robot, rng, _duration: robot.with_physics(
        quadratic=rng.uniform(0.2, 0.5, robot.n) * robot.physics.coulomb,
        band=rng.uniform(0.05, 0.3, robot.n)),
    'end_stop': _end_stop, 'balance': _balance,
    # Cables pull linearly with the angle.
    'cable': lambda robot, rng, _duration: robot.with_physics(
        cogging=rng.uniform(0.2, 0.6, robot.n) * robot.physics.coulomb / 0.05, waves=0.05),
    'eccentric': _eccentric, 'torque_ripple': _torque_ripple, 'saturated': _saturated,
    'lost_second': _lost_second,
    'half_rate': lambda robot, _rng, _duration: dataclasses.replace(robot, period=2e-3),
    'no_velocities': lambda robot, _rng, _duration: Case(
        robot, 'none', lambda x: dataclasses.replace(x, dq=None)),
    'two_degrees': _two_degrees,
    # A tenth of the amplitude, so ten times as slow.
    'slow_motion': lambda robot, _rng, _duration: Case(
        robot, slower=_scaled(robot, np.full(robot.n, 0.1))),
    'coarse_stamps': _coarse_stamps, 'filtered': _filtered,
    # A robot that is given for another one with the same joints.
    'wrong_robot': lambda robot, _rng, _duration: Case(
        robot, believed={'ur5': 'ur10', 'ur10': 'ur5'}.get(robot.name, '')),
    # Friction grows with the load in one direction only, as in worm gears.
    'directed_load': lambda robot, rng, _duration: robot.with_physics(
        load=rng.uniform(0.03, 0.08, robot.n), load_bias=rng.choice((-1.0, 1.0), robot.n)),
    'zero_off': _zero_off, 'clipped_late': _clipped_late, 'slow_velocities': _slow_velocities,
    # Friction rises below speeds at which the usual motion hardly is.
    'creeping': lambda robot, rng, _duration: robot.with_physics(
        stribeck=rng.uniform(0.3, 0.9, robot.n) * robot.physics.coulomb,
        stribeck_speed=rng.uniform(4e-3, 0.02, robot.n)),
    'velocity_degrees': _velocity_times(180.0 / np.pi),
    'velocity_sign': _velocity_times(-1.0, True), 'velocity_scale': _velocity_times(1.25, True),
    'joint_delay': _joint_delay, 'dead_band': _dead_band, 'fading_torque': _fading_torque,
    'real_arm': _real_arm}
#: What may be wrong, by name.
FAULTS: Mapping[str, Made] = {
    'plain': lambda robot, _rng, _duration: robot,
    'link_torque': _link_torque, 'stamps_back': _stamps_back, 'load_light': _load_light,
    'scale_one': _scale_one,
    'scale_all': lambda robot, _rng, _duration: robot.with_physics(scale=0.95),
    'rotor': _rotor, 'tilt': _tilt, 'centres': _centres, 'forearm': _forearm,
    'payload': _payload,
    'backlash': lambda robot, rng, _duration: _springs(robot, rng, 2e-3, 10_000.0),
    'elastic': lambda robot, rng, _duration: _springs(robot, rng, 0.0, 2_000.0),
    'delay_lag': _delay_lag,
    'slow_loop': lambda robot, _rng, _duration: Case(dataclasses.replace(
        robot.with_physics(lag=3.8e-3), delay=1, period=4e-3), bag=True),
    'rate': _rate,
    'stribeck': lambda robot, rng, _duration: robot.with_physics(
        stribeck=rng.uniform(0.2, 0.6, robot.n) * robot.physics.coulomb,
        stribeck_speed=rng.uniform(0.02, 0.1, robot.n)),
    'load': lambda robot, rng, _duration: robot.with_physics(
        load=rng.uniform(0.03, 0.12, robot.n)),
    'offset': lambda robot, rng, _duration: robot.with_physics(
        offset=rng.uniform(-0.2, 0.2, robot.n) * robot.physics.coulomb),
    'ripple': _ripple,
    'drift': lambda robot, rng, duration: robot.with_physics(
        drift=rng.uniform(0.2, 0.4, robot.n), drift_time=0.6 * duration),
    'wrong_order': _wrong_order,
    'gravity_inside': lambda robot, _rng, _duration: robot.with_physics(helped=1.0),
    'currents': _currents, 'encoders': _encoders, 'everything': _everything, **OTHER_FAULTS}


def _viscous(one: Case) -> Array:
    """Return viscous friction, at least and at most, with what is quadratic up to 2 rad/s."""
    x = one.robot.physics
    return np.stack((x.viscous, x.viscous + 4.0 * x.quadratic))


def truths(one: Case, duration: float) -> dict[str, Any]:
    """
    Return the true numbers of each joint by name, as lowest and highest over the run.

    Torques are in units of the signal: without a known payload nothing tells a torque constant
    from masses, and a law that commands the signal needs friction in its unit.
    """
    x = one.robot.physics
    warm = 1.0 + np.outer((1.0, np.exp(-duration / x.drift_time.max())), x.drift)
    found = {'coulomb': warm * x.coulomb, 'forwards': warm * (x.coulomb + x.offset),
             'backwards': warm * (x.coulomb - x.offset),
             'viscous': _viscous(one), 'stribeck': x.stribeck,
             'load': np.outer((1.0, -1.0), x.load * x.load_bias) + x.load,
             'stribeck_velocity': x.stribeck_speed, 'scale': x.scale, 'rotor': x.rotor,
             'rate': x.rate, 'lag': x.lag + one.robot.period * one.own_delay,
             'band': np.asarray(one.band), 'noise': np.asarray(one.robot.velocity_noise)}
    for name in ('coulomb', 'forwards', 'backwards', 'viscous', 'stribeck', 'rotor', 'rate'):
        found[name] = found[name] / x.scale
    return {name: np.sort(np.broadcast_to(value, (2, one.robot.n)), axis=0)
            for name, value in found.items()} | {'delay': one.robot.delay}
