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


"""What a run of the closed loop needs: plant, controller and reference that agree."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from typing import Any

from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.errors import CtcError, prefixed
from ctc_chattering.simulation.closed_loop import Event
from ctc_chattering.simulation.plant import check_start
from ctc_chattering.simulation.plant_config import PlantConfig
from ctc_chattering.trajectory.joint_limits import continuous_joints, read_limits
from ctc_chattering.trajectory.reference import make_motion, ReferenceConfig
from ctc_chattering.trajectory.waypoints import Route

Values = dict[str, Any]
#: Values by node and parameter that override those of a file; node ``/**`` for all nodes.
Overrides = Mapping[str, Mapping[str, Any]]
#: Parameters of the plant that say where it starts, and of the reference that change no motion.
_STARTS, _TIMING = {'initial_position', 'initial_velocity'}, {'control_period'}


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    A closed loop: the checked contents of a parameter file, or three configurations.

    Attributes
    ----------
    plant : PlantConfig
        The robot, its friction, drives and sensors, and the duration of the run.
    controller : ControllerConfig
        Law and gains.
    reference : ReferenceConfig
        Desired motion.
    events : sequence of Event
        Parameters that change during the run, in the order of time.
    values : mapping
        Every parameter's value, by executable and parameter; empty without a file.
    route : Route or None
        Contents of the reference's `trajectory_file`, in the order of its joints.
    descriptions : mapping
        Text of the robot's description by node, for those that need one and name a file.

    Raises
    ------
    CtcError
        If values of the three contradict each other.

    Examples
    --------
    >>> from ctc_chattering import ControllerConfig, PlantConfig, ReferenceConfig, Setup
    >>> Setup(PlantConfig(duration=6.0), ControllerConfig(law='integral'), ReferenceConfig()
    ...       ).changed({'controller': {'ki': 50.0}}).controller.ki
    (50.0, 50.0)

    """

    plant: PlantConfig
    controller: ControllerConfig
    reference: ReferenceConfig
    events: Sequence[Event] = ()
    values: Mapping[str, Values] = dataclasses.field(default_factory=dict)
    route: Route | None = None
    descriptions: Mapping[str, str] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse values that contradict each other."""
        shared = [(name, 'controller', 'plant') for name in (
            'joint_names', 'gravity', 'model', 'locked', 'continuous_joints', 'control_period')]
        for name, one, other in (*shared, ('control_period', 'reference', 'plant'),
                                 ('joint_names', 'reference', 'controller'),
                                 ('continuous_joints', 'reference', 'controller')):
            mine, theirs = (getattr(getattr(self, node), name) for node in (one, other))
            more = one == 'reference' and name != 'control_period'  # It may have joints more.
            if not (set(theirs) <= set(mine) if more else mine == theirs):
                raise CtcError(f'{name}: {mine} of {one} contradicts {theirs} of {other}; put '
                               'what nodes share under /**')

    @property
    def continuous(self) -> tuple[bool, ...]:
        """Mask of the reference's joints that turn endlessly, shape (n,)."""
        description = self.descriptions.get('reference', '')
        names = self.reference.joint_names
        limits = read_limits(description, names) if description else None
        return continuous_joints(self.reference, limits)

    def changed(self, values: Overrides) -> Setup:
        """
        Return the setup with other values of some parameters, checked like those of a file.

        Parameters
        ----------
        values : mapping
            New values by node, one of ``plant``, ``controller`` and ``reference``, and parameter.
            Files are not read again: no parameter which names one may change, nor the joints.

        Raises
        ------
        CtcError
            If a value is not allowed, or contradicts another.

        """
        configs: dict[str, Any] = {}
        for node, mine in values.items():
            with prefixed(f'{node}: '):
                configs[node] = getattr(self, node).changed(mine)
        resolved = {node: {**self.values.get(node, {}), **config.as_mapping()}
                    for node, config in configs.items()}
        found = dataclasses.replace(self, **configs, values={**self.values, **resolved})
        if _STARTS & set(values.get('plant', ())) or set(values.get('reference', ())) - _TIMING:
            check_motion(found)
        return found


def check_motion(setup: Setup) -> None:
    """Raise `CtcError` if the motion, or its start, is beyond the limits of a URDF."""
    plant, reference = setup.plant, setup.reference
    check_start(plant, setup.descriptions.get('plant', ''))
    if description := setup.descriptions.get('reference', ''):
        start = dict(zip(plant.joint_names, zip(plant.initial_position, plant.initial_velocity)))
        make_motion(reference, setup.route, start,
                    limits=read_limits(description, reference.joint_names))
