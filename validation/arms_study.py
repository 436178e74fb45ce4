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
Arms as they are: rotors, friction loss, elastic joints and payloads in MuJoCo.

A law runs with the parameter file that `ctc new-robot` writes for a URDF. MuJoCo plays the arm:
its masses, centres and inertias differ from the URDF by up to 10 %, it has rotors that the law is
not told, dry friction, drives with a lag, a limited rate and a delay of one sample, encoders, and,
as a case, elastic joints with the encoder on either side, or a payload that is picked up.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import json
from pathlib import Path
import re
import tempfile
from typing import Any, NamedTuple
import xml.etree.ElementTree as ET

from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.arm_knowledge import ArmFacts
from ctc_chattering.configuration.compilation import compile_setups
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.configuration.new_robot import new_robot
from ctc_chattering.control.controller import Controller
from ctc_chattering.controller import trips
from ctc_chattering.dynamics.registry import model_of
from ctc_chattering.dynamics.urdf_model import UrdfModel
from ctc_chattering.runs.recommended import recommended_setup
from ctc_chattering.trajectory.reference import make_motion
import mujoco
import numpy as np
from rigid_bodies import Array
from robots import DESCRIBED
import scipy.linalg  # type: ignore[import-untyped]
import urdfs

#: Step of MuJoCo [s].
STEP_S = 2.5e-4
#: Steps of a control period of 1 ms.
STEPS = 4
#: Lag of the drives [s].
LAG_S = 1.5e-3
#: Delay of the torque [samples].
DELAY = 1
#: Step of the encoders [rad].
ENCODER = 1e-5
#: Rate limit of a drive per effort limit [1/s].
RATE_PER_EFFORT = 20.0
#: Dry friction per effort limit.
DRY = 0.04
#: Viscous friction at the largest velocity, per effort limit.
VISCOUS = 0.02
#: Deviation of masses, centres and inertias.
MODEL_ERROR = 0.1
#: Duration of a run [s].
DURATION_S = 10.0
#: Begin of the judged part [s].
JUDGED_FROM_S = 2.5
#: Time at which a payload is picked up [s].
PICKED_S = 5.0
#: Damping ratio of an elastic joint.
DAMPING_RATIO = 0.02
#: Fastest resonance of a joint alone [Hz].
FASTEST_HZ = 250.0


class Case(NamedTuple):
    """
    An arm as it is.

    Attributes
    ----------
    rotor : (float, float)
        Least and largest inertia of a rotor per effort limit [kg·m² per N·m].
    resonance : float
        The lowest one with all motors held [Hz]; 0 for rigid joints.
    encoder : str
        Side of an elastic joint that is measured: motor or link.
    payload : float
        Picked up in motion [kg].

    """

    rotor: tuple[float, float] = (0.001, 0.006)
    resonance: float = 0.0
    encoder: str = 'motor'
    payload: float = 0.0


class Outcome(NamedTuple):
    """Result of a run, with the largest values of all joints."""

    rms: float
    variation: float
    rate: float
    trip: str
    trip_time: float


