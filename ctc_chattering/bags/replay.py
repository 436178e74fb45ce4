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

"""Recorded messages, published again."""

from __future__ import annotations

from contextlib import closing
from numbers import Real
from pathlib import Path

from ctc_chattering.arguments import checked
from ctc_chattering.bags.repair import open_bag
from ctc_chattering.errors import ParameterError


@checked(bag=(str, Path), rate=Real, delay=Real)
def replay(bag: str | Path, rate: float = 1.0, delay: float = 1.0) -> int:
    """
    Publish all messages of a bag with their timing over ROS, and the clock.

    Parameters
    ----------
    bag : str or Path
        Directory of a bag of any recorder. Topics whose message types are not installed are left
        out.
    rate : float
        Seconds of the bag per second.
    delay : float
        Time for subscribers to find the publishers [s].

    Returns
    -------
    int
        Number of messages published, without those of a clock that the bag does not contain.
        SIGINT and SIGTERM end it early.

    Raises
    ------
    CtcError
        If an argument is not allowed, there is no bag, or it cannot be read.
    ModuleNotFoundError
        Without ROS.

    """
    if not rate > 0.0:
        raise ParameterError('rate', rate, 'a number > 0')
    if not delay >= 0.0:
        raise ParameterError('delay', delay, 'a number >= 0')
    with closing(open_bag(Path(bag))) as reader:
        from ctc_chattering.bags.player import play
        return play(reader, rate, delay)
