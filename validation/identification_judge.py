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

"""Independent verdict on an identification whose truth is known."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
import tempfile
import time
from typing import Any, NamedTuple

from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.errors import CtcError
from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.bodies import half_interval_of, IdentifiedBodies
from ctc_chattering.identification.findings import Estimate, Severity
from ctc_chattering.identification.friction import JointFriction
from ctc_chattering.identification.gains import recommend
from ctc_chattering.identification.identified_robot import corrected_description
from ctc_chattering.identification.identify import (
    Identification,
    identify_recordings,
    TorqueSignal,
)
from ctc_chattering.identification.perturbation import measure_perturbation
from ctc_chattering.identification.recording import Recording
from ctc_chattering.identification.results import IdentificationResults
from ctc_chattering.identification.sentences import verdict_text
from faults_of_arms import truths
from faulty_robots import Case, Played
from motion_bags import messages_of, write
import numpy as np
from rigid_bodies import Array
from robots import arm
from rosbags.rosbag2 import StoragePlugin

#: A number is wrong if it is off by this many halves of its interval ...
_HALVES = 1.5
#: ... and by this part of itself.
_PART = 0.05
#: The same of noise, which has no interval.
_NOISE = 0.2


class Number(NamedTuple):
    """
    A number with its truth.

    Attributes
    ----------
    name : str
        What it is.
    joint : int
        -1 for all.
    low, high : float
        Its interval.
    truth : (float, float)
        Lowest and highest over the run.
    scale : float
        What the part that it is off by is a part of.

    """

    name: str
    joint: int
    low: float
    high: float
    truth: tuple[float, float]
    scale: float

    @property
    def holds(self) -> bool:
        """Return whether the interval contains the truth."""
        return self.low <= self.truth[1] and self.high >= self.truth[0]

    @property
    def wrong(self) -> bool:
        """Return whether it is far off."""
        value, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        off = max(value - self.truth[1], self.truth[0] - value)
        return off > _HALVES * half and off > _PART * self.scale

    def __str__(self) -> str:
        """Return it in words."""
        return (f'{self.name}[{self.joint}] {0.5 * (self.low + self.high):.4g} ± '
                f'{0.5 * (self.high - self.low):.2g}, truth {self.truth[0]:.4g}'
                + (f' to {self.truth[1]:.4g}' if self.truth[1] != self.truth[0] else ''))


class Outcome(NamedTuple):
    """
    Result of `ctc identify` for a recording, only `refusal` where it refuses all.

    Its gains are for `model` and `urdf`, which are corrected where it corrects the description.
    """

    refusal: str
    results: IdentificationResults | None = None
    severity: tuple[Severity, ...] = ()
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0
    model: Model | None = None
    urdf: str = ''


def model_of(one: Case) -> Model:
    """Return the model that the user has."""
    urdf = arm(one.believed or one.robot.name).urdf
    return make_model('urdf' if urdf else 'two_link', 9.81, one.robot.joints, urdf)


def bag_of(path: Path, recording: Recording, seed: int, urdf: str = '', loss: float = 0.0
           ) -> Path:
    """
    Write a recording into a bag, MCAP or sqlite3 by the seed, and return its path.

    Joints of the states are shuffled. Messages arrive up to a third of a period late, one in five
    hundred two periods late, each topic in order; a part `loss` of them does not arrive.
    """
    rng = np.random.default_rng((seed, 5))
    n = len(recording.joints)
    sent = messages_of(recording.t, recording.joints, recording.q, recording.dq, recording.effort,
                       recording.command, order=rng.permutation(n).tolist(), labels=False,
                       urdf=urdf)
    period = 1e9 * recording.period
    late = period * (0.3 * rng.random(len(sent)) + 2.0 * (rng.random(len(sent)) < 0.002))
    latest: dict[str, int] = {}
    arrived: list[tuple[str, int, Any]] = []
    for (topic, t, message), more, lost in zip(sent, late, rng.random(len(sent)) < loss):
        if t and lost:
            continue
        latest[topic] = max(t + int(more), latest.get(topic, 0) + 1)
        arrived.append((topic, latest[topic], message))
    arrived.sort(key=lambda x: x[1])
    return write(path, arrived, (StoragePlugin.MCAP, StoragePlugin.SQLITE3)[seed % 2])


def outcome(one: Case, recording: Recording, seed: int) -> Outcome:
    """Return what `ctc identify` makes of a recording."""
    model, urdf = model_of(one), arm(one.believed or one.robot.name).urdf
    begin = time.perf_counter()
    try:
        if one.bag:
            with tempfile.TemporaryDirectory() as folder:
                path = bag_of(Path(folder) / 'bag', recording, seed, urdf)
                recording = read_motion(path, one.robot.joints, urdf).recording
            begin = time.perf_counter()
        recording = recording.checked()
        signal = TorqueSignal('' if recording.effort is None else one.effort)
        found = identify_recordings([recording], model, signal)
        text = corrected_description(found, urdf)
        if text:
            model, urdf = make_model('urdf', 9.81, one.robot.joints, text), text
        run = measure_perturbation(found, bool(text))
        results = IdentificationResults(recording.name, found, run,
                                        recommend(found, run, model, (), bool(text)))
    except CtcError as error:
        return Outcome(str(error))
    return Outcome('', results, tuple(x.severity for x in results.verdicts),
                   tuple(map(verdict_text, results.verdicts)), time.perf_counter() - begin, model,
                   urdf)


def numbers(one: Case, found: Identification, seen: Played, duration: float) -> Iterator[Number]:
    """Yield all numbers that have a truth."""
    true = truths(one, duration)
    through = np.abs(seen.link).mean(axis=0)
    for k, x in enumerate(_gravity(found.bodies) if found.bodies else ()):
        pull = np.full(2, one.robot.physics.bodies.gravity[k])
        yield from _number(f'gravity {"xyz"[k]}', -1, x, pull, 9.81)
    for i, friction in enumerate(found.friction):
        coulomb = float(true['coulomb'][1, i])
        # Friction of commands has what dead bands of drives take, as far as they are not apart: of
        # torques of one sign that is an offset.
        hidden = true['band'][:, i] * (friction.dead_band.value is None)
        either = hidden * [-1.0, 1.0]
        for name, more, scale in (
                ('coulomb', hidden * [0.0, 1.0], 0.0), ('forwards', either, 0.0),
                ('backwards', either, 0.0),
                ('viscous', 0.0, 0.0), ('load', 0.0, coulomb / through[i])):
            yield from _number(name, i, getattr(friction, name), true[name][:, i] + more, scale)
        yield from _slow_friction(i, friction, true, coulomb)
        noise, size = found.noise[i].value, _NOISE * float(true['noise'][0, i])
        if noise is not None:
            yield Number('velocity noise', i, noise - size, noise + size,
                         (float(true['noise'][0, i]),) * 2, size)
        if found.bodies is not None:
            yield from _number('rotor', i, found.bodies.rotors[i], true['rotor'][:, i],
                               float(found.fit.data.deviation[i]) / 100.0)
        yield from _number('rate', i, found.rate[i], true['rate'][:, i], 0.0)


def _gravity(bodies: IdentifiedBodies) -> list[Estimate]:
    """Return the components of gravity in the frame of the base [m/s²]."""
    first = len(bodies.values) - 3
    return [Estimate(value, half_interval_of(bodies.fit, first + k), 'm/s^2')
            for k, value in enumerate(bodies.gravity.tolist())]


def _slow_friction(i: int, friction: JointFriction, true: dict[str, Any], coulomb: float
                   ) -> Iterator[Number]:
    """Yield Stribeck friction, also where there is said to be none."""
    x = friction.stribeck
    is_excluded = x.absent and x.shown_above is None
    yield from _number('stribeck', i, Estimate(0.0, 1e-9) if is_excluded else x,
                       true['stribeck'][:, i], coulomb)


def _number(name: str, i: int, x: Estimate, truth: Array, scale: float) -> Iterator[Number]:
    """Yield an estimate if it has a number, or a bound above."""
    if x.at_most is not None:
        x = Estimate(0.0, x.at_most)
    if x.value is not None and np.isfinite(x.half):
        yield Number(name, i, x.value - x.half, x.value + x.half,
                     (float(truth[0]), float(truth[1])), max(scale, abs(float(truth[1]))))


def timings(one: Case, found: Identification) -> Iterator[tuple[str, bool, bool, int]]:
    """Yield what is said of delay and lags: words, whether it holds, is wrong, and the joint."""
    known = found.timing if found.timing.source == 'command' else found.timing.commands
    if known is None:
        return
    true, lags = one.robot.delay, truths(one, 1.0)['lag'][0]
    if true not in known.delays:
        yield f'delays {list(known.delays)}, truth {true}', False, True, -1
        return
    yield '', True, False, -1
    low, _, high = known.delays[true]
    for i, (a, b) in enumerate(zip(low, high)):
        if np.isfinite(b) and np.isfinite(a):
            x = Number('lag', i, float(a), float(b), (lags[i], lags[i]), max(5e-4, lags[i]))
            yield str(x), x.holds, x.wrong, i


def judged(one: Case, seen: Played, made: Outcome, duration: float
           ) -> dict[str, Any]:
    """
    Return the row of a run: what holds, and what is wrong without a warning.

    Numbers of joints that are usable count for what holds; a number is wrong without a warning if
    nothing is said of its joint, and one of all joints if nothing is said of any.
    """
    n = one.robot.n
    if made.results is None:
        return {'refusal': made.refusal, 'held': [], 'wrong': [], 'usable': 0, 'care': 0,
                'refused': n}
    clean = [x == Severity.NOTE for x in made.severity]
    found = made.results.found
    said = [(str(x), x.holds, x.wrong, x.joint) for x in numbers(one, found, seen, duration)]
    said += list(timings(one, found))
    held = [bool(holds) for _, holds, _, i in said if (clean[i] if i >= 0 else any(clean))]
    wrong = [words for words, _, bad, i in said if bad and (clean[i] if i >= 0 else any(clean))]
    warned = [words for words, _, bad, i in said
              if bad and i >= 0 and made.severity[i] == Severity.CARE]
    return {'refusal': '', 'held': held, 'wrong': wrong, 'warned': warned,
            'usable': sum(clean), 'care': sum(x == Severity.CARE for x in made.severity),
            'refused': sum(x == Severity.REFUSED for x in made.severity),
            'reasons': list(made.reasons), 'seconds': round(made.seconds, 1)}
