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

"""Files of an identified robot."""

from __future__ import annotations

import dataclasses
from pathlib import Path

from ctc_chattering.configuration import parameter_file
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.identification.bag_motion import read_motion
from ctc_chattering.identification.identified_robot import identify, write_identified
from identified_bags import recorded_bag, short


def test_the_parameter_file_keeps_the_limits_of_the_recorded_controller(tmp_path: Path) -> None:
    motion = read_motion(recorded_bag(tmp_path / 'run', short()), model='two_link')
    limits = {'error_limit': [0.5, 0.4], 'effort_limit': [5100.0, 850.0]}
    recorded = dataclasses.replace(motion, controller=ControllerConfig().changed(limits))
    for each, expected in ((recorded, limits), (motion, {})):
        out = tmp_path / str(len(expected))
        write_identified(identify([each], 'two_link'), out, trials=0)
        written = parameter_file.load(out / 'identified.yaml').controller
        kept = {name: list(getattr(written, name)) for name in limits}
        assert {name: x for name, x in kept.items() if max(x) < 1e9} == expected
