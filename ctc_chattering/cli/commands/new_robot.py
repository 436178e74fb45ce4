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

"""`ctc new-robot`: from a URDF to a parameter file that runs."""

from __future__ import annotations

import argparse
from pathlib import Path

from ctc_chattering.analysis.output import prepare, writing
from ctc_chattering.cli.options import add_urdf_options, check

DETAILS = ('It has a sinusoid around the middle of the limits, at no more than half of them, law '
           'observer_feedback with the recommended gains, and a friction that is assumed. '
           'docs/robots.md says what to set next.')
_COMMENT = """\
# By `ctc new-robot` from {location}.
# Assumed: coulomb_friction of the plant, {friction:.0%} of the torque that the model takes.
# ka of the controller must exceed the friction of the real robot and the error of the model; it
# is {ka:.0%} of the effort limit for the one, and a fifth of the model's torque for the other.
# Set what is known of the drives: actuator_lag, torque_rate_limit and input_delay.
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc new-robot`."""
    add_urdf_options(parser, required=True)
    parser.add_argument('--out', type=Path, metavar='F', default=Path('robot.yaml'),
                        help='parameter file to write, default: robot.yaml')
    parser.add_argument('--overwrite', action='store_true', help='replace an existing file')


def run(options: argparse.Namespace) -> int:
    """Run `ctc new-robot`."""
    from ctc_chattering.configuration import parameter_file
    from ctc_chattering.configuration.new_robot import FRICTION, KA, new_robot

    check('--gravity', options.gravity, 0)
    location = options.urdf if '://' in options.urdf else str(Path(options.urdf).resolve())
    joints = [name.strip() for name in (options.joints or '').split(',') if name.strip()]
    values = new_robot(location, joints, options.gravity)
    out = options.out
    prepare(out.parent, (out.name,), options.overwrite)
    with writing(out):
        parameter_file.dump(values, out)
        out.write_text(_COMMENT.format(location=location, friction=FRICTION, ka=KA)
                       + out.read_text(encoding='utf-8'), encoding='utf-8')
    motion = values['reference']
    for name, centre, amplitude, frequency in zip(
            values['/**']['joint_names'], motion['center'], motion['amplitude'],
            motion['frequency']):
        print(f'{name}: {centre:g} ± {amplitude:g}, {frequency:g} Hz')
    print(f'wrote {out}; next: ctc compile {out}, ctc simulate {out}, bringup {out}')
    return 0
