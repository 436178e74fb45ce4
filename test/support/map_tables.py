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

"""Results of maps that no simulation made: errors and failures follow a rule."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

#: Law, gain of its robust term on the error, and how it bears delay.
LAWS = {
    'compensation': ('compensation', '', 0.0, 9.0),
    'chattering sign': ('chattering', 'sign', 1.0, 0.6),
    'chattering boundary_layer': ('chattering', 'boundary_layer', 1.0, 1.0),
    'chattering implicit': ('chattering', 'implicit', 1.2, 0.8),
    'chattering implicit_observer': ('chattering', 'implicit_observer', 1.3, 1.6),
    'observer_feedback': ('observer_feedback', '', 1.5, 1.3)}


def table_of(variants: Sequence[str], axes: Mapping[str, Any],
             columns: Mapping[str, Any], uncertain: Mapping[str, Any] | None = None) -> Any:
    """
    Return a table in the order of a map: point, variant, repeat.

    Parameters
    ----------
    variants : sequence of str
        Keys of `LAWS`, or other names of laws.
    axes : mapping of str to array_like
        The grid.
    columns : mapping of str to array_like
        Values of ``error`` and ``failure``, shape (points, variants, repeats).
    uncertain : mapping of str to array_like, optional
        Draws, shape (repeats,).

    """
    shape = np.shape(columns['error'])
    grid = np.meshgrid(*axes.values(), indexing='ij')

    def rows(values: Any, axis: int) -> Any:
        return np.broadcast_to(np.expand_dims(np.asarray(values), tuple(
            k for k in range(3) if k != axis)), shape).ravel()

    laws = [LAWS.get(name, (name, '')) for name in variants]
    return pa.table({
        'run': np.arange(np.prod(shape)), 'point': rows(np.arange(shape[0]), 0),
        'repeat': rows(np.arange(shape[2]), 2), 'seed': rows(7 + np.arange(shape[2]), 2),
        'variant': rows(list(variants), 1), 'law': rows([law[0] for law in laws], 1),
        'switching': rows([law[1] for law in laws], 1),
        **{name: rows(np.ravel(x).astype(float), 0) for name, x in zip(axes, grid)},
        **{name: rows(np.asarray(x, float), 2) for name, x in (uncertain or {}).items()},
        'engine': pa.array(['compiled'] * int(np.prod(shape))),
        'failure': np.ravel(columns['failure']),
        'reason': pa.array([''] * int(np.prod(shape))),
        'error': pa.array(np.ravel(np.asarray(columns['error'], float)), from_pandas=True)})


def made_up(axes: Mapping[str, Any], repeats: int, seed: int = 0,
            variants: Sequence[str] = tuple(LAWS)) -> Any:
    """Return a table for any of the axes friction, ka, delay and load."""
    random = np.random.default_rng(seed)
    model, noise = random.uniform(0.8, 1.2, repeats), random.uniform(1e-4, 1e-3, repeats)
    grid = dict(zip(axes, (np.ravel(x)[:, np.newaxis, np.newaxis] for x in np.meshgrid(
        *axes.values(), indexing='ij'))))
    friction, ka = grid.get('friction', 8.0), grid.get('ka', 12.0)
    delay, load = grid.get('delay', 0.0), grid.get('load', 1.0)
    gain, bears = (np.array([LAWS[name][k] for name in variants], float)[:, np.newaxis]
                   for k in (2, 3))
    luck = np.exp(0.25 * random.standard_normal((max(1, int(np.prod([
        len(x) for x in axes.values()]))), len(variants), repeats)))
    left = np.maximum(friction * load * model - gain * ka, 0.0)
    error = luck * (1e-3 * left + np.where(gain > 0.0, 1e-5 * ka * (1.0 + 5.0 * delay), 0.0)
                    + 0.1 * noise + 2e-2 * abs(model - 1.0) * (1.2 - 0.7 * gain))
    diverged = luck * gain * ka * (1.0 + delay) * model > 45.0 * bears
    failure = np.where(diverged, 'diverged', np.where(
        error > 5e-3, 'error', np.where(luck * ka > 38.0, 'saturated', '')))
    return table_of(variants, axes, {'error': np.where(diverged, np.nan, error),
                                     'failure': failure}, {'model': model, 'noise': noise})