class Arm:
    """
    An arm in MuJoCo.

    Parameters
    ----------
    urdf : str
        Text of the description.
    joints : sequence of str
        Those that move; others are fixed.
    effort : ndarray, shape (n,)
        Effort limits [N·m].
    velocity : ndarray, shape (n,)
        Velocity limits [rad/s].
    posture : ndarray, shape (n,)
        Middle of the motion [rad].
    case : Case
        What it is like.
    seed : int
        Of what is drawn.

    """

    def __init__(self, urdf: str, joints: Sequence[str], effort: Array, velocity: Array,
                 posture: Array, case: Case, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.effort, self.case, n = effort, case, len(joints)
        least, most = np.log(case.rotor)
        self.rotor = effort * np.exp(rng.uniform(least, most, n))
        spec = mujoco.MjSpec.from_string(without_shapes(urdf))
        for equality in list(spec.equalities):
            spec.delete(equality)
        for joint in list(spec.joints):
            if joint.name not in joints:
                spec.delete(joint)
        self._draw_bodies(spec, rng)
        tip = spec.joint(joints[-1]).parent
        self.load = tip.add_body(name='load', pos=(0.0, 0.0, 0.05))
        self.load.mass, self.load.inertia = 1e-6, (1e-9, 1e-9, 1e-9)
        self.load.explicitinertial = True
        spec.option.timestep = STEP_S
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        driven = list(joints)
        if case.resonance:
            driven = [f'motor {name}' for name in joints]
            self._add_springs(spec, joints, driven, posture)
        self.model = spec.compile()
        self.model.jnt_limited[:] = 0
        self.model.dof_damping[:] = self.model.dof_frictionloss[:] = 0.0
        self.data = mujoco.MjData(self.model)
        self.link, self.motor = (
            np.array([self.model.joint(name).dofadr[0] for name in names])
            for names in (joints, driven))
        self.model.dof_frictionloss[self.motor] = DRY * effort
        self.model.dof_damping[self.motor] = VISCOUS * effort / velocity
        if not case.resonance:
            self.model.dof_armature[self.motor] = self.rotor
        self.model.dof_solref[:] = (0.0, -0.5 / STEP_S)
        self.model.dof_solimp[:] = (0.999, 0.999, 1e-3, 0.5, 2.0)
        mujoco.mj_setConst(self.model, self.data)
        self.torque = np.zeros(n)
        self.waiting = [np.zeros(n)] * DELAY

    @staticmethod
    def _draw_bodies(spec: Any, rng: np.random.Generator) -> None:
        for body in spec.bodies:
            if body.mass > 0.0:
                mass, *moments = 1.0 + rng.uniform(-MODEL_ERROR, MODEL_ERROR, 4)
                body.mass *= mass
                body.ipos = np.array(body.ipos) * (1.0 + rng.uniform(-MODEL_ERROR, MODEL_ERROR))
                # One factor: principal moments keep what bodies can have.
                body.inertia = np.array(body.inertia) * mass * moments[0]

    def _add_springs(self, spec: Any, joints: Sequence[str], motors: Sequence[str],
                     posture: Array) -> None:
        """Put a motor with its rotor and a spring before each joint."""
        rigid = spec.copy().compile()
        data = mujoco.MjData(rigid)
        of_joint = [rigid.joint(name).dofadr[0] for name in joints]
        data.qpos[of_joint] = posture
        mujoco.mj_forward(rigid, data)
        mass = mass_matrix(rigid, data)[np.ix_(of_joint, of_joint)]
        stiffness, damping = springs(mass, self.effort, self.case.resonance)
        for k, (name, motor, rotor) in enumerate(zip(joints, motors, self.rotor)):
            body = spec.worldbody.add_body(name=motor)
            body.mass, body.inertia, body.explicitinertial = 1.0, (rotor, rotor, rotor), True
            body.add_joint(name=motor, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0.0, 0.0, 1.0))
            spring = spec.add_tendon(
                name=f'spring {name}', stiffness=stiffness[k], damping=damping[k])
            spring.wrap_joint(name, 1.0)
            spring.wrap_joint(motor, -1.0)

    def start(self, q: Array, torque: Array) -> None:
        """Begin at rest at a position, with drives that hold it."""
        self.data.qpos[self.link] = self.data.qpos[self.motor] = q
        mujoco.mj_forward(self.model, self.data)
        self.torque = torque.copy()
        self.waiting = [torque.copy() for _ in range(DELAY)]

    def positions(self) -> Array:
        """Return the measured positions, shape (n,) [rad]."""
        of = self.motor if self.case.encoder == 'motor' else self.link
        return np.asarray(ENCODER * np.round(self.data.qpos[of] / ENCODER))

    def links(self) -> Array:
        """Return the true positions of the links, shape (n,) [rad]."""
        return np.array(self.data.qpos[self.link])

    def pick(self) -> None:
        """Pick up the payload."""
        body = self.model.body('load').id
        self.model.body_mass[body] = self.case.payload
        self.model.body_inertia[body] = 0.4 * self.case.payload * 0.05 ** 2
        mujoco.mj_setConst(self.model, mujoco.MjData(self.model))

    def step(self, command: Array) -> None:
        """Move on by a control period under a command [N·m]."""
        self.waiting.append(np.clip(command, -self.effort, self.effort))
        wanted = self.waiting.pop(0)
        decay = np.exp(-STEP_S / LAG_S)
        most = RATE_PER_EFFORT * self.effort * STEP_S
        for _ in range(STEPS):
            change = (1.0 - decay) * (wanted - self.torque)
            self.torque = self.torque + np.clip(change, -most, most)
            self.data.qfrc_applied[self.motor] = self.torque
            mujoco.mj_step(self.model, self.data)


