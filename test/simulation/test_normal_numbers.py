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

"""The random numbers of compiled runs are those of `random.Random`."""

from random import Random

from ctc_chattering.simulation.compiled_loop import normal_numbers
import numpy as np
import pytest


@pytest.mark.parametrize('drawn', [0, 1, 2, 701])
def test_the_same_normal_numbers_as_python(drawn: int) -> None:
    """From any state on, and of an odd count, the last of which is the first of a pair."""
    random = Random(3)
    for _ in range(drawn):
        random.gauss(0.0, 1.0)
    found = normal_numbers(random, 1001)
    np.testing.assert_allclose(
        found, [random.gauss(0.0, 1.0) for _ in range(1001)], rtol=1e-14)
