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

"""What delay, lag and rate limit of the drives say in words, and what is doubtful of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ctc_chattering.identification.regression.delay_and_lag import LAGS, Timing
from ctc_chattering.identification.regression.estimate import Estimate
from ctc_chattering.identification.regression.finding import ALL_JOINTS, Finding, Severity
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Part of the longest lag that is looked for that counts as it.
_END = 0.97
#: Up to so many delays each is said with its lags.
_EACH = 2
_EXCITE = 'record a motion of `ctc excite`, longer or faster'


def rate_limits(timing: Timing, joints: Sequence[str]) -> list[Estimate]:
    """Return the rate limit of each drive, or what it is at least."""
    known = timing.of_commands
    if known is None:
        return [Estimate.none('no commanded torque in the bag')] * len(joints)
    found = []
    longest = np.max([lags[2] for lags in known.delays.values()] or [known.lag], axis=0)
    for (low, _, high), moving, lag in zip(known.rate.T, known.moving, longest):
        if lag >= _END * LAGS[-1]:
            found.append(Estimate.none('delay and lag of the drive are not identifiable'))
        elif np.isfinite(high):
            found.append(Estimate(float(0.5 * (low + high)), float(0.5 * (high - low)),
                                  'N*m/s'))
        elif moving and low > 0.0:
            found.append(Estimate.none(f'at least {low:.3g} N*m/s: the drive follows commands '
                                       'that change so fast'))
        else:
            found.append(Estimate.none('no command changes fast enough, or delay and lag are '
                                       'not identified, or commands are missing'))
    return found


def timing_findings(timing: Timing, joints: Sequence[str], late: tuple[float, float]
                    ) -> Iterator[Finding]:
    """
    Yield what is doubtful of delay and lag.

    Parameters
    ----------
    timing : Timing
        As identified.
    joints : sequence of str
        Names.
    late : (float, float)
        Samples by which commands may be later than the recording has them.

    """
    known = timing.of_commands
    if known is None or not known.delays:
        return
    if late[1] > late[0]:
        yield Finding(Severity.NOTE, ALL_JOINTS, 'commands have no stamps, and arrived at the '
                      f'recorder unevenly: by up to {max(-late[0], late[1]):.2g} samples their '
                      'delay is uncertain')
    delays = sorted(known.delays)
    if len(delays) > 1:
        far = known.unsure
        yield Finding(Severity.CARE if far else Severity.NOTE, ALL_JOINTS,
                      f'delay and lag are not told apart: {drives_in_words(known, joints)}' + (
                          '; backlash or an elastic joint looks like that' if far else ''),
                      _EXCITE if far else '')
    lags = np.array(list(known.delays.values()))
    for i in np.flatnonzero(known.moving):
        low, high = float(lags[:, 0, i].min()), float(lags[:, 2, i].max())
        if high < _END * LAGS[-1]:
            continue
        if low > 0.0:
            yield Finding(
                Severity.REFUSED, int(i), f'the lag of the drive is {1e3 * low:.3g} ms or more, '
                f'at the end of what is looked for ({1e3 * LAGS[-1]:.3g} ms): an inertia that the '
                'model lacks, such as that of a rotor, or an elastic joint looks like that',
                'correct the inertia of the model, or measure the torque of the drive')
        else:
            yield Finding(Severity.CARE, int(i), 'the lag of the drive is not identifiable: up to '
                          f'{1e3 * LAGS[-1]:.3g} ms fit', _EXCITE)


def drives_in_words(timing: Timing, joints: Sequence[str]) -> str:
    """Return each delay that is possible with its lags; of many delays what holds them all."""
    if len(timing.delays) > _EACH:
        lags = np.array(list(timing.delays.values()))[:, :, timing.moving]
        return (f'delays of {min(timing.delays)} to {max(timing.delays)} samples, with lags of '
                + milliseconds(np.array((lags[:, 0].min(), 0.0, lags[:, 2].max()))))
    texts = []
    for delay, lags in sorted(timing.delays.items()):
        each = [(name, milliseconds(x)) for name, x, moving in zip(
            joints, lags.T, timing.moving) if moving]
        same = len({text for _, text in each}) == 1
        said = each[0][1] if same else ', '.join(f'{text} ({name})' for name, text in each)
        texts.append(f'delay {delay} with lag {said}')
    return ', or '.join(texts)


def milliseconds(lag: Array) -> str:
    """Return the lowest, best and highest lag, shape (3,) [s], in words."""
    low, high = 1e3 * float(lag[0]), 1e3 * float(lag[2])
    return f'{low:.3g} to {high:.3g} ms'


def lag_in_words(timing: Timing, i: int) -> str:
    """Return the lag of the drive of joint i, with its interval at the most likely delay."""
    known = timing.of_commands
    if known is None or not known.delays or not known.moving[i]:
        return 'not identifiable'
    lag = known.delays[int(known.delay)][:, i]
    one = len(known.delays) == 1
    if lag[1] == 0.0 and one:
        return f'none, at most {1e3 * lag[2]:.2g} ms'
    return milliseconds(lag) + ('' if one else f' with delay {int(known.delay)}')