def springs(mass: Array, effort: Array, resonance: float) -> tuple[Array, Array]:
    """
    Return stiffness [N·m/rad] and damping [N·m·s/rad] of the joints, each of shape (n,).

    Stiffness is in proportion to the effort limits, so that the lowest resonance is as asked for
    while all motors are held, but no joint alone is faster than MuJoCo's step resolves.

    Parameters
    ----------
    mass : array, shape (n, n)
        M in the middle of the motion [kg·m²].
    effort : array, shape (n,)
        Effort limits [N·m].
    resonance : float
        The lowest one [Hz].

    """
    squares = scipy.linalg.eigh(np.diag(effort), mass, eigvals_only=True)
    alone = 1.0 / np.diagonal(np.linalg.inv(mass))
    stiffness = np.minimum((2.0 * np.pi * resonance) ** 2 / squares[0] * effort,
                           alone * (2.0 * np.pi * FASTEST_HZ) ** 2)
    return stiffness, 2.0 * DAMPING_RATIO * np.sqrt(stiffness * alone)


def mass_matrix(model: Any, data: Any) -> Array:
    """Return M at the state of MuJoCo's data, shape (nv, nv) [kg·m²]."""
    columns = []
    for unit in np.eye(model.nv):
        column = np.zeros(model.nv)
        mujoco.mj_mulM(model, data, column, unit)
        columns.append(column)
    return np.stack(columns, axis=1)


def without_shapes(urdf: str) -> str:
    """Return a URDF without shapes, whose meshes are not there."""
    robot = ET.fromstring(urdf)
    for link in robot.iter('link'):
        for tag in ('visual', 'collision'):
            for shape in link.findall(tag):
                link.remove(shape)
    for tag in ('transmission', 'gazebo', 'mujoco'):
        for element in robot.findall(tag):
            robot.remove(element)
    options = ET.SubElement(ET.SubElement(robot, 'mujoco'), 'compiler')
    for name, value in (('fusestatic', 'false'), ('balanceinertia', 'true'),
                        ('boundmass', '1e-6'), ('boundinertia', '1e-9'),
                        ('discardvisual', 'true')):
        options.set(name, value)
    return ET.tostring(robot, encoding='unicode')


