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
A map with polars: where two laws fail, over friction and gain, and what the gain should be.

``python map_polars.py`` runs 24 simulations, or finds them in ``map/``, and prints the error by
law and friction. It needs dask, pyarrow and polars: ``pip install '.[map]' polars``
in the checkout.
"""

from __future__ import annotations

from ctc_chattering import compute_map
import polars as pl

SPEC = {
    'params_file': 'friction', 'duration': 1.0, 'overrides': {
        '/**': {'control_period': 0.005}, 'reference': {'start_duration': 0.3}},
    'laws': ['compensation', 'chattering implicit_observer'],
    'axes': {
        'friction': {'parameter': 'plant.coulomb_friction', 'values': [2, 5, 10, 20]},
        'ka': {'parameter': 'controller.ka', 'values': [2, 10, 40]}},
    'failure': {'error_above': 0.02}}


def main() -> None:
    """Compute the map, and ask it two questions."""
    compute_map(SPEC, 'map', jobs=1)  # A row a run, also in map/map.parquet.
    rows = pl.read_parquet('map/map.parquet').with_columns(failed=pl.col('failure') != '')

    print(rows.group_by('law', 'friction').agg(
        pl.col('error').median(), pl.col('failed').mean()).sort('law', 'friction'))

    # The smallest Ka with which law (6) never fails, for each friction.
    print(rows.filter(pl.col('law') == 'chattering').group_by('friction', 'ka').agg(
        pl.col('failed').any()).filter(~pl.col('failed')).group_by('friction').agg(
            pl.col('ka').min().alias('least ka')).sort('friction'))


if __name__ == '__main__':  # The runs are computed by other processes, which import this file.
    main()
