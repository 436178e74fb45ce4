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
Sentences of `ctc identify` on findings, verdicts, gains and trials.

The other modules of the identification return records. `results` calls this module to put them
into words, for the terminal, the page and the JSON file. A finding says what was seen and why,
then what to do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ctc_chattering.control.recommended_gains import BANDWIDTH_LAG, MAX_POLE_LATENESS
from ctc_chattering.identification.findings import Finding, Reason, Severity
from ctc_chattering.identification.gains import GAIN_LIMITS, GainBasis, GainTrial, Recommendation
from ctc_chattering.identification.perturbation_bound import MARGIN
from ctc_chattering.identification.verdict import Verdict
from ctc_chattering.numerics.linear_algebra import Array


class Message(NamedTuple):
    """
    Words of a finding, with its values in braces.

    Attributes
    ----------
    about : str
        Subject, for the JSON file.
    text : str
        Observation and its cause.
    cure : str
        Advice, empty for none.

    """

    about: str
    text: str
    cure: str = ''


_RECORD_AGAIN = 'ecord a motion of `ctc excite --for {joint}` and identify both bags together.'
_LONGER_MOTION = 'Record a longer or faster motion of `ctc excite`.'
_DATA_SHEET = 'Give --torque-constant from the data sheet.'

#: Words for each reason. Here `joint` is the name of the joint.
MESSAGES = {
    Reason.RECORDING: Message('note', '{text}.'),
    Reason.PAYLOAD: Message(
        'note', '{recording}: the payload is taken as a ball of {mass:g} kg with a radius of 5 cm '
        'at the origin of {link}.'),
    Reason.ASSUMED_ROTORS: Message(
        'note', 'The URDF has too little inertia for some joints. Rotors [kg*m^2] are assumed: '
        '{rotors}.'),
    Reason.DROPPED: Message(
        'messages were dropped', 'The recorder of {recording} dropped {count} messages with '
        'states or torques. Windows without them are left out.',
        'Record again with less load on the computer.'),
    Reason.STAMPS: Message(
        'stamps', 'The stamps of {recording} jitter by {jitter_ms:.2g} ms at a period of '
        '{period_ms:.3g} ms. They are those of reception.',
        'Record the stamps that the driver gives the states.'),
    Reason.TURNS_COUNTED: Message(
        'note', '{recording}: the position jumps by a turn {count} times. The turns are counted.'),
    Reason.REPETITIONS: Message(
        'note', '{recording}: each state is recorded about {mean:.3g} times. {count} of {states} '
        'states repeat the one before and are left out.'),
    Reason.VELOCITY: Message(
        'unit of the velocity', 'The velocity of {joint} is {ratio:.3g} ± {error:.1g} times the '
        'change of its position; {low:g} to {high:g} times is allowed. It has another unit, such '
        'as degrees (57.3), another sign, or belongs to another joint. Laws that use velocities '
        'diverge with it.', 'Correct the velocities in joint_states, or record without them.'),
    Reason.TOOL: Message(
        'units', 'The {signal} of {joint} has {factor:.2g} ± {error:.1g} times the weight of the '
        'model. The URDF lacks a tool or payload, or the torque has another unit.',
        'Add the tool to the URDF.'),
    Reason.UNITS: Message(
        'units', 'The {signal} of {joint} has {factor:.2g} ± {error:.1g} times the weight of the '
        'model. Its unit or gear ratio is another one, or a mass in the URDF is wrong.',
        'Give --torque-constant, or correct the URDF.'),
    Reason.SIGN: Message(
        'sign of the torque', 'The {signal} of {joint} has the other sign than that of other '
        'joints: its friction is {friction:.2g} ± {error:.1g} N*m.',
        'Turn it with --torque-constant={option}.'),
    Reason.URDF_CONSTANT: Message(
        'scale of the torque', 'The torque constant of {joint} is taken from weight and inertia '
        'of the URDF: {constant:.3g} N*m per ampere ± {error:.0%}. All its torques are as wrong '
        'as the masses of the URDF.', _DATA_SHEET),
    Reason.OTHERS_CONSTANT: Message(
        'scale of the torque', 'The current of {joint} shows neither weight nor inertia of the '
        'model. A torque constant of {constant:.3g} N*m per ampere is assumed, from those of the '
        'other joints and the effort limits. All its torques are as wrong as that.', _DATA_SHEET),
    Reason.NO_CONSTANT: Message(
        'scale of the torque', 'The current of {joint} shows neither weight nor inertia of the '
        'model. Its torque constant is not known.',
        'Give --torque-constant in N*m at the joint per ampere.'),
    Reason.CORRECTED: Message(
        'note', '{file} has the identified bodies. They change the torque by {change} N*m RMS in '
        'this motion.'),
    Reason.ROTOR: Message('note', '{file} has a rotor inertia of {rotor}.'),
    Reason.MOUNT: Message(
        'mounting of the base', 'Gravity is along ({gravity}) m/s² in the frame of the base, '
        'turned by {degrees:.2g} degrees from the URDF. The base is mounted like that, and {file} '
        'has it.', 'Confirm the mounting.'),
    Reason.NOT_EXCITED: Message(
        'not excited', 'The joint {joint} hardly moves.',
        f'Raise its kp where friction holds it, or r{_RECORD_AGAIN}'),
    Reason.NOT_PREDICTED: Message(
        'not predicted', 'Unseen torque of {joint} is not predicted: the identified model leaves '
        '{identified_rms:.3g} of {recording_rms:.3g} N*m RMS, and the given model '
        '{model_rms:.3g} N*m.',
        f'Look at the figure of its torque, and r{_RECORD_AGAIN}'),
    Reason.UNEXPLAINED: Message(
        'unexplained torque', 'Unseen torque of {recording_rms:.3g} N*m RMS leaves '
        '{identified_rms:.3g} N*m unexplained, of which {systematic_rms:.2g} N*m last longer than '
        'noise. ka contains them.',
        'Look for its cause in the figure of its torque.'),
    Reason.UNCERTAIN: Message(
        'wide interval', 'The motion shows the friction only within wide intervals: {estimates}.',
        f'R{_RECORD_AGAIN}'),
    Reason.COUPLED: Message(
        'coupled joints', 'The torque of {joint} has friction of {coupled_joint}. Their gears are '
        'coupled, or the torques are those of the motors. Laws do not compensate this friction, '
        'and ka contains it.', 'Give torques at the joints: those of the motors times the '
        'transposed coupling matrix of the gears.'),
    Reason.OUTLIERS: Message(
        'outliers', 'Nothing explains the torque of {count} windows, up to {torque:.3g} N*m at '
        '{t:.2f} s: a contact, or wrong stamps. They are not in the largest |P|.',
        'Look at the recording there.'),
    Reason.BREAK_AWAY: Message(
        'friction at rest', '|P| of {joint} at rest or breaking away is up to {torque:.3g} N*m '
        'more than the joint shows while it slides. It has Stribeck friction below the velocities '
        'shown, or something else holds it.',
        'Record slower reversals, such as those of `ctc excite`.'),
    Reason.SEVERAL_DELAYS: Message(
        'drive', 'The motion does not tell delay and lag apart: {drives}.'),
    Reason.FAR_DELAYS: Message(
        'drive', 'The motion does not tell delay and lag apart: {drives}. Backlash or an elastic '
        'joint looks like that.', _LONGER_MOTION),
    Reason.UNBOUNDED_LAG: Message(
        'drive', 'The lag of the drive of {joint} is at least {lag_ms:.3g} ms, and may be the '
        'longest that is looked for, {longest_ms:.3g} ms. An elastic joint looks like that, or no '
        'command shows the lag.', _LONGER_MOTION),
    Reason.LONG_LAG: Message(
        'drive', 'The lag of the drive of {joint} is {lag_ms:.3g} ms, more than drives of arms '
        'have. An elastic joint, backlash or a delay of this joint looks like that.',
        'Measure the position behind the gear, or confirm that the drive is that slow.'),
    Reason.KA_CUT: Message(
        'gains', '|P| reaches {peak:.3g} N*m as fast as the limits allow. ka = {ka:.3g} N*m is '
        'cut to the effort limit, {effort:.3g} N*m.', 'Correct the model, or move more slowly.'),
    Reason.SLOW_DRIVE: Message(
        'gains', 'The drive changes its torque by {rate:.3g} N*m/s. Reversals within '
        '{reversal_s:g} s and faster motions need {needed:.3g} N*m/s.',
        'Expect errors at reversals, and slow the motion down.'),
    Reason.NO_RATE: Message(
        'note', 'The rate of the drives is not known. Give --torque-rate where a drive is slower '
        'than the torque_rate_limit that is recommended.'),
    Reason.NO_GAINS: Message(
        'gains', 'No gains survive the trial runs. {trial}', 'First resolve the other findings, '
        'including those of other joints; they make the intervals wide. Else record a longer '
        'motion of `ctc excite`.')}