def setups(urdf: str, joints: Sequence[str], laws: Sequence[str], told: ArmFacts, before: bool
           ) -> dict[str, Setup]:
    """
    Return the setup of each law from what `ctc new-robot` writes.

    Parameters
    ----------
    urdf : str
        Text of the description.
    joints : sequence of str
        The arm.
    laws : sequence of str
        With gains by rule.
    told : ArmFacts
        What `ctc new-robot` is told of the arm.
    before : bool
        Whether no rotors are assumed, as before they were.

    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / 'robot.urdf'
        file.write_text(urdf, encoding='utf-8')
        setup = parameter_file.load(None, new_robot(str(file), joints, facts=told).values)
    if before:
        setup = setup.changed({
            'plant': {'rotor_inertia': 0.0},
            'controller': {'rotor_inertia': 0.0, 'estimator_slope': True}})
    limits = np.array(model_of(setup.controller, urdf).effort_limits)
    setup = setup.changed({'plant': {
        'actuator_lag': [LAG_S] * len(joints), 'input_delay': DELAY,
        'torque_rate_limit': (RATE_PER_EFFORT * limits).tolist(),
        'encoder_resolution': [ENCODER] * len(joints),
        'coulomb_friction': (DRY * limits).tolist()},
        'controller': {'input_delay': DELAY}})
    return {law: recommended_setup(setup, law) for law in laws}


def run(setup: Setup, urdf: str, arm: Arm) -> Outcome:
    """Return what a law does with an arm."""
    config = setup.controller
    model = model_of(config, urdf)
    controller = Controller(config, model)
    monitor = trips.TripMonitor(config.joint_names, 1_000_000)
    motion = make_motion(setup.reference, setup.route, dict(zip(
        setup.plant.joint_names, zip(setup.plant.initial_position,
                                     setup.plant.initial_velocity))))
    count = round(DURATION_S * 1e3)
    points = [motion.at(k * 1_000_000) for k in range(count + DELAY + 2)]
    arm.start(np.array(points[0][0]), np.array(model.gravity_torque(points[0][0])))
    last, errors, torques = arm.positions(), [], []
    trip, trip_time = '', np.nan
    for k in range(count):
        if arm.case.payload and k == round(PICKED_S * 1e3):
            arm.pick()
        q = arm.positions()
        sample = controller.try_step(
            q.tolist(), (1e3 * (q - last)).tolist(), *points[k],
            [points[k + j] for j in range(1, DELAY + 1)])
        last = q
        if sample is None:
            trip, trip_time = 'no finite torque', 1e-3 * k
            break
        if trip := monitor.check(controller, sample):
            trip_time = 1e-3 * k
            break
        torques.append(sample.tau)
        arm.step(np.array(sample.tau))
        errors.append(arm.links() - np.array(points[k + 1][0]))
    first = round(JUDGED_FROM_S * 1e3)
    error, torque = np.array(errors)[first:], np.array(torques)[first:]
    if not len(error):
        return Outcome(np.nan, np.nan, np.nan, trip, trip_time)
    change = np.abs(np.diff(torque, axis=0)) if len(torque) > 1 else np.zeros((1, 1))
    return Outcome(float(np.sqrt(np.square(error).mean(axis=0)).max()),
                   float(1e3 * change.mean(axis=0).max()), float(1e3 * change.max()),
                   trip, trip_time)


#: Laws that are compared.
LAWS = ('observer_feedback', 'compensation', 'pd_gravity', 'pid_kalman', 'slotine_li')
#: Cases by name.
CASES = {
    'exact': Case((1e-6, 1e-6 + 1e-9)), 'rigid': Case(), 'light rotors': Case((0.0005, 0.0005001)),
    **{f'elastic {f:g} Hz, encoder at the {side}': Case(resonance=f, encoder=side)
       for f in (10.0, 20.0, 40.0) for side in ('motor', 'link')},
    **{f'payload {m:g} kg': Case(payload=m) for m in (2.0, 5.0)}}


def rows(name: str, cases: Sequence[str], laws: Sequence[str], seeds: Sequence[int],
         told: ArmFacts, before: bool) -> Iterator[dict[str, Any]]:
    """Yield an outcome of each case, law and seed."""
    urdf, joints = urdfs.robot(DESCRIBED[name][0]), DESCRIBED[name][1]
    made = setups(urdf, joints, laws, told, before)
    compile_setups(list(made.values()), print)
    model = model_of(next(iter(made.values())).controller, urdf)
    assert isinstance(model, UrdfModel)
    effort = np.array(model.effort_limits)
    velocity = np.array(model.velocity_limits)
    for case in cases:
        for law in laws:
            for seed in seeds:
                posture = np.array(made[law].plant.initial_position)
                arm = Arm(urdf, joints, effort, velocity, posture, CASES[case], seed)
                outcome = run(made[law], urdf, arm)
                yield {'arm': name, 'case': case, 'law': law, 'seed': seed,
                       'before': before, 'told': told.resonance < np.inf,
                       **outcome._asdict()}


#: The page, and its part that is written from the rows.
PAGE = Path(__file__).with_name('arms.md')
_TABLES = re.compile(r'(<!-- tables -->\n).*(<!-- end of tables -->)', re.DOTALL)
#: Columns: the law, whether before, whether the resonance is told; and their heading.
_COLUMNS = ((('observer_feedback', True, False), 'observer_feedback, before'),
            (('observer_feedback', False, False), 'observer_feedback'),
            (('observer_feedback', False, True), 'the same, resonance told'),
            *(((law, False, False), law) for law in LAWS if law != 'observer_feedback'))
#: What a table shows of an outcome, and its heading.
_QUANTITIES = (
    ('rms', 'RMS error of the worst joint, largest of the draws [rad]', '.1e'),
    ('variation', 'Torque variation of the worst joint, largest of the draws [N·m/s]', '.0f'),
    ('rate', 'Largest change of a torque within 1 ms, largest of the draws [N·m/s]', '.0f'))


def tables(outcomes: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Yield a table of each arm and quantity, as Markdown."""
    for arm in dict.fromkeys(row['arm'] for row in outcomes):
        for quantity, heading, form in _QUANTITIES:
            yield f'**{arm}.** {heading}:\n'
            yield f'| case | {" | ".join(name for _, name in _COLUMNS)} |'
            yield '|' + '---|' * (1 + len(_COLUMNS))
            for case in CASES:
                drawn = [[row for row in outcomes if (row['arm'], row['case']) == (arm, case) and (
                    row['law'], row['before'], row['told']) == column] for column, _ in _COLUMNS]
                if any(drawn):
                    cells = (_cell(runs, quantity, form) for runs in drawn)
                    yield f'| {case} | {" | ".join(cells)} |'
            yield ''


