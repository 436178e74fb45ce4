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
Recordings of real arms: torque that was not fitted, as an outsider predicts it.

`ctc identify` is given the first half of a recording. What it reports, `corrected.urdf` and the
friction of `identify.json`, predicts the torque of the second half with Pinocchio alone; a plain
ridge regression that comes with the recordings, `reference_fit.py`, is the floor. The recordings
stay where they are: their folder is in the environment variable CTC_REAL_RECORDINGS.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
import dataclasses
import importlib.util
import os
from pathlib import Path
import sys
from typing import Any, NamedTuple

from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.findings import Estimate
from ctc_chattering.identification.identified_robot import IdentifiedRobot, identify
from ctc_chattering.identification.recording import RecordedMotion
import numpy as np
import pinocchio as pin
from rigid_bodies import Array

#: Environment variable with the folder of the recordings.
FOLDER = 'CTC_REAL_RECORDINGS'
#: Velocity over which the reference smooths the sign of the velocity [rad/s].
SMOOTHED = 0.01
#: Every which sample is judged.
STEP = 5


class Case(NamedTuple):
    """
    A recording and how it is judged.

    Attributes
    ----------
    bag : str
        Name in the folder.
    cutoff : float
        Of the filters without delay [Hz].
    effort : str
        What the effort is.
    urdf : str
        Name of a description in the folder; empty for that of the bag.
    joints : tuple of str
        Joints that are identified; empty for all.
    constants : tuple of float
        Torque at the joint per unit of the effort; empty where it is identified, or 1.

    """

    bag: str
    cutoff: float = 5.0
    effort: str = 'motor'
    urdf: str = ''
    joints: tuple[str, ...] = ()
    constants: tuple[float, ...] = ()


#: Recordings that are judged where nothing else is asked for.
CASES = (
    Case('unisa_ur10_all'), Case('tx40_all', 20.0, urdf='tx40_ia.urdf'),
    Case('tiago_all', effort='current', joints=tuple(f'arm_{i}_joint' for i in range(1, 8))))


class Row(NamedTuple):
    """RMS of unseen torque of a joint [unit of the effort]: in the recording, and left of it."""

    joint: str
    verdict: str
    recording: float
    urdf: float
    with_friction: float
    reference: float
    identified: float
    coulomb: Estimate
    viscous: Estimate

    @property
    def ratio(self) -> float:
        """Part of what the reference leaves that is left."""
        return self.identified / self.reference


def reference_module(folder: Path) -> Any:
    """Return the reference fit that lies beside the recordings."""
    spec = importlib.util.spec_from_file_location('reference_fit', folder / 'reference_fit.py')
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def half(motion: RecordedMotion, part: float = 0.5) -> RecordedMotion:
    """Return the first part of a motion."""
    recording = motion.recording
    cut = recording.select(np.arange(int(part * len(recording.t))))
    return dataclasses.replace(motion, recording=cut)


def rows(case: Case, folder: Path) -> Iterator[Row]:
    """Yield a row of each joint."""
    reference = reference_module(folder)
    path = folder / case.bag
    urdf = (folder / case.urdf).read_text() if case.urdf else ''
    motion = read_motion(path, case.joints, urdf)
    robot = identify([half(motion)], urdf=urdf, side=case.effort,
                     torque_constant=case.constants or None)
    names, t, q, tau, description = reference.read(path)
    description = urdf or description
    cut = len(t) // 2
    first, second = (tuple(x[::STEP] for x in reference.smooth(
        t[part], q[part], tau[part], case.cutoff)) for part in (slice(0, cut), slice(cut, None)))
    floor = _reference(reference, description, names, first, second)
    predicted = outsider(robot, names, second)
    for verdict, friction in zip(robot.results.verdicts, robot.results.found.friction):
        joint = names.index(verdict.joint)
        measured = second[3][:, joint]
        yield Row(verdict.joint, verdict.word, float(floor.recording[joint]),
                  float(floor.urdf[joint]), float(floor.with_friction[joint]),
                  float(floor.reference[joint]), _rms(measured - predicted[verdict.joint]),
                  friction.coulomb, friction.viscous)


