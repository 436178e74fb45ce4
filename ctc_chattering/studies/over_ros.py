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

"""A run of the nodes, in place of a simulation."""

from __future__ import annotations

from pathlib import Path
import tempfile

from ctc_chattering.analysis.result import Result
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.loop_setup import Setup
from ctc_chattering.launch.graph import run_graph, Stopped
from ctc_chattering.ros.domain import own_domain


def over_ros(setup: Setup) -> Result:
    """Run the nodes, record a bag, and return what it says; the states are the measured ones."""
    with own_domain(), tempfile.TemporaryDirectory(prefix='ctc_chattering_') as scratch:
        file, bag = Path(scratch) / 'parameters.yaml', Path(scratch) / 'bag'
        parameter_file.dump(setup.values, file)
        try:
            run_graph(file, {}, bag, show=lambda _: None)
        except Stopped as error:
            raise KeyboardInterrupt(str(error)) from None
        return read_bag(bag)
