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

All that the command ``ctc`` does, for Python. Only `replay` and `reproduce` need ROS. The
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
with changes of parameters during the run, each an `Event`. `simulate` runs it. `read_bag` reads a
recorded run. Both return a `Result`, which has the samples, a `Run`, and the law that ran.
`write_runs` writes a page with plots and numbers, `save_figures` figures alone, `export` samples.
`compile_setup` makes plain Python machine code. `repair` mends a bag, `replay` publishes it over
ROS.

**Laws.** `laws` lists them. A law of your own is a class marked by `law`, its memory one marked by
`record`. `State`, `Terms`, `Applied` and `dot` are for its methods, and `switching` marks a
switching of law (6). The parameter ``law`` takes the class, or ``package.module:Name``. A
`PoleRule` is the rule of its recommended gains.

**Robots.** A `Model` of your own, `TwoLink`, or `UrdfModel`. `check_dynamics` tests one.

**From a recording to gains.** `excite` makes a motion that shows the friction, `write_excitation`
its files. `read_motion` reads a bag of any recorder. Arrays of your own are a `Recording` in a
`RecordedMotion`. `identify` returns an `IdentifiedRobot`, `write_identified` a parameter file.

**Which law, which gains.** `compare` runs all laws, `tune` searches for gains, `compute_map` shows
where laws fail, `stability` which errors a loop stands. `write_tuning` writes tables, figures and
parameter files of a search, the others take a directory. `reproduce` runs the paper's experiments
over ROS.

**Parts.** `Controller` answers a state with a `Sample`, `Plant` takes the torque, `Sinusoid` and
`Waypoints` are motions.

What is wrong raises a `CtcError`, whose text names the argument or parameter, its value and what
is allowed. The nodes are in `ctc_chattering.nodes`.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

__version__ = '1.0.0'
#: Modules that define the public names. `__init__.pyi` has the same table for type checkers.
_MODULES = {
    'export': 'analysis.export',
    'Result': 'analysis.result',
    'simulate': 'analysis.result',
    'save_figures': 'analysis.run_figures',
    'write_runs': 'analysis.run_page',
    'read_bag': 'bags.reader',
    'repair': 'bags.repair',
    'replay': 'bags.replay',
    'dot': 'compiled.compilable',
    'record': 'compiled.compilable',
    'compile_setup': 'configuration.compilation',
    'Setup': 'configuration.loop_setup',
    'load_parameters': 'configuration.parameter_file',
    'Controller': 'control.controller',
    'ControllerConfig': 'control.controller',
    'Sample': 'control.controller',
    'law': 'control.laws.base',
    'laws': 'control.laws.base',
    'PoleRule': 'control.recommended_gains',
    'Applied': 'control.sample',
    'State': 'control.sample',
    'Terms': 'control.sample',
    'switching': 'control.switching',
    'Model': 'dynamics.model',
    'check_dynamics': 'dynamics.model_check',
    'TwoLink': 'dynamics.two_link',
    'UrdfModel': 'dynamics.urdf_model',
    'CtcError': 'errors',
    'read_motion': 'identification.bag_motion',
    'excite': 'identification.excite',
    'write_excitation': 'identification.excite',
    'IdentifiedRobot': 'identification.identified_robot',
    'identify': 'identification.identified_robot',
    'write_identified': 'identification.identified_robot',
    'RecordedMotion': 'identification.recording',
    'Recording': 'identification.recording',
    'compare': 'runs.compare',
    'compute_map': 'runs.map',
    'reproduce': 'runs.reproduction',
    'stability': 'runs.stability',
    'tune': 'runs.tune',
    'write_tuning': 'runs.tune_page',
    'Event': 'simulation.closed_loop',
    'Run': 'simulation.closed_loop',
    'Plant': 'simulation.plant',
    'PlantConfig': 'simulation.plant_config',
    'ReferenceConfig': 'trajectory.reference',
    'Sinusoid': 'trajectory.reference',
    'Waypoints': 'trajectory.waypoints'}


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used."""
    if name == '__all__':
        return ['__version__', *sorted(_MODULES)]
    if name not in _MODULES:
        raise AttributeError(f'module {__name__!r} has no attribute {name!r}')
    return getattr(import_module(f'{__name__}.{_MODULES[name]}'), name)


def __dir__() -> list[str]:
    """Return the public names."""
    return list(__getattr__('__all__'))
