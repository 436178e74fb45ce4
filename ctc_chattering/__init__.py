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
Computed torque plus compensation plus chattering, for robot arms with friction.

The closed loop without ROS, ten seconds of the paper's two-link arm:

>>> from ctc_chattering import (
...     ControllerConfig, metrics, PlantConfig, ReferenceConfig, simulate)
>>> plant = PlantConfig(duration=10.0)
>>> reference = ReferenceConfig()
>>> for law in ('compensation', 'chattering'):
...     run = simulate(plant, ControllerConfig(law=law), reference)
...     e1, e2 = metrics(run)['rms_error_rad']
...     print(f'{law}: {e1:.1e} {e2:.1e} rad')
compensation: 2.9e-03 4.6e-02 rad
chattering: 4.6e-05 4.9e-04 rad

From a parameter file, a path or one of the package's own, with its events; ``read_bag('path')``
returns such a result, too:

>>> from ctc_chattering import load_parameters, simulated
>>> setup = load_parameters('friction', {'plant': {'duration': 6.0}})
>>> setup.controller.law
'chattering'
>>> result = simulated(setup)
>>> print(', '.join(f'{x:.1e}' for x in result.metrics()['rms_error_rad']))
6.6e-05, 5.0e-04

Another arm derives from `Model` and is given to `simulate`, or named in a parameter file as
``model: package.module:Class``. The nodes are in `ctc_chattering.nodes`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TYPE_CHECKING

# flake8: noqa: F401
if TYPE_CHECKING:
    from ctc_chattering.analysis.metrics import metrics as metrics
    from ctc_chattering.analysis.result import Result as Result
    from ctc_chattering.analysis.result import simulated as simulated
    from ctc_chattering.bags.reader import read_bag as read_bag
    from ctc_chattering.configuration.loading import load_parameters as load_parameters
    from ctc_chattering.configuration.parameter_file import Setup as Setup
    from ctc_chattering.control.controller import Controller as Controller
    from ctc_chattering.control.controller import ControllerConfig as ControllerConfig
    from ctc_chattering.control.controller import Sample as Sample
    from ctc_chattering.dynamics.model import Model as Model
    from ctc_chattering.dynamics.two_link import TwoLink as TwoLink
    from ctc_chattering.dynamics.urdf_model import UrdfModel as UrdfModel
    from ctc_chattering.errors import CtcError as CtcError
    from ctc_chattering.simulation.closed_loop import Event as Event
    from ctc_chattering.simulation.closed_loop import Run as Run
    from ctc_chattering.simulation.closed_loop import simulate as simulate
    from ctc_chattering.simulation.plant import Plant as Plant
    from ctc_chattering.simulation.plant_config import PlantConfig as PlantConfig
    from ctc_chattering.trajectory.reference import ReferenceConfig as ReferenceConfig
    from ctc_chattering.trajectory.reference import Sinusoid as Sinusoid
    from ctc_chattering.trajectory.waypoints import Waypoints as Waypoints

__version__ = '1.0.0'

#: The public names by the modules that define them. They are imported when they are first used: a
#: node handles signals before it imports numpy.
_MODULES = {
    'analysis.metrics': ('metrics',), 'analysis.result': ('Result', 'simulated'),
    'bags.reader': ('read_bag',), 'control.controller': (
        'Controller', 'ControllerConfig', 'Sample'),
    'dynamics.model': ('Model',), 'dynamics.two_link': ('TwoLink',),
    'dynamics.urdf_model': ('UrdfModel',), 'errors': ('CtcError',),
    'configuration.loading': ('load_parameters',), 'configuration.parameter_file': ('Setup',),
    'simulation.closed_loop': ('Event', 'Run', 'simulate'),
    'simulation.plant': ('Plant',), 'simulation.plant_config': ('PlantConfig',),
    'trajectory.reference': ('ReferenceConfig', 'Sinusoid'),
    'trajectory.waypoints': ('Waypoints',)}
_PUBLIC = {name: module for module, names in _MODULES.items() for name in names}

__all__ = ['__version__', *sorted(_PUBLIC)]


def __getattr__(name: str) -> Any:
    """Return a public name of the package."""
    if name not in _PUBLIC:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_PUBLIC[name]}'), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return __all__