class Words(NamedTuple):
    """Observation and advice of a finding."""

    text: str
    cure: str

    def __str__(self) -> str:
        """Return both."""
        return f'{self.text} {self.cure}'.rstrip()


def words_of(finding: Finding, joint: str) -> Words:
    """Return the sentences of a finding on a named joint."""
    message = MESSAGES[finding.reason]
    values = {name: _spell(value) for name, value in finding.values.items()}
    return Words(message.text.format(joint=joint, **values),
                 message.cure.format(joint=joint, **values))


def _spell(value: Any) -> Any:
    """Return several values, or a trial, as words."""
    if isinstance(value, GainTrial):
        return trial_text(value)
    if isinstance(value, Mapping):
        return ', '.join(f'{name} {x}' for name, x in value.items())
    if isinstance(value, list):
        return ', '.join(f'{x:.2g}' for x in value)
    return value


def verdict_text(verdict: Verdict) -> str:
    """Return the verdict with its reasons and their cures."""
    if verdict.severity == Severity.NOTE:
        return verdict.word
    reasons = [str(words_of(finding, verdict.joint)) for finding in verdict.findings
               if finding.severity == verdict.severity]
    return f'{verdict.word}: {" ".join(reasons)}'


def next_step(verdicts: Sequence[Verdict]) -> str:
    """Return which joints are usable, and what to do next."""
    groups = []
    for severity in Severity:
        names = [x.joint for x in verdicts if x.severity == severity]
        if names:
            joints = 'all joints' if len(names) == len(verdicts) else ', '.join(names)
            groups.append(f'{severity.label.capitalize()}: {joints}.')
    step = 'run with identified.yaml'
    if not all(x.usable for x in verdicts):
        step = 'resolve the findings below'
    sentences = [*groups, f'Next: {step}.']
    moving = ','.join(x.joint for x in verdicts if x.needs_motion)
    if moving:
        sentences.append(
            f'`ctc excite --for {moving}` makes a motion that shows more of these joints.')
    return ' '.join(sentences)


