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

# The public names and the modules that define them: type checkers read it, and `__init__.py`.
from ctc_chattering.analysis.export import export as export
from ctc_chattering.analysis.result import Result as Result
from ctc_chattering.analysis.result import simulate as simulate
from ctc_chattering.analysis.run_figures import save_figures as save_figures
from ctc_chattering.analysis.run_page import write_runs as write_runs
from ctc_chattering.bags.reader import read_bag as read_bag
from ctc_chattering.bags.repair import repair as repair
from ctc_chattering.bags.replay import replay as replay
from ctc_chattering.compiled.compilable import dot as dot
from ctc_chattering.compiled.compilable import record as record
from ctc_chattering.configuration.compilation import compile_setup as compile_setup
from ctc_chattering.configuration.loop_setup import Setup as Setup
from ctc_chattering.configuration.parameter_file import load_parameters as load_parameters
from ctc_chattering.control.controller import Controller as Controller
from ctc_chattering.control.controller import ControllerConfig as ControllerConfig
from ctc_chattering.control.controller import Sample as Sample
from ctc_chattering.control.laws.base import law as law
from ctc_chattering.control.laws.base import laws as laws
from ctc_chattering.control.recommended_gains import PoleRule as PoleRule
from ctc_chattering.control.sample import Applied as Applied
from ctc_chattering.control.sample import State as State
from ctc_chattering.control.sample import Terms as Terms
from ctc_chattering.control.switching import switching as switching
from ctc_chattering.dynamics.model import Model as Model
from ctc_chattering.dynamics.model_check import check_dynamics as check_dynamics
from ctc_chattering.dynamics.two_link import TwoLink as TwoLink
from ctc_chattering.dynamics.urdf_model import UrdfModel as UrdfModel
from ctc_chattering.errors import CtcError as CtcError
from ctc_chattering.identification.bag_motion import read_motion as read_motion
from ctc_chattering.identification.excite import excite as excite
from ctc_chattering.identification.excite import write_excitation as write_excitation
from ctc_chattering.identification.identified_robot import IdentifiedRobot as IdentifiedRobot
from ctc_chattering.identification.identified_robot import identify as identify
from ctc_chattering.identification.identified_robot import write_identified as write_identified
from ctc_chattering.identification.recording import RecordedMotion as RecordedMotion
from ctc_chattering.identification.recording import Recording as Recording
from ctc_chattering.runs.compare import compare as compare
from ctc_chattering.runs.map import compute_map as compute_map
from ctc_chattering.runs.reproduction import reproduce as reproduce
from ctc_chattering.runs.stability import stability as stability
from ctc_chattering.runs.tune import tune as tune
from ctc_chattering.runs.tune_page import write_tuning as write_tuning
from ctc_chattering.simulation.closed_loop import Event as Event
from ctc_chattering.simulation.closed_loop import Run as Run
from ctc_chattering.simulation.plant import Plant as Plant
from ctc_chattering.simulation.plant_config import PlantConfig as PlantConfig
from ctc_chattering.trajectory.reference import ReferenceConfig as ReferenceConfig
from ctc_chattering.trajectory.reference import Sinusoid as Sinusoid
from ctc_chattering.trajectory.waypoints import Waypoints as Waypoints

__all__: list[str]
__version__: str
