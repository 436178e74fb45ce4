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

"""Laws for tests of `ctc export-c`, and the system's C compiler."""

from __future__ import annotations

from pathlib import Path
import shutil
import subprocess
from typing import Any, NamedTuple

from ctc_chattering.configuration.package_share import find_config
from ctc_chattering.configuration.parameter_file import load
from ctc_chattering.control.controller import Controller
from ctc_chattering.control.controller_config import ControllerConfig
from ctc_chattering.control.laws.registry import SWITCHINGS
from ctc_chattering.dynamics.model import Model
from ctc_chattering.dynamics.registry import model_of
from machine_code import compile_step

FLAGS = ('-O2', '-std=c11', '-Wall', '-Wextra', '-Wpedantic', '-Werror')


class Robot(NamedTuple):
    """Arguments of `export`: a law with its gains, and the robot."""

    config: ControllerConfig
    model: Model


def robot_of(file: str, law: str, **values: Any) -> Robot:
    """Return a robot under a law, or under law (6) with a switching."""
    named = {'law': 'chattering', 'switching': law} if law in SWITCHINGS else {'law': law}
    setup = load(find_config(file), {'controller': {**named, **values}})
    return Robot(setup.controller, model_of(
        setup.controller, setup.descriptions.get('controller', '')))


def compiled_by_cc(library: Path, *arguments: str) -> Path:
    """Return what the system's C compiler makes of a library."""
    assert shutil.which('cc'), 'these tests need a C compiler: apt-get install gcc libc6-dev'
    out = library / 'made'
    subprocess.run(['cc', *FLAGS, *arguments, 'ctc_law.c', 'ctc_law_code.o', '-lm', '-o', out],
                   cwd=library, check=True)
    return out


def controller_of(robot: Robot) -> Controller:
    controller = Controller(robot.config, robot.model)
    compile_step(controller)
    assert controller.compiled
    return controller


def watched() -> Robot:
    """Return law (6) with an observer and an error limit."""
    return robot_of('friction', 'implicit_observer', error_limit=[0.5, 0.5])
