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

"""Pipes in the place of a bag, or of a file in it, are not waited for."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_commands import ctc, refused
import pytest


@pytest.mark.parametrize('command', [
    'plot', 'export', 'replay', 'repair', 'identify', 'learn', 'live --export page.html'])
@pytest.mark.parametrize('file', ['bag/metadata.yaml', 'bag/bag_0.mcap', 'pipe.mcap', 'pipe'])
def test_a_pipe_is_refused_in_one_line(command: str, file: str, tmp_path: Path) -> None:
    path = tmp_path / file
    path.parent.mkdir(exist_ok=True)
    os.mkfifo(path)
    bag = path.parent if path.parent != tmp_path else path
    refused(ctc(*command.split(), bag, cwd=tmp_path),
            f'{path}: is a pipe; a regular file is needed')
