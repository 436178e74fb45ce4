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

"""An arm of one's own that cannot move: in a module, so that other processes find it."""

from __future__ import annotations

from collections.abc import Sequence

from ctc_chattering.dynamics.two_link import TwoLink
from ctc_chattering.numerics.linear_algebra import Array


class Broken(TwoLink):
    """The paper's arm; asked by the plant for its M and its bias it raises `error`."""

    error: type[Exception] = MemoryError

    def __init__(self, joint_names: Sequence[str], gravity: float) -> None:
        del joint_names
        super().__init__(gravity)

    def mass_and_bias(self, *_: object) -> tuple[Array, Array]:
        raise self.error('no more')
