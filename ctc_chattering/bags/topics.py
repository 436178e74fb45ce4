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

"""The topics of an open bag: messages, parameters and the description of the robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from ctc_chattering.bags.bag import Bag
from ctc_chattering.errors import CtcError
from ctc_chattering.numerics.time_grid import NANOSECONDS
from ctc_chattering.ros.topics import PARAMETERS, ROBOT_DESCRIPTION

#: Field of a ParameterValue that holds the value, by its type.
_FIELDS = {1: 'bool_value', 2: 'integer_value', 3: 'double_value', 4: 'string_value',
           8: 'double_array_value', 9: 'string_array_value'}


class BagTopics:
    """
    The topics of an open bag; without a slash in front, a name stands for it in any namespace.

    Parameters
    ----------
    reader : Bag
        Open.
    path : Path
        What errors say.

    """

    def __init__(self, reader: Bag, path: Path) -> None:
        self._reader, self.path = reader, path

    def messages(self, name: str, option: str = '') -> Iterator[tuple[int, Any]]:
        """
        Yield log time [ns] and message of a topic, without those that cannot be decoded.

        With the `option` that names the topic, it must be one only; else `CtcError` is raised.
        """
        connections = [x for x in self._reader.connections if x.topic == name or (
            not name.startswith('/') and x.topic.endswith('/' + name))]
        topics = {x.topic for x in connections}
        if len(topics) > 1 and option:
            raise CtcError(f'{self.path}: several topics: {", ".join(sorted(topics))}; name one: '
                           f'{option}')
        for connection in connections:
            self._reader.check_type(connection)
        for connection, t, data in self._reader.messages(connections) if connections else ():
            try:
                message = self._reader.deserialize(data, connection.msgtype)
            except Exception:  # Of arbitrary bytes, decoders raise arbitrary exceptions.
                continue
            yield t, message

    def parameters(self, node: str, kind: Any, own: Mapping[str, object]
                   ) -> list[tuple[int, Any]]:
        """
        Return the configurations of a node, each with the time [ns] from which it applies.

        `own` stands in the place of classes that the bag names: `Config.received`.
        """
        known = kind.parameters()
        values: dict[str, Any] = {}
        history: list[tuple[int, Any]] = []
        for _, message in self.messages(f'{node}/{PARAMETERS}'):
            for item in [*message.new_parameters, *message.changed_parameters]:
                if item.name in known and item.value.type in _FIELDS:
                    values[item.name] = getattr(item.value, _FIELDS[item.value.type])
            try:
                config = kind.received(values, own)
            except CtcError as error:
                raise CtcError(f'{self.path}: {error}') from None
            if not history or history[-1][1] != config:
                history.append((nanoseconds(message.stamp), config))
        return history

    def description(self, name: str = f'controller/{ROBOT_DESCRIPTION}') -> str:
        """Return the last robot description on a topic; empty for none."""
        texts = [str(message.data) for _, message in self.messages(name)]
        return texts[-1] if texts else ''


def nanoseconds(time: Any) -> int:
    """Return the time of a message [ns]."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)
