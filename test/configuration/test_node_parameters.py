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

"""The table of all parameters."""

from ctc_chattering.configuration.node_parameters import NODES, parameter_table

#: Parameters by which the package drives its nodes.
INTERNAL = {'wait_for', 'hold_at', 'compiled'}


def test_the_table_has_every_parameter_that_a_user_sets() -> None:
    """Check names and nodes of all rows against the declarations."""
    rows = [line.split(' | ') for line in parameter_table().splitlines()[2:]]
    pairs = {(row[0].strip('| `'), node) for row in rows for node in row[1].split(', ')}
    assert pairs == {(name, node) for node, config in NODES.items()
                     for name in config.parameters() if name not in INTERNAL}
