"""The plants that the parameter ``plant_backend`` can name."""

from __future__ import annotations

from pathlib import Path

from ctc_chattering.core.plant import Plant, PlantConfig
from ctc_chattering.core.robot import Robot
from ctc_chattering.errors import CtcError, ParameterError


def make_plant(config: PlantConfig, description: str = '') -> Robot:
    """
    Return the robot that `config` describes, at its start.

    Parameters
    ----------
    config : PlantConfig
        Its `plant_backend` chooses.
    description : str
        MJCF or URDF, as XML; empty for the file that the configuration names. The builtin plant
        needs none.

    Raises
    ------
    CtcError
        If there is no description, it cannot be read or does not have the joints, or the
        backend is not installed.

    """
    if config.plant_backend == 'builtin':
        return Plant(config)
    if not description:
        if not config.description:
            raise ParameterError('description', '', 'the path of an MJCF or URDF file')
        try:
            description = Path(config.description).read_text(encoding='utf-8')
        except (OSError, ValueError) as error:
            reason = getattr(error, 'strerror', None) or 'not a text file'
            raise CtcError(f'{config.description}: {reason}') from None
    # Not above: the core does without what is outside of it, and this is needed seldom.
    from ctc_chattering.mujoco_plant import MujocoPlant
    return MujocoPlant(config, description)