def _cell(outcomes: Sequence[dict[str, Any]], quantity: str, form: str) -> str:
    """Return the largest number of the runs that went on, and how many tripped at which time."""
    values = [row[quantity] for row in outcomes if not row['trip']]
    words = [format(max(values), form)] if values else []
    times = sorted(row['trip_time'] for row in outcomes if row['trip'])
    if times:
        words.append(f'{len(times)} of {len(outcomes)} tripped by {times[-1]:.1f} s')
    return '; '.join(words)


def main() -> None:
    """Print an outcome a line, and write them; or write the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--arms', default='xarm7,kinova')
    parser.add_argument('--cases', default='all', help='beginnings of names')
    parser.add_argument('--laws', default='observer_feedback')
    parser.add_argument('--seeds', type=int, default=2)
    parser.add_argument('--first', type=int, default=701)
    parser.add_argument('--rows', type=Path, default=Path('arms.jsonl'))
    parser.add_argument('--told', type=json.loads, default={}, help='of new_robot, as JSON')
    parser.add_argument('--before', action='store_true',
                        help='without rotors, and without trips by limit cycles')
    parser.add_argument('--page', action='store_true', help='write the page from the rows')
    options = parser.parse_args()
    if options.page:
        outcomes = [json.loads(line) for line in options.rows.read_text().splitlines()]
        filled = '\n'.join(tables(outcomes))
        PAGE.write_text(_TABLES.sub(lambda block: f'{block[1]}\n{filled}\n{block[2]}',
                                    PAGE.read_text(encoding='utf-8')), encoding='utf-8')
        return
    if options.before:
        trips.TRIP_LIMITS = trips.TripLimits(cycling=np.inf)
    cases = list(CASES) if options.cases == 'all' else [
        case for case in CASES if any(case.startswith(x) for x in options.cases.split(','))]
    for name in options.arms.split(','):
        for row in rows(name, cases, options.laws.split(','),
                        range(options.first, options.first + options.seeds),
                        ArmFacts(**options.told), options.before):
            print(f"{row['arm']:8s} {row['case']:34s} {row['law']:18s} {row['seed']:3d} "
                  f"rms {row['rms']:.2e} variation {row['variation']:8.0f} rate "
                  f"{row['rate']:9.0f} {row['trip_time']:6.2f} {row['trip'][:70]}", flush=True)
            with options.rows.open('a') as file:
                file.write(json.dumps(row) + '\n')


if __name__ == '__main__':
    main()
