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

All that the command ``ctc`` does, for Python; ROS is needed by `replay` and `reproduce` only. The
paper's first experiment under two laws, with the errors in the second half of ten seconds:

>>> from ctc_chattering import load_parameters, simulate
>>> for law in ('compensation', 'chattering'):
...     setup = load_parameters('friction', {'controller': {'law': law}})
...     result = simulate(setup)
...     e1, e2 = result.metrics()['rms_error_rad']
...     print(f'{law}: {e1:.1e} {e2:.1e} rad')
compensation: 2.9e-03 4.6e-02 rad
chattering: 4.6e-05 4.9e-04 rad

The samples are arrays, ``t`` of shape (N,) and all others (N, n):

>>> result.e.shape, result.tau.shape
((10001, 2), (10001, 2))

**Runs.** `load_parameters` reads a parameter file, or one of the package by its name. It returns a
`Setup`, which can also be made of a `PlantConfig`, a `ControllerConfig` and a `ReferenceConfig`,
with changes of parameters during the run, each an `Event`. `simulate` runs it; `read_bag` reads a
recorded run. Both return a `Result`, which has the samples, a `Run`, and the law that ran.
`write_runs` writes a page with plots and numbers, `save_figures` figures alone, `export` samples.
`compile_setup` makes plain Python machine code. `repair` mends a bag, `replay` publishes it over
ROS.

**Laws.** `laws` lists them. A law of your own is a class marked by `law`, its memory one marked by
`record`; `State`, `Terms`, `Applied` and `dot` are for its methods, and `switching` marks a
switching of law (6). The parameter ``law`` takes the class, or ``package.module:Name``.

**Robots.** A `Model` of your own, `TwoLink`, or `UrdfModel`; `check_dynamics` tests one.

**From a recording to gains.** `excite` makes a motion that shows the friction, `write_excitation`
its files. `read_motion` reads a bag of any recorder; arrays of your own are a `Recording` in a
`RecordedMotion`. `identify` returns an `IdentifiedRobot`, `write_identified` a parameter file.

**Which law, which gains.** `compare` runs all laws, `tune` searches for gains, `compute_map` shows
where laws fail, `stability` which errors a loop stands; `write_comparison` and
`write_tuning` write tables, figures and parameter files. `reproduce` runs the paper's experiments
over ROS.

**Parts.** `Controller` answers a state with a `Sample`, `Plant` takes the torque, `Sinusoid` and
`Waypoints` are motions.

What is wrong raises a `CtcError`, whose text names the argument or parameter, its value and what
is allowed. The nodes are in `ctc_chattering.nodes`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any, TYPE_CHECKING

