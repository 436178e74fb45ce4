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

"""Exclusive ROS domains, so that concurrent runs do not exchange messages."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import os
from pathlib import Path
import random
import tempfile

from ctc_chattering.errors import CtcError

#: Domains whose ports are below those that Linux hands out to clients.
DOMAINS = range(1, 102)


@contextmanager
def own_domain() -> Iterator[int]:
    """
    Hold a domain that no other process on this host holds, confined to this host.

    ``ROS_DOMAIN_ID`` and ``ROS_AUTOMATIC_DISCOVERY_RANGE`` are set meanwhile.

    Raises
    ------
    CtcError
        If all of them are held.

    """
    names = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
    before = {name: os.environ[name] for name in names if name in os.environ}
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        path = Path(tempfile.gettempdir()) / f'ctc_chattering_domain_{domain}.lock'
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError:  # Another user's.
            continue
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            continue
        try:
            os.environ.update(dict(zip(names, (str(domain), 'LOCALHOST'))))
            yield domain
        finally:
            for name in names:
                os.environ.pop(name, None)
            os.environ.update(before)
            os.close(descriptor)
        return
    raise CtcError('every ROS domain from 1 to 101 is in use on this host')
