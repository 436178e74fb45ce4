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
Saturation of the chattering term, and its likely cause.

The controller reports this of its last samples, and `analysis/result.py` of a run.

At its bound ±Ka the term cannot cancel more of the perturbation P, and v leaves 0. How long it
stays there at a stretch tells two causes apart:

- |P| exceeds Ka: the term is held at one bound as long as P keeps its sign, hundreds of samples.
- Noise of v, times inertia / h, exceeds what Ka has left (docs/theory.md), or a lag or a delay
  makes the loop oscillate: the term meets the bound and leaves it again within a few samples.

Switching ``sign`` is always at a bound, for (Ka + |P|) / (Ka - |P|) samples at a stretch. Of it
only stretches of `SIGN_STRETCH` samples and more count: |P| is then above 0.99 Ka.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ctc_chattering.numerics.linear_algebra import Array, Vector
import numpy as np

#: Share of the samples at the bound, above which a cause is named.
MIN_REPORTED_SHARE = 0.05
#: Mean length of a stretch at the bound from which on Ka is too small [samples].
LONG_STRETCH = 10.0
#: Shortest stretch that counts with switching ``sign`` [samples].
SIGN_STRETCH = 200
#: Share of Ka from which on the term is at its bound: it may be rounded.
_BOUND_SHARE = 1.0 - 1e-9


class Saturation(NamedTuple):
    """
    Saturation of one joint's chattering term.

    Attributes
    ----------
    fraction : float
        Share of the samples with the term at its bound.
    stretch : float
        Mean number of samples that it stays there.

    """

    fraction: float
    stretch: float

    @property
    def cause(self) -> str:
        """Likely cause, or '' if it is rarely saturated."""
        if self.fraction <= MIN_REPORTED_SHARE:
            return ''
        return ('ka is too small' if self.stretch >= LONG_STRETCH
                else 'noise, lag or delay is too large')

    def __str__(self) -> str:
        """Return a line for a report."""
        text = (f'the chattering term is at its bound in {100.0 * self.fraction:.0f} % of the '
                f'samples, for {self.stretch:.3g} samples at a time')
        return f'{text}: {self.cause}' if self.cause else text


def term_saturation(recordings: Iterable[tuple[Array, Vector, str]]) -> list[Saturation]:
    """
    Return the saturation of each joint's chattering term.

    Parameters
    ----------
    recordings : iterable of (term, ka, switching)
        Chattering term of consecutive samples, shape (N, n) [N·m], NaN where one is missing. Its
        bounds, shape (n,) [N·m], 0 for a joint without such a term. The switching's name.

    """
    samples = 0
    stretches: list[list[int]] = []
    for term, ka, switching in recordings:
        shortest = SIGN_STRETCH if switching == 'sign' else 1
        bound = np.array(ka)
        is_at_bound = (np.abs(term) >= _BOUND_SHARE * bound) & (bound > 0.0)
        side = np.where(is_at_bound, np.sign(term), 0.0)
        samples += int(np.isfinite(term[:, 0]).sum())
        stretches = stretches or [[] for _ in ka]
        for column, of_joint in zip(side.T, stretches):
            ends = np.flatnonzero(np.diff(column, append=np.nan))
            lengths = np.diff(ends, prepend=-1)
            of_joint += lengths[(column[ends] != 0.0) & (lengths >= shortest)].tolist()
    if not samples:
        return []
    return [Saturation(sum(lengths) / samples, sum(lengths) / max(len(lengths), 1))
            for lengths in stretches]
