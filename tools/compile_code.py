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

"""Compile the closed loop of two joints and the plant with faults, for which tests would wait."""

from multiprocessing import get_context

from ctc_chattering.compiled.build import build
from ctc_chattering.configuration import parameter_file
from ctc_chattering.configuration.compilation import uncompiled_codes


def compile_plant() -> None:
    """Compile the plant with the faults of real arms."""
    from faults_of_arms import case, recorded
    from faulty_robots import plant_of

    one = case('two_link_urdf', 'plain', 0)
    recorded(one, 0, 0.1)
    plant_of(one.robot, (0.0, 0.0)).step((0.0, 0.0))


if __name__ == '__main__':
    plant = get_context('fork').Process(target=compile_plant)
    plant.start()
    # In one process, where a part of several functions is looked at once, these take two thirds
    # of the processor's time that they take in one each.
    for code in uncompiled_codes(parameter_file.load(None, {'controller': values}) for values in (
            {}, {'law': 'compensation'}, {'law': 'observer_feedback'},
            {'switching': 'implicit_observer'})):
        build(code)
    plant.join()
    raise SystemExit(plant.exitcode)