class Floor(NamedTuple):
    """RMS of unseen torque of n joints, shape (n,): in the recording, and what others leave."""

    recording: Array
    urdf: Array
    with_friction: Array
    reference: Array


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def _reference(reference: Any, description: str, names: Sequence[str], known: tuple[Array, ...],
               unseen: tuple[Array, ...]) -> Floor:
    """Return what the reference, and less than it, leave of unseen states and torques."""
    model, columns = reference.arm(description, names)
    n = len(names)
    q, dq, ddq, tau = known
    torque, regressor = reference.evaluate(model, columns, q, dq, ddq)
    bodies = regressor.shape[2]
    design = np.zeros((n, len(q), bodies + 4 * n))
    scale, friction = 1.0 / tau.std(axis=0), np.zeros((n, 4))
    for j in range(n):
        own = reference.joint_columns(dq[:, j], ddq[:, j])
        design[j, :, :bodies] = regressor[:, j]
        design[j, :, bodies + 4 * j:bodies + 4 * j + 4] = own
        friction[j, :3] = np.linalg.lstsq(own[:, :3], tau[:, j] - torque[:, j], rcond=None)[0]
    target = ((tau - torque) * scale).T.ravel()
    prior = np.concatenate([np.tile(reference.BODY_PRIOR, bodies // 10),
                            np.tile(reference.JOINT_PRIOR, n)])
    found = reference.ridge((design * scale[:, None, None]).reshape(-1, design.shape[2]), target,
                            prior)
    q, dq, ddq, tau = unseen
    torque, regressor = reference.evaluate(model, columns, q, dq, ddq)
    own = np.stack([reference.joint_columns(dq[:, j], ddq[:, j]) for j in range(n)], axis=1)
    alone = np.einsum('kjc,jc->kj', own, friction)
    fitted = regressor @ found[:bodies] + np.einsum(
        'kjc,jc->kj', own, found[bodies:].reshape(n, 4))
    left = (tau - tau.mean(axis=0), tau - torque, tau - torque - alone, tau - torque - fitted)
    return Floor(*(np.sqrt(np.mean(x ** 2, axis=0)) for x in left))


def outsider(robot: IdentifiedRobot, names: Sequence[str], unseen: tuple[Array, ...]
             ) -> dict[str, Array]:
    """Return the torque of each identified joint by what is reported, in units of the effort."""
    reported = robot.results.as_mapping()
    joints = reported['joint_names']
    model = pin.buildModelFromXML(list(robot.robot.files.values())[-1])
    free = [model.getJointId(name) for name in model.names[1:] if name not in names]
    whole = pin.buildReducedModel(model, free, pin.neutral(model))
    columns = [whole.joints[whole.getJointId(name)].idx_v for name in names]
    rotors = [0.0] * len(names)
    for name, inertia in zip(joints, getattr(robot.robot.model, 'rotor_inertias', ())):
        rotors[list(names).index(name)] = inertia
    q, dq, ddq, _ = unseen
    data, full, torque = whole.createData(), np.zeros((3, whole.nv)), np.zeros_like(q)
    for k, states in enumerate(zip(q, dq, ddq)):
        full[:, columns] = states
        torque[k] = pin.rnea(whole, data, *full)[columns]
    torque += np.array(rotors) * ddq
    constants = reported.get('torque_constant', [{'value': 1.0}] * len(joints))
    predicted = {}
    for name, numbers, constant in zip(joints, reported['friction'], constants):
        joint = list(names).index(name)
        whole_torque = torque[:, joint] + _friction(numbers, names, joint, dq, torque[:, joint])
        predicted[name] = whole_torque / (constant['value'] or 1.0)
    return predicted


def _friction(numbers: dict[str, Any], names: Sequence[str], joint: int, dq: Array, torque: Array
              ) -> Array:
    """Return friction by the numbers of identify.json, shape (K,) [N·m]; 0 for no number."""
    value = {key: x.get('value') or 0.0 for key, x in numbers.items() if isinstance(x, dict)}
    sign = np.tanh(dq / SMOOTHED)
    slow = np.exp(-np.square(dq[:, joint] / (value['stribeck_velocity'] or 1.0)))
    dry = value['coulomb'] + value['stribeck'] * slow + value['load'] * np.abs(torque)
    offset = 0.5 * (value['forwards'] - value['backwards'])
    friction = sign[:, joint] * dry + offset + value['viscous'] * dq[:, joint]
    for other in numbers['coupled']:
        k = list(names).index(other['joint'])
        friction += other['coulomb']['value'] * sign[:, k] + other['viscous']['value'] * dq[:, k]
    return np.asarray(friction, float)


def table(case: Case, found: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of a table in Markdown."""
    yield (f'| {case.bag} | recorded | URDF | with friction | reference fit | `ctc identify` | '
           'over the reference | verdict | Coulomb | viscous |')
    yield '|---|---|---|---|---|---|---|---|---|---|'
    for row in found:
        numbers = ' | '.join(f'{x:.3g}' for x in row[2:7])
        yield (f'| {row.joint} | {numbers} | {row.ratio:.2f} | {row.verdict} | '
               f'{row.coulomb.cell} | {row.viscous.cell} |')


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('bags', nargs='*', help='names of bags; default: those of the table')
    parser.add_argument('--cutoff', type=float, default=5.0)
    parser.add_argument('--effort', default='motor')
    parser.add_argument('--urdf', default='')
    parser.add_argument('--joints', default='')
    options = parser.parse_args()
    folder = os.environ.get(FOLDER)
    if not folder:
        sys.exit(f'{FOLDER} is not set: the folder of the recordings')
    cases = [Case(bag, options.cutoff, options.effort, options.urdf,
                  tuple(filter(None, options.joints.split(',')))) for bag in options.bags] or CASES
    for case in cases:
        print('\n'.join([*table(case, list(rows(case, Path(folder)))), '']))


if __name__ == '__main__':
    main()
