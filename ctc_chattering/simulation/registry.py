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

"""The plants that the parameter ``plant_backend`` can name."""

from __future__ import annotations

from ctc_chattering.dynamics.corrected_urdf import with_payload
from ctc_chattering.dynamics.registry import kept_model_of, locked_positions, model_of
from ctc_chattering.errors import CtcError
from ctc_chattering.simulation.plant import Plant
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.simulation.simulated_robot import Robot
from ctc_chattering.trajectory.joint_limits import check_limits, DescribedLimits


def limits_of(config: PlantConfig, description: str) -> DescribedLimits | None:
    """Return the limits that the builtin plant does not keep by itself; None without any."""
    if config.plant_backend != 'builtin' or config.model != 'urdf' or not description:
        return None
    return DescribedLimits(description, config.joint_names)


def check_start(config: PlantConfig, description: str) -> None:
    """Raise `CtcError` if the builtin plant starts beyond the limits of its description."""
    limits = limits_of(config, description)
    if limits is not None:
        check_limits('the start of the plant', limits,
                     [(config.initial_position, config.initial_velocity, ())])


def make_plant(config: PlantConfig, description: str = '', kept: bool = False) -> Robot:
    """
    Return the robot that `config` describes, at its start.

    Parameters
    ----------
    config : PlantConfig
        Its `plant_backend` chooses.
    description : str
        Text of the MJCF or URDF, where one is needed.
    kept : bool
        Take the model of the last such robot, for many runs: `kept_model_of`.

    Raises
    ------
    CtcError
        If there is no description, it does not have the joints, the start is beyond its limits,
        or the backend is not installed.

    """
    check_start(config, description)
    if config.payload:
        description = with_payload(description, config.joint_names, config.payload)
    if config.plant_backend == 'builtin':
        return Plant(config, (kept_model_of if kept else model_of)(config, description))
    if not description:
        raise CtcError(f'plant_backend {config.plant_backend} needs the parameter description, '
                       'or the topic robot_description')
    # Not above: the core does without what is outside of it, and this is needed seldom.
    from ctc_chattering.simulation.mujoco_plant import MujocoPlant
    return MujocoPlant(config, description, locked_positions(config.locked))
