"""
Drives between commanded and applied torque, as `simulation/drive.py` has them.

Their response to a command is the reference's own function, compiled.
"""

from __future__ import annotations

from ctc_chattering.batch.compiler import inlined
from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.simulation import drive

response = inlined(drive.response)


@inlined
def command(tau: Array, lag: Array, rate: Array, period: float, gap: Array, torque: Array,
            mean: Array) -> None:
    """
    Take a command, to be held for `period` [s].

    Parameters
    ----------
    tau, lag, rate : array, shape (n,)
        Command [N·m], time constant [s] and rate limit [N·m/s].
    period : float
        h [s].
    gap, torque, mean : array, shape (n,)
        Command less torque when it came; torque at the end of the period; mean over it [N·m].

    """
    for i in range(len(tau)):
        gap[i] = tau[i] - torque[i]
        x, area = response(gap[i], lag[i], rate[i], period)
        torque[i] = tau[i] + x
        mean[i] = tau[i] + area / period


@inlined
def middle(gap: float, lag: float, rate: float, s: float, half: float) -> float:
    """Return torque less command for the middle of a step of Simpson's rule; see the reference."""
    x, a = response(gap, lag, rate, s - half)
    y, b = response(gap, lag, rate, s + half)
    return 0.75 * (b - a) / half - 0.25 * (x + y)
