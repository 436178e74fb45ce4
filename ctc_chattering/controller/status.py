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

"""The status of the control loop, for `/diagnostics`."""

from __future__ import annotations

from collections.abc import Mapping

from ctc_chattering.controller.health import Problem
from ctc_chattering.controller.loop import ControlLoop
from ctc_chattering.controller.state_machine import Mode
from ctc_chattering.controller.trips import low_bandwidth, unsafe_settings
from ctc_chattering.numerics.time_grid import seconds


def loop_status(loop: ControlLoop, now: int, rejected: Mapping[str, int], skipped: int,
                cause: str = '') -> Problem:
    """
    Return the mode and its problems, with level 0 if all is well.

    Parameters
    ----------
    loop : ControlLoop
        The loop.
    now, rejected, skipped, cause
        As `ControllerHealth.report` takes them.

    """
    problems: list[Problem] = []
    if loop.last is not None:
        problems += loop.health.report(
            now, loop.last.t, rejected, skipped, loop.simulated, cause)
    if loop.law is not None:
        config = loop.law.config
        problems += loop.health.saturation(config)
        warnings = *low_bandwidth(loop.law), *unsafe_settings(config)
        problems += [Problem(1, text) for text in warnings]
    mode = loop.mode
    if mode in (Mode.TRIPPED, Mode.TRIPPED_AND_DISABLED):
        return Problem(2, f'tripped: {loop.tripped}; call ~/reset')
    if mode is Mode.NO_STATE:
        return Problem(2, f'no state for {seconds(loop.watchdog.silence(now)):.1f} s')
    if mode is Mode.HELD:
        return Problem(1, f'{mode.text}: {loop.hold_reason}')
    if mode is Mode.HOLDING:
        return Problem(
            2, f'no reference for {seconds(loop.motion.grace):g} s; holding the position')
    if not mode.sends_torque or not problems:
        return Problem(int(not mode.sends_torque), mode.text)
    level = max(x.level for x in problems)
    text = '; '.join(x.text for x in problems)
    return Problem(level, f'running, but {text}')
