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
from contextlib import contextmanager, ExitStack
import os
import random
import socket

from ctc_chattering.errors import CtcError

#: Domains whose ports are below those that Linux hands out to clients.
DOMAINS = range(1, 102)
#: UDP ports of domain d are those from `_PORTS` + `_EACH` d on. Nodes take the first one, for
#: multicast, and from the tenth on two for each; who holds the domain takes the second.
_PORTS, _EACH = 7400, 250
_OF_NODES, _HELD = (0, 10), 2


@contextmanager
def own_domain() -> Iterator[int]:
    """
    Hold a domain that nothing else on this host uses, confined to this host.

    It is held by a port that is bound: the kernel knows it from all users, leaves nothing behind,
    and frees it when the process ends, however that ends. ``ROS_DOMAIN_ID`` and
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` are set meanwhile.

    Raises
    ------
    CtcError
        If all of them are held.

    """
    names = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
    before = {name: os.environ[name] for name in names if name in os.environ}
    for domain in random.sample(DOMAINS, len(DOMAINS)):
        lock = _lock(domain)
        if lock is None:
            continue
        with lock:
            try:
                os.environ.update(dict(zip(names, (str(domain), 'LOCALHOST'))))
                yield domain
            finally:
                for name in names:
                    os.environ.pop(name, None)
                os.environ.update(before)
        return
    raise CtcError('every ROS domain from 1 to 101 is in use on this host')


def _lock(domain: int) -> socket.socket | None:
    """Return what holds a domain until it is closed; None if the domain is in use."""
    with ExitStack() as bound:
        first, *others = (bound.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                          for _ in range(1 + len(_OF_NODES)))
        try:
            for it, port in zip((first, *others), (_HELD, *_OF_NODES)):
                it.bind(('', _PORTS + _EACH * domain + port))
        except OSError:
            return None
        return socket.socket(fileno=first.detach())
