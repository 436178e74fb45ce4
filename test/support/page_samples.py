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

"""Samples of a page, read as its script reads them."""

from __future__ import annotations

import base64
import json
from pathlib import Path
import re
from typing import Any
import zlib

import numpy as np


def columns(path: Path) -> dict[tuple[str, Any], Any]:
    """
    Return the columns of a file by signal and joint.

    Times are at ``('t', signal)``, and those of the first signals at ``('t', 0)``.
    """
    found = re.fullmatch(r'ctcSamples\["([\w.-]+)"\] = (\[.*\]);\n', path.read_text())
    assert found is not None and found[1] == path.stem
    result: dict[tuple[str, Any], Any] = {}
    for text in json.loads(found[2]):
        data = base64.b64decode(text)
        size = int.from_bytes(data[:4], 'little')
        head = json.loads(data[4:4 + size])
        planes, count = zlib.decompress(data[-(-(4 + size) // 8) * 8:]), head['count']
        track = {}
        for name, joint, width in head['columns']:
            mine, planes = planes[:width * count], planes[width * count:]
            bits = np.frombuffer(mine, np.uint8).reshape(width, count).T.copy().view(
                f'<u{width}')[:, 0]
            values = bits.cumsum(dtype=bits.dtype).cumsum(dtype=bits.dtype)
            track[name, joint] = values.view(f'<f{width}')
        assert not planes
        for name, _ in list(track):
            track['t', name] = track['t', 0]
        result = {**track, **result}
    return result
