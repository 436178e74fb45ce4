"""The reference at every sample, as one array; what runs have in common is computed once."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.numerics.polynomials import quintic
from ctc_chattering.numerics.time_grid import NANOSECONDS, seconds
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.smooth_start import Motion, mean, Transition
from ctc_chattering.trajectory.waypoints import Route

#: Motions whose samples are kept.
_KEPT = 16


def reference_table(config: ReferenceConfig, route: Route | None,
                    start: dict[str, tuple[float, float]], joints: tuple[str, ...], period: int,
                    count: int) -> Array:
    """
    Return the desired motion at ``k period``, shape (count, 3, n) [rad, rad/s, rad/s²].

    Parameters
    ----------
    config, route, start
        As `make_motion` takes them.
    joints : tuple of str, shape (n,)
        Order of the joints.
    period : int
        [ns].
    count : int
        Number of samples.

    """
    if route is None and not config.start_duration:
        return _sinusoid(config, joints, period, count)
    motion = make_motion(config, route, start)
    order = [config.joint_names.index(name) for name in joints]
    if not isinstance(motion, Transition):
        return _sampled(motion, order, period, count)
    if route is None:
        table = _sinusoid(config.changed({'start_duration': 0.0}), joints, period, count).copy()
    else:
        table = _sampled(motion.after, order, period, count)
    inside = min(-(-motion.end // period), count)
    before = _sampled(motion.before, order, period, inside)
    s = np.arange(inside) * period / motion.end
    weight = quintic(s[:, np.newaxis], seconds(motion.end), 0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    rows = mean(weight, tuple(before.transpose(1, 0, 2)),
                tuple(table[:inside].transpose(1, 0, 2)))
    table[:inside] = np.stack(rows, axis=1)
    return table


@lru_cache(_KEPT)
def _sinusoid(config: ReferenceConfig, joints: tuple[str, ...], period: int, count: int) -> Array:
    """Return the samples of a sinusoid."""
    order = [config.joint_names.index(name) for name in joints]
    return _sampled(make_motion(config), order, period, count)


def _sampled(motion: Motion, order: list[int], period: int, count: int) -> Array:
    """Return the samples of a motion, of its joints in an order."""
    points = (motion.at(k * period) for k in range(count))
    flat = np.fromiter((x for point in points for row in point for x in row), float,
                       count * 3 * len(order) if count else 0)
    return flat.reshape(count, 3, -1)[:, :, order]
