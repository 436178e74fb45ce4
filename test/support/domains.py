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

"""A ROS domain that nothing else on this host uses."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import os
import random
import socket

#: Domains whose ports are below those that Linux hands out to clients.
DOMAINS = range(1, 102)
#: UDP ports of domain d are those from `_PORTS` + `_EACH` d on.
_PORTS = 7400
_EACH = 250
#: Nodes take the first port of a domain, for multicast, and two each from the tenth on.
_OF_NODES = (0, 10)
#: The holder of a domain takes this one.
_HELD = 2


@contextmanager
def own_domain() -> Iterator[int]:
    """
    Hold a domain that nothing else on this host uses, confined to this host.

    It is held by a port that is bound: the kernel knows it from all users, leaves nothing behind,
    and frees it when the process ends, however that ends. ``ROS_DOMAIN_ID`` and
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` are set meanwhile; afterwards the environment is as before.

    """
    with ExitStack() as held:
        domain = next(x for x in random.sample(DOMAINS, len(DOMAINS)) if _hold(held, x))
        before = dict(os.environ)
        os.environ.update(ROS_DOMAIN_ID=str(domain), ROS_AUTOMATIC_DISCOVERY_RANGE='LOCALHOST')
        try:
            yield domain
        finally:
            os.environ.clear()
            os.environ.update(before)


def _hold(held: ExitStack, domain: int) -> bool:
    """Hold a domain until `held` is closed; return whether it was free."""
    with ExitStack() as bound:
        for port in (*_OF_NODES, _HELD):
            it = bound.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            try:
                it.bind(('', _PORTS + _EACH * domain + port))
            except OSError:
                return False
        held.enter_context(it.dup())
    return True
