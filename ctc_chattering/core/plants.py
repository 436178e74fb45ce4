"""The plants that the parameter ``plant_backend`` can name."""

from __future__ import annotations

from ctc_chattering.core.models import locked_positions, model_of
from ctc_chattering.core.plant import Plant, PlantConfig
from ctc_chattering.core.robot import Robot
from ctc_chattering.errors import CtcError


def make_plant(config: PlantConfig, description: str = '') -> Robot:
    """
    Return the robot that `config` describes, at its start.

    Parameters
    ----------
    config : PlantConfig
        Its `plant_backend` chooses.
    description : str
        Text of the MJCF or URDF, where one is needed.

    Raises
    ------
    CtcError
        If there is no description, it does not have the joints, or the backend is not
        installed.

    """
    if config.plant_backend == 'builtin':
        return Plant(config, model_of(config, description))
    if not description:
        raise CtcError(f'plant_backend {config.plant_backend} needs the parameter description, '
                       'or the topic robot_description')
    # Not above: the core does without what is outside of it, and this is needed seldom.
    from ctc_chattering.mujoco_plant import MujocoPlant
    return MujocoPlant(config, description, locked_positions(config.locked))
