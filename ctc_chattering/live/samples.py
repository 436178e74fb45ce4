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

"""What the page shows of an arm at one instant and over time, from a graph or from a bag."""

from __future__ import annotations

from collections.abc import Sequence
import dataclasses

from ctc_chattering.analysis.markup import fragment, Markup
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: Colours of lines: the palette of Okabe and Ito, which people with any colour vision can
#: distinguish.
COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9', '#808080')
_COLUMNS = ('joint', 'q', 'q_d', 'error', 'RMS, 1 s', 'v', 'torque')
_TABLE = """<div style="padding:2px 8px;font-size:0.8em">{{ title }} t =
<span class="ctc-time">{{ t }}</span> s<table class="ctc-numbers"
style="width:100%;text-align:right;font-variant-numeric:tabular-nums;font-size:0.9em;
white-space:nowrap"><tr>
{%- for x in columns %}<th>{{ x }}</th>{% endfor %}</tr>
{%- for row in rows %}<tr>{% for x in row %}<td
{%- if loop.first %} style="white-space:normal;overflow-wrap:anywhere;min-width:5em"{% endif -%}
>{{ x }}</td>{% endfor %}</tr>{% endfor -%}
</table></div>"""


@dataclasses.dataclass(frozen=True)
class Samples:
    """
    Signals over time, as columns.

    Attributes
    ----------
    t : ndarray, shape (N,)
        [s].
    e, v : ndarray, shape (N, n)
        Position error [rad] and filtered error [rad/s].
    torque : ndarray, shape (N, n)
        Of the law [N·m].

    """

    t: Array
    e: Array
    v: Array
    torque: Array

    def part(self, rows: slice) -> Samples:
        """Return some of the samples."""
        return Samples(*(x[rows] for x in vars(self).values()))


@dataclasses.dataclass(frozen=True)
class Instant:
    """
    One sample.

    Attributes
    ----------
    t : float
        [s].
    q, q_d : ndarray, shape (n,)
        Position and desired position [rad].

    """

    t: float
    q: Array
    q_d: Array


def rms(samples: Samples, last: float = 1.0) -> Array:
    """Return the RMS error over the last `last` seconds, shape (n,) [rad]; nan without samples."""
    if not len(samples.t):
        return np.full(samples.e.shape[1], np.nan)
    recent = samples.e[samples.t > samples.t[-1] - last]
    mean: Array = np.sqrt(np.mean(np.square(recent), axis=0))
    return mean


def table(names: Sequence[str], instant: Instant, samples: Samples, title: str = '',
          since: float = 0.0) -> Markup:
    """Return the numbers of an instant as an HTML table, its time as that from `since` on [s]."""
    known = len(samples.t) > 0
    errors = rms(samples)
    rows = []
    for i, name in enumerate(names):
        v, tau = (samples.v[-1, i], samples.torque[-1, i]) if known else (np.nan, np.nan)
        rows.append((name, f'{instant.q[i]:.6f}', f'{instant.q_d[i]:.6f}',
                     f'{instant.q_d[i] - instant.q[i]:.2e}', f'{errors[i]:.2e}', f'{v:.2e}',
                     f'{tau:.1f}'))
    return fragment(_TABLE, columns=_COLUMNS, rows=rows, title=title,
                    t=f'{instant.t - since:.3f}')