def gain_reasons(recommended: Recommendation, usable: Sequence[bool]) -> dict[str, str]:
    """Return the reason of each recommended parameter."""
    basis, pole = recommended.basis, recommended.pole
    latest = basis.latest
    delays = ' or '.join(map(str, basis.delays))
    texts = {
        'law': 'It inverts the lag of drives, and needs no velocities.',
        'input_delay': (f'A torque moves the arm after {delays} samples.' if delays else
                        'The delay is not known.'),
        'actuator_lag': 'It is the lag of the drives.',
        'switching': 'Only law chattering uses it.',
        'observer_bandwidth': f'Only law chattering uses it. It is {BANDWIDTH_LAG:g} / T for the '
        f'longest possible lag of the drives, T = {basis.longest_lag:.3g} s, at most '
        f'{GAIN_LIMITS.max_bandwidth:g} rad/s.',
        'ka': _ka_reason(basis, usable),
        'friction_level': 'It is the Coulomb friction.',
        'torque_rate_limit': 'The fastest motion, a reversal of friction within '
        f'{GAIN_LIMITS.reversal_s:g} s, and carrying the weight within '
        f'{GAIN_LIMITS.carried_s:g} s at the start need this rate. It is within the rate of the '
        'drives where that is known.',
        'kp': f'The double pole p = {pole:g} rad/s has p (T + h (1 + d)) = '
        f'{pole * latest.lateness:.2g} ≤ {MAX_POLE_LATENESS:g} with T = {latest.lag:.3g} s, '
        f'h = {basis.period:g} s, d = {latest.delay}.',
        'kv': 'It is 2 p.',
        'estimator_bandwidth': f'It is {basis.estimator_ratio:g} p for positions that are known '
        f'to {basis.resolution:.2g} rad.'}
    return {name: texts[name] for name in recommended.values}


def _ka_reason(basis: GainBasis, usable: Sequence[bool]) -> str:
    """Return the parts of ka, without unusable joints."""
    def listed(values: Array) -> str:
        return ', '.join(f'{round(x, 6):.3g}' if good else '-'
                         for x, good in zip(values.tolist(), usable))

    bound, run = basis.bound, basis.run
    return (
        f'It is {MARGIN:g} times the largest |P| of motions with up to {listed(bound.velocity)} '
        'rad/s: the limits of the description, or the speed of the run where it has none. Parts '
        f'of |P| are friction of {listed(bound.friction)}, errors of the model of '
        f'{listed(bound.error)}, and an unexplained torque of {listed(run.tail)} N*m. In the run '
        f'|P| is at most {listed(run.peak)} N*m.')


def trial_text(trial: GainTrial) -> str:
    """Return the result of trial runs with one pole."""
    gains = f'The gains with p = {trial.pole:g} rad/s'
    failed = trial.failed
    if failed is None:
        return f'{gains} survive on all of {trial.draws} simulated robots.'
    if failed.failure:
        cause = failed.failure
    elif failed.error > failed.allowed:
        cause = (f'the RMS error of {failed.joint} is {failed.error:.2g} rad, that of '
                 f'`compensation` {failed.allowed:.2g} rad')
    else:
        cause = f'a joint is at its torque limit for {failed.saturated:.0%} of the time'
    draw = failed.draw
    return (f'{gains} fail on robot {failed.number} of {trial.draws}: {cause}. This robot has '
            f'delay {draw.delay}, lag {draw.lag.max():.3g} s, friction at the '
            f'{"upper" if draw.friction_end > 0 else "lower"} end of its interval, and the model '
            f"is {draw.model_scale:.3g} of the robot's.")
