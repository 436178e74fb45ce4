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
How often the chattering term is at its bound ±Ka, and why.

At its bound the term cannot cancel more of the perturbation P, and v leaves 0. How long it stays
there at a stretch tells two causes apart:

- |P| exceeds Ka: the term is held at one bound as long as P keeps its sign, hundreds of samples.
- Noise of v, times inertia / h, exceeds what Ka has left (docs/theory.md), or a lag or a delay
  makes the loop oscillate: the term meets the bound and leaves it again within a few samples.

Switching ``sign`` is always at a bound, for (Ka + |P|) / (Ka - |P|) samples at a stretch. Of it
only stretches of `SIGN_STRETCH` samples and more count: |P| is then above 0.99 Ka.
"""

from __future__ import annotations

import dataclasses

from ctc_chattering.numerics.linear_algebra import Vector

#: Part of the samples at the bound that is worth a word.
WORTH_A_WORD = 0.05
#: Mean length of a stretch at the bound from which on Ka is too small [samples].
LONG_STRETCH = 10.0
#: Least length of a stretch that counts with switching ``sign`` [samples].
SIGN_STRETCH = 200
_NEAR = 1.0 - 1e-9


@dataclasses.dataclass(frozen=True)
class Saturation:
    """
    What was found on one joint.

    Attributes
    ----------
    fraction : float
        Part of the samples with the term at its bound.
    stretch : float
        Mean number of samples that it stays there.

    """

    fraction: float
    stretch: float

    @property
    def cause(self) -> str:
        """Return the reason that the numbers give; empty where the term is rarely at its bound."""
        if self.fraction <= WORTH_A_WORD:
            return ''
        return ('ka too small' if self.stretch >= LONG_STRETCH
                else 'noise, lag or delay too large')

    def __str__(self) -> str:
        """Say it on one line."""
        stretch = f'{self.stretch:.1f}' if self.stretch < LONG_STRETCH else f'{self.stretch:.0f}'
        found = (f'chattering term at its bound for {100.0 * self.fraction:.0f} % of the samples, '
                 f'{stretch} at a stretch')
        return f'{found}: {self.cause}' if self.cause else found


class TermSaturation:
    """
    Counts the samples at the bound, joint by joint.

    Parameters
    ----------
    n : int
        Number of joints.

    """

    def __init__(self, n: int) -> None:
        self._side = [0.0] * n
        self._length = [0] * n
        self.clear()

    def clear(self) -> None:
        """Count from 0 again; a stretch at the bound goes on."""
        n = len(self._side)
        self.samples = 0
        self._at, self._stretches = [0] * n, [0] * n

    def pause(self) -> None:
        """End all stretches: the next sample does not follow the last."""
        self._side = [0.0] * len(self._side)

    def add(self, term: Vector, ka: Vector, switching: str) -> None:
        """
        Count one sample.

        Parameters
        ----------
        term : sequence of float, shape (n,)
            Chattering term [N·m].
        ka : sequence of float, shape (n,)
            Its bounds [N·m]; a joint with 0 has no chattering term.
        switching : str
            How the term is evaluated.

        """
        self.samples += 1
        least = SIGN_STRETCH if switching == 'sign' else 1
        for i, (z, k) in enumerate(zip(term, ka)):
            if abs(z) < _NEAR * k or k == 0.0:
                self._side[i] = 0.0
                continue
            side = 1.0 if z > 0.0 else -1.0
            if side != self._side[i]:
                self._side[i], self._length[i] = side, 0
            self._length[i] += 1
            if self._length[i] == least:
                self._at[i] += least
                self._stretches[i] += 1
            elif self._length[i] > least:
                self._at[i] += 1

    def found(self) -> list[Saturation]:
        """Return what was counted since the last `clear`, joint by joint."""
        samples = max(self.samples, 1)
        return [Saturation(min(at / samples, 1.0), at / max(stretches, 1))
                for at, stretches in zip(self._at, self._stretches)]
