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

"""The sqlite3 files of bags."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
import sqlite3

from ctc_chattering.bags.qos import profiles
from ctc_chattering.bags.storage import Connection, Key, Message, Storage


class SqliteStorage(Storage):
    """
    A file of sqlite3; definitions of types are in those of ROS 2 Iron and later.

    Raises
    ------
    sqlite3.Error
        If it is none, or not that of a bag.

    """

    def __init__(self, path: Path) -> None:
        # Another process that still writes may not be waited for.
        self._database = sqlite3.connect(f'{path.absolute().as_uri()}?immutable=1', uri=True)
        self._keys: dict[int, Key] = {}
        try:
            self.connections = list(self._connections())
            first, last = self._database.execute(
                'SELECT MIN(timestamp), MAX(timestamp) FROM messages').fetchone()
        except Exception:
            self.close()
            raise
        self.span = None if first is None else (first, last)

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def _columns(self, table: str) -> set[str]:
        return {str(x[1]) for x in self._database.execute(f'PRAGMA table_info({table})')}

    def _connections(self) -> Iterator[Connection]:
        known = {}
        if 'encoded_message_definition' in self._columns('message_definitions'):
            known = {str(name): (str(encoding), str(text)) for name, encoding, text in
                     self._database.execute('SELECT topic_type, encoding, '
                                            'encoded_message_definition FROM message_definitions')}
        qos = 'offered_qos_profiles' if 'offered_qos_profiles' in self._columns('topics') else "''"
        counts = dict(self._database.execute(
            'SELECT topic_id, COUNT(*) FROM messages GROUP BY topic_id'))
        for number, name, kind, serialization, offered in self._database.execute(
                f'SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id'):
            self._keys[number] = name, kind
            yield Connection(name, kind, counts.get(number, 0), *known.get(kind, ('', '')),
                             profiles(offered), serialization)

    def messages(self, keys: Collection[Key]) -> Iterator[Message]:
        """Yield topic and type, log time [ns] and data of some topics, in the order of time."""
        wanted = ', '.join(str(number) for number, key in self._keys.items() if key in keys)
        for number, t, data in self._database.execute(
                'SELECT topic_id, timestamp, data FROM messages '
                f'WHERE topic_id IN ({wanted}) ORDER BY timestamp'):
            yield self._keys[number], t, data
