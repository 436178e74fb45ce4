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

"""The plots of pages: uPlot for axes, our script for the rest, and samples in their format."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from functools import lru_cache
import json
from typing import Any

from ctc_chattering.analysis.markup import asset, Markup
from ctc_chattering.analysis.result import Result
from ctc_chattering.numerics.linear_algebra import Array
import numpy as np

#: What is put together, in this order; it becomes the object `ctcPlots` of the page.
_SCRIPTS = ('samples.js', 'panel.js', 'svg.js', 'plots.js')
#: Signals that differ less than 32 bits tell: q of q_d, and one time of the next.
_EXACT = ('t', 'q', 'q_d')
#: Parts of a torque as the controller publishes them: nominal + compensation + robust.
PARTS = ('nominal', 'compensation', 'robust')


def _read(name: str) -> str:
    return asset('ctc_chattering.analysis', f'web/{name}')


@lru_cache
def component() -> Markup:
    """Return style and script of the plots for the head of a page; see plots.js for their use."""
    style = _read('uPlot.min.css') + _read('plots.css')
    own = '\n'.join(map(_read, _SCRIPTS))
    return Markup(f'<style>{style}</style>\n<script>\n/*{_read("uPlot.LICENSE")}*/\n'
                  f'{_read("uPlot.iife.min.js")}\nconst ctcPlots = (() => {{\n"use strict";\n{own}'
                  'return { mount: (...given) => new Plots(...given) };\n})();\n</script>')


def signals_of(result: Result) -> dict[str, Array]:
    """Return all signals of a run by the names that plots.js lists, each of shape (N, columns)."""
    run, terms = result.run, result.terms
    parts = terms.nominal, -terms.compensation, -terms.robust
    return {'q': run.q, 'q_d': run.q_d, 'dq': run.dq, 'e': run.e, 'v': terms.v,
            'V': terms.lyapunov[:, None], 'torque': run.tau, **dict(zip(PARTS, parts))}


def packed(t: Array, signals: Mapping[str, Array], **head: Any) -> bytes:
    """
    Return samples as the script reads them.

    Four bytes with the length of the head, the head in JSON, then the columns, each beginning at
    a multiple of eight bytes: 64 bits a number for `t`, `q` and `q_d`, 32 for the others.

    Parameters
    ----------
    t : ndarray, shape (N,)
        Times [s].
    signals : mapping of str to ndarray, shape (N,) or (N, n)
        By the names that plots.js lists.
    **head : Any
        More for the head: ``run``, number of the run, and ``fresh``; see `append` in plots.js.

    """
    columns, parts = [], []
    for name, rows in {'t': t, **signals}.items():
        kind = '<f8' if name in _EXACT else '<f4'
        with np.errstate(over='ignore'):
            values = np.asarray(rows, float).reshape(len(t), -1).T.astype(kind)
        for joint, column in enumerate(values):
            columns.append((name, joint, column.itemsize))
            parts.append(_filled(column.tobytes()))
    text = json.dumps({'count': len(t), 'columns': columns, **head}).encode()
    return b''.join((_filled(len(text).to_bytes(4, 'little') + text), *parts))


def coded(t: Array, signals: Mapping[str, Array]) -> str:
    """Return `packed` samples as text, for `packed` of a run in a page."""
    return base64.b64encode(packed(t, signals)).decode()


def _filled(data: bytes) -> bytes:
    """Return bytes with zeros up to a multiple of eight."""
    return data + bytes(-len(data) % 8)
