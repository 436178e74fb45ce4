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

"""The rows of the regression."""

from __future__ import annotations

import tracemalloc

from ctc_chattering.bags.recording import Stretch
from ctc_chattering.dynamics.registry import make_model
from ctc_chattering.identification.model_errors import ErrorColumns
from ctc_chattering.identification.weak_form import TestFunction
from ctc_chattering.identification.windows import Rows
import numpy as np
from urdfs import TWO_LINKS, two_links

H = 1e-3


def test_windows_are_evaluated_in_blocks() -> None:
    """All windows at once would need 70 MB for this, and more with every second."""
    count = 12_000
    t = H * np.arange(count)
    q = np.stack((np.sin(2.0 * t), np.cos(3.0 * t)), axis=1)
    model, phi = make_model('urdf', 9.81, TWO_LINKS, two_links()), TestFunction(H, H * count)
    tracemalloc.start()
    Rows.of(Stretch(0.0, H, q, None, q), model, phi, ErrorColumns.of(model))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30e6
