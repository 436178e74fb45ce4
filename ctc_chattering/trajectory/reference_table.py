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

"""The reference at every sample, as one array; what runs have in common is computed once."""

from __future__ import annotations

from functools import lru_cache

from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.polynomials import quintic
from ctc_chattering.numerics.time_grid import seconds
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.smooth_start import mean, TimedMotion, Transition
from ctc_chattering.trajectory.waypoints import Route, Waypoints
import numpy as np

#: Motions whose samples are kept.
_KEPT = 16


def reference_table(config: ReferenceConfig, route: Route | None,
                    start: tuple[tuple[str, tuple[float, float]], ...], joints: tuple[str, ...],
                    period: int, count: int) -> Array:
    """
    Return the desired motion at ``k period``, shape (count, 3, n) [rad, rad/s, rad/s²].

    Parameters
    ----------
    config, route
        As `make_motion` takes them.
    start : tuple of (str, (float, float))
        Position [rad] and velocity [rad/s] of the robot at the start by joint.
    joints : tuple of str, shape (n,)
        Order of the joints.
    period : int
        [ns].
    count : int
        Number of samples.

    """
    if route is not None:
        return _table(config, route, start, joints, period, count)
    return _kept(config, None, start, joints, period, count)


def _table(config: ReferenceConfig, route: Route | None,
           start: tuple[tuple[str, tuple[float, float]], ...], joints: tuple[str, ...],
           period: int, count: int) -> Array:
    motion = make_motion(config, route, dict(start))
    order = [config.joint_names.index(name) for name in joints]
    if not isinstance(motion, Transition):
        return _sampled(motion, order, period, count)
    table: Array
    if route is None:  # What does not depend on the start.
        table = reference_table(
            config.changed({'start_duration': 0.0}), None, (), joints, period, count).copy()
    else:
        table = _sampled(motion.after, order, period, count)
    inside = min(-(-motion.end // period), count)
    braking = motion.before
    assert isinstance(braking, Waypoints)
    moving = min(-(-braking.end // period) + 1, inside)
    before = _sampled(braking, order, period, moving)
    before = np.concatenate((before, np.repeat(before[-1:], inside - moving, axis=0)))
    s: Array = np.array([[seconds(k * period)] for k in range(inside)]) / seconds(motion.end)
    weight = quintic(s, seconds(motion.end), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    rows = mean(weight, tuple(before.transpose(1, 0, 2)),
                tuple(table[:inside].transpose(1, 0, 2)))
    table[:inside] = np.stack(rows, axis=1)
    return table


_kept = lru_cache(_KEPT)(_table)


def _sampled(motion: TimedMotion, order: list[int], period: int, count: int) -> Array:
    """Return the samples of a motion, of its joints in an order."""
    rows = np.array([motion.at(k * period) for k in range(count)]).reshape(count, 3, -1)
    # In the order of rows, in which the loop is compiled: for another one it would be once more.
    table: Array = np.ascontiguousarray(rows[:, :, order])
    return table
