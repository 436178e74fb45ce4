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
Plant, controller and reference with one parameter file, and a recorder if asked, as `bringup`.

What bringup does by itself is not here: ``events`` of the file, which are refused, progress, and
one processor for plant and controller in lockstep.
"""

from pathlib import Path
from shutil import rmtree
from tempfile import mkdtemp

from ctc_chattering.cli.bringup import make_parser
from ctc_chattering.cli.options import load_setup
from ctc_chattering.configuration.parameter_file import dump
from ctc_chattering.launch.graph import node_values
from launch import LaunchDescription
from launch.actions import (
    DeclareLaunchArgument,
    OpaqueFunction,
    RegisterEventHandler,
    SetEnvironmentVariable,
    Shutdown,
)
from launch.event_handlers import OnShutdown
from launch.substitutions import EnvironmentVariable
from launch_ros.actions import Node

#: Options of bringup, with what is said of them; an empty one is not given.
ARGUMENTS = {
    'params_file': 'parameter file, or the name of one of the package, such as panda; friction, '
                   "the paper's first experiment, by default",
    'law': "law, in place of the file's",
    'gains': 'file or recommended; recommended for observer_feedback by default if law names it',
    'switching': "switching of law (6), in place of the file's",
    'control_period': "control period, in place of the file's [s]",
    'duration': "end of the experiment, in place of the file's; 0 for none [s]",
    'pacing': "lockstep or real_time, in place of the file's",
    'record': 'directory to create for a bag; none by default',
}
#: Without it, ROS 2 sends to other computers of the network, too.
RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


def nodes(context):
    """Return a node for each process of the graph; the end of one is the end of all."""
    given = {name: context.launch_configurations[name] for name in ARGUMENTS}
    options = make_parser().parse_args([
        f'--{name.replace("_", "-")}={value}' for name, value in given.items() if value])
    values = node_values(load_setup(options), options.record, with_bringup=False)
    folder = Path(mkdtemp(prefix='ctc_chattering_'))
    file = folder / 'params.yaml'
    dump(values, file)
    removal = OnShutdown(on_shutdown=lambda *_: rmtree(folder, ignore_errors=True))
    return [RegisterEventHandler(removal), *(
        Node(package='ctc_chattering', executable=name, output='screen', parameters=[str(file)],
             on_exit=Shutdown(reason=f'{name} has ended')) for name in values)]


def generate_launch_description():
    """Return what `ros2 launch ctc_chattering bringup.launch.py` runs."""
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value='', description=text)
          for name, text in ARGUMENTS.items()),
        SetEnvironmentVariable(RANGE, EnvironmentVariable(RANGE, default_value='LOCALHOST')),
        OpaqueFunction(function=nodes),
    ])
