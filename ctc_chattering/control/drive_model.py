"""
The drives as the controller knows them: a lag of first order with a limited rate.

While a command c is held, the torque τ of a drive with the lag T and the rate limit R follows::

    dτ/dt = (c - τ) / T, within ±R

It moves at the rate R until |c - τ| = R T, then exponentially. What a period h of that does to a
mass has a closed form; with x = τ - c, s the time since the command, r the end of the first part::

    x(h),     1/h ∫ x ds,     2/h² ∫ (h - s) x ds

the last two being the means that the velocity and the position at the end of the period see.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ctc_chattering.numerics.linear_algebra import Array
from ctc_chattering.parameters import LARGEST

#: In the place of a lag of 0 [s]: shorter than any period.
_NO_LAG = 1e-12


class Response(NamedTuple):
    """Torque of the drives over a period, each of shape (n,) [N·m]."""

    #: At the end.
    end: Array
    #: Mean, which changes the velocity.
    mean: Array
    #: Mean weighted by the time that is left, which changes the position.
    weighted: Array


class DriveModel:
    """
    Drives with a known lag and rate limit.

    Parameters
    ----------
    lag : array, shape (n,)
        T [s]; 0 for none.
    rate : array, shape (n,)
        R [N·m/s]; inf for none.
    period : float
        h [s].

    Attributes
    ----------
    reach : array, shape (n,)
        R (T + h): a command farther than this from the torque moves it no faster [N·m].

    """

    def __init__(self, lag: Array, rate: Array, period: float) -> None:
        self._period, self._rate = period, rate
        self._lagging, self._lag = lag > 0.0, np.maximum(lag, _NO_LAG)
        self._slope = np.where(rate < np.inf, rate, 0.0)
        self._decay = np.exp(-period / self._lag)
        self.reach: Array = np.minimum(rate * (lag + period), LARGEST)

    def response(self, torque: Array, command: Array) -> Response:
        """Return what `torque` does over a period in which `command` is held, both (n,) [N·m]."""
        h, T, x0 = self._period, self._lag, torque - command
        r = np.minimum(np.maximum(np.abs(x0) / self._rate - T, 0.0), h)
        slope, rest = -np.sign(x0) * self._slope, h - r
        x1 = x0 + slope * r
        decay = np.exp(-rest / T)
        area = r * (x0 + 0.5 * slope * r) + T * x1 * (1.0 - decay)
        weighted = (h * r * (x0 + 0.5 * slope * r) - r * r * (0.5 * x0 + slope * r / 3.0)
                    + x1 * T * (rest - T * (1.0 - decay)))
        return Response(command + x1 * decay, command + area / h,
                        command + 2.0 / (h * h) * weighted)

    def command(self, now: Array, after: Array) -> Array:
        """
        Return the command by which the drives give a wanted torque, shape (n,) [N·m].

        Where the torque of a drive with a lag differs from what is wanted, that decays with T::

            c = (after - E now) / (1 - E),     E = exp(-h / T)

        which for small h is wanted + T d(wanted)/dt. A drive without a lag gets `now`.

        Parameters
        ----------
        now, after : array, shape (n,)
            Wanted at the start and at the end of the period [N·m].

        """
        E = self._decay
        return np.where(self._lagging, (after - E * now) / (1.0 - E), now)