# flake8: noqa: F401
if TYPE_CHECKING:
    from ctc_chattering.analysis.compilation import compile_setup as compile_setup
    from ctc_chattering.analysis.figures import save_figures as save_figures
    from ctc_chattering.analysis.result import export as export
    from ctc_chattering.analysis.result import Result as Result
    from ctc_chattering.analysis.result import simulate as simulate
    from ctc_chattering.analysis.run_page import write_runs as write_runs
    from ctc_chattering.bags.motion import read_motion as read_motion
    from ctc_chattering.bags.reader import read_bag as read_bag
    from ctc_chattering.bags.recording import RecordedMotion as RecordedMotion
    from ctc_chattering.bags.recording import Recording as Recording
    from ctc_chattering.bags.repair import repair as repair
    from ctc_chattering.bags.replay import replay as replay
    from ctc_chattering.compiled.compilable import dot as dot
    from ctc_chattering.compiled.compilable import record as record
    from ctc_chattering.configuration.loading import load_parameters as load_parameters
    from ctc_chattering.configuration.loop_setup import Setup as Setup
    from ctc_chattering.control.controller import Controller as Controller
    from ctc_chattering.control.controller import ControllerConfig as ControllerConfig
    from ctc_chattering.control.controller import Sample as Sample
    from ctc_chattering.control.evaluation import State as State
    from ctc_chattering.control.laws.base import Applied as Applied
    from ctc_chattering.control.laws.base import law as law
    from ctc_chattering.control.laws.base import laws as laws
    from ctc_chattering.control.laws.base import Terms as Terms
    from ctc_chattering.control.switching import switching as switching
    from ctc_chattering.dynamics.model import Model as Model
    from ctc_chattering.dynamics.model_check import check_dynamics as check_dynamics
    from ctc_chattering.dynamics.two_link import TwoLink as TwoLink
    from ctc_chattering.dynamics.urdf_model import UrdfModel as UrdfModel
    from ctc_chattering.errors import CtcError as CtcError
    from ctc_chattering.identification.excite import excite as excite
    from ctc_chattering.identification.excite import write_excitation as write_excitation
    from ctc_chattering.identification.identified_robot import IdentifiedRobot as IdentifiedRobot
    from ctc_chattering.identification.identified_robot import identify as identify
    from ctc_chattering.identification.identified_robot import write_identified as write_identified
    from ctc_chattering.runs.compare import compare as compare
    from ctc_chattering.runs.compare_page import write_comparison as write_comparison
    from ctc_chattering.runs.map import compute_map as compute_map
    from ctc_chattering.runs.reproduction import reproduce as reproduce
    from ctc_chattering.runs.stability import stability as stability
    from ctc_chattering.runs.tune import tune as tune
    from ctc_chattering.runs.tune_page import write_tuning as write_tuning
    from ctc_chattering.simulation.closed_loop import Event as Event
    from ctc_chattering.simulation.closed_loop import Run as Run
    from ctc_chattering.simulation.plant import Plant as Plant
    from ctc_chattering.simulation.plant_config import PlantConfig as PlantConfig
    from ctc_chattering.trajectory.motions import Waypoints as Waypoints
    from ctc_chattering.trajectory.reference import ReferenceConfig as ReferenceConfig
    from ctc_chattering.trajectory.reference import Sinusoid as Sinusoid

__version__ = '1.0.0'

#: The public names by the modules that define them. They are imported when they are first used: a
#: node handles signals before it imports numpy.
_MODULES = {
    'analysis.compilation': ('compile_setup',),
    'analysis.figures': ('save_figures',),
    'analysis.result': ('export', 'Result', 'simulate'),
    'analysis.run_page': ('write_runs',),
    'bags.motion': ('read_motion',),
    'bags.reader': ('read_bag',),
    'bags.recording': ('RecordedMotion', 'Recording'),
    'bags.repair': ('repair',),
    'bags.replay': ('replay',),
    'compiled.compilable': ('dot', 'record'),
    'configuration.loading': ('load_parameters',),
    'configuration.loop_setup': ('Setup',),
    'control.controller': ('Controller', 'ControllerConfig', 'Sample'),
    'control.evaluation': ('State',),
    'control.laws.base': ('Applied', 'law', 'laws', 'Terms'),
    'control.switching': ('switching',),
    'dynamics.model': ('Model',),
    'dynamics.model_check': ('check_dynamics',),
    'dynamics.two_link': ('TwoLink',),
    'dynamics.urdf_model': ('UrdfModel',),
    'errors': ('CtcError',),
    'identification.excite': ('excite', 'write_excitation'),
    'identification.identified_robot': ('IdentifiedRobot', 'identify', 'write_identified'),
    'runs.compare': ('compare',),
    'runs.compare_page': ('write_comparison',),
    'runs.map': ('compute_map',),
    'runs.reproduction': ('reproduce',),
    'runs.stability': ('stability',),
    'runs.tune': ('tune',),
    'runs.tune_page': ('write_tuning',),
    'simulation.closed_loop': ('Event', 'Run'),
    'simulation.plant': ('Plant',),
    'simulation.plant_config': ('PlantConfig',),
    'trajectory.reference': ('ReferenceConfig', 'Sinusoid'),
    'trajectory.motions': ('Waypoints',),
}
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
