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

"""Words for what is wrong with a model."""

from __future__ import annotations

from ctc_chattering.identification.model_verdict import zero_in_words
import numpy as np
import pytest


@pytest.mark.parametrize(('shift', 'degrees'), [
    ((0.0, 0.0131, 0.0003), '3'), ((0.01, 0.0, 0.0), ''), ((0.0, 0.0, 0.0), '')])
def test_a_wrong_zero_looks_like_a_centre_that_is_turned(shift: tuple[float, ...], degrees: str
                                                         ) -> None:
    words = zero_in_words(np.array((0.25, 0.0, 0.0)), shift)
    assert words.startswith(f'; a zero of this joint that is off by {degrees} degrees'
                            if degrees else '') and bool(words) == bool(degrees)
