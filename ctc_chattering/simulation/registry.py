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

"""The simulated robot of a configuration, and the limits of its description."""

from __future__ import annotations

from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.registry import kept_model_of, model_of
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.joint_limits import check_limits, DescribedLimits


def limits_of(config: PlantConfig, description: str) -> DescribedLimits | None:
    """Return the limits of the description, which no plant keeps by itself; None without any."""
    if config.model != 'urdf' or not description:
        return None
    return DescribedLimits(description, config.joint_names)


def check_start(config: PlantConfig, description: str) -> None:
    """Raise `CtcError` if the plant starts beyond the limits of its description."""
    limits = limits_of(config, description)
    if limits is not None:
        check_limits('the start of the plant', limits,
                     [(config.initial_position, config.initial_velocity, ())])


def make_plant(config: PlantConfig, description: str = '', kept: bool = False) -> Plant:
    """
    Return the robot that `config` describes, at its start.

    Parameters
    ----------
    config : PlantConfig
        Of the plant.
    description : str
        Text of the URDF, where one is needed.
    kept : bool
        Take the model of the last such robot, for many runs: `kept_model_of`.

    Raises
    ------
    CtcError
        If there is no description, it does not have the joints, or the start is beyond its
        limits.

    """
    check_start(config, description)
    if config.payload:
        description = with_payload(description, config.joint_names, config.payload)
    return Plant(config, (kept_model_of if kept else model_of)(config, description))
