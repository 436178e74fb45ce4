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

"""What is in a file of a bag."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import NamedTuple

from ctc_chattering.bags.qos import Profiles

#: Topic and type; with log time [ns] and data of a message.
Key = tuple[str, str]
Message = tuple[Key, int, bytes]


class Connection(NamedTuple):
    """
    The messages of a topic.

    Attributes
    ----------
    topic, msgtype : str
        Name and type.
    msgcount : int
        Number of messages.
    encoding, definition : str
        Definition of the type, both empty without one.
    qos : tuple of dict
        Profiles that the publishers offered.
    serialization : str
        Format of the messages.

    """

    topic: str
    msgtype: str
    msgcount: int
    encoding: str = ''
    definition: str = ''
    qos: Profiles = ()
    serialization: str = 'cdr'

    @property
    def key(self) -> Key:
        """Return topic and type."""
        return self.topic, self.msgtype


class Storage(ABC):
    """
    One file, open.

    Parameters
    ----------
    path : Path
        Where it is.

    """

    #: What is in it.
    connections: list[Connection]
    #: First and last log time [ns]; None without messages.
    span: tuple[int, int] | None

    @abstractmethod
    def __init__(self, path: Path) -> None:
        """Open a file."""

    @abstractmethod
    def messages(self, keys: Collection[Key]) -> Iterator[Message]:
        """Yield topic and type, log time [ns] and data of some topics, in the order of time."""

    @abstractmethod
    def close(self) -> None:
        """Close the file."""
