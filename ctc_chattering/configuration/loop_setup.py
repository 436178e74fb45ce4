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
Setup of a closed loop: plant, controller and reference.

`parameter_file.load` makes a `Setup` from a file, and users make one from three configurations.
"""

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
#: Values by node and parameter that override those of a file. Node ``/**`` stands for all nodes.
Overrides = Mapping[str, Mapping[str, Any]]
#: Parameters of the plant at which it starts.
_STARTS = {'initial_position', 'initial_velocity'}
#: Parameters of the reference that change no motion.
_TIMING = {'control_period'}
#: Parameters that controller and plant share.
_SHARED = (
    'joint_names', 'gravity', 'model', 'locked', 'continuous_joints', 'control_period')


@dataclasses.dataclass(frozen=True)
class Setup:
    """
    Setup of a closed loop.

    It is the checked contents of a parameter file, or three configurations that agree.

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
    route : Route or None
        Contents of the reference's `trajectory_file`, in the order of its joints.
    descriptions : mapping
        Text of the robot's description by node, for those that need one and name a file.
    node_only : mapping
        Values, by executable and parameter, that only the nodes need. Empty without a file.

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
    route: Route | None = None
    descriptions: Mapping[str, str] = dataclasses.field(default_factory=dict)
    node_only: Mapping[str, Values] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        """Refuse values that contradict each other."""
        for name in _SHARED:
            self._check(name, 'controller', 'plant')
        self._check('control_period', 'reference', 'plant')
        for name in ('joint_names', 'continuous_joints'):
            self._check(name, 'reference', 'controller', may_have_more=True)

    def _check(self, name: str, node: str, peer: str, may_have_more: bool = False) -> None:
        """Raise `CtcError` if a parameter of two nodes differs."""
        value = getattr(getattr(self, node), name)
        expected = getattr(getattr(self, peer), name)
        agree = set(expected) <= set(value) if may_have_more else value == expected
        if not agree:
            raise CtcError(f'{name}: {value} of {node} contradicts {expected} of {peer}; put '
                           'what nodes share under /**')

    @property
    def values(self) -> dict[str, Values]:
        """Value of every parameter, by executable and parameter."""
        values = {'plant': self.plant.as_mapping(), 'controller': self.controller.as_mapping(),
                  'reference': self.reference.as_mapping()}
        for node, extra in self.node_only.items():
            values[node] = {**values.get(node, {}), **extra}
        return values

    @property
    def continuous(self) -> tuple[bool, ...]:
        """Mask of the reference's endless joints, shape (n,)."""
        description = self.descriptions.get('reference', '')
        names = self.reference.joint_names
        limits = read_limits(description, names) if description else None
        return continuous_joints(self.reference, limits)

    def changed(self, values: Overrides) -> Setup:
        """
        Return a checked setup with other values.

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
        for node, changes in values.items():
            with prefixed(f'{node}: '):
                configs[node] = getattr(self, node).changed(changes)
        setup = dataclasses.replace(self, **configs)
        start_changed = _STARTS & set(values.get('plant', ()))
        motion_changed = set(values.get('reference', ())) - _TIMING
        if start_changed or motion_changed:
            check_motion(setup)
        return setup


def check_motion(setup: Setup) -> None:
    """Raise `CtcError` if motion or start exceed the limits."""
    plant = setup.plant
    reference = setup.reference
    check_start(plant, setup.descriptions.get('plant', ''))
    if description := setup.descriptions.get('reference', ''):
        states = zip(plant.initial_position, plant.initial_velocity)
        make_motion(reference, setup.route, dict(zip(plant.joint_names, states)),
                    limits=read_limits(description, reference.joint_names))
