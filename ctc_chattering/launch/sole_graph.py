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

"""
One graph in a domain and namespace.

Of two, each would publish what the other one reads, and no publisher be obeyed. On this computer
a socket without a file tells, which the kernel frees when the process ends, however that ends;
of two that start at once, one gets it. Other computers, and nodes that were started one by one,
show in the ROS graph.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import errno
import hashlib
from pathlib import Path
import socket
import struct
import time

from ctc_chattering.configuration.node_parameters import LOOP
from ctc_chattering.errors import CtcError
from rclpy.node import Node

#: Time for which other nodes are looked for [s]: on a busy computer all were seen after 0.25 s.
LOOK = 0.5
#: Time in which those that leave, or were killed, must have gone [s]: the lease of a process is
#: 2 s by `config/fastdds.xml`.
DEPARTURE = 4.0
_STEP = 0.02


@contextmanager
def sole_graph(node: Node) -> Iterator[None]:
    """
    Be the only graph in the domain and namespace of `node`, until the context ends.

    No other node of this graph may have joined yet.

    Raises
    ------
    CtcError
        If there is another one; it is named.

    """
    domain = node.context.get_domain_id()
    where = f'ROS_DOMAIN_ID {domain} and namespace {node.get_namespace()}'
    with _held(domain, node.get_namespace(), where):
        begin, others = time.monotonic(), other_nodes(node)
        while time.monotonic() - begin < (DEPARTURE if others else LOOK):
            time.sleep(_STEP)
            others = other_nodes(node)
        if others:
            raise CtcError(f'another graph runs in {where}: {", ".join(others)}; {_CURE}')
        yield


_CURE = ('stop that one first, or start this one with another ROS_DOMAIN_ID or another namespace, '
         '--ros-args -r __ns:=/NAME')


def other_nodes(node: Node) -> list[str]:
    """Return the full names of nodes that only one graph has, besides that of `node`."""
    names = [name for name, namespace in node.get_node_names_and_namespaces()
             if namespace == node.get_namespace() and name in (node.get_name(), *LOOP)]
    names.remove(node.get_name())
    return [f'{node.get_namespace().rstrip("/")}/{name}' for name in sorted(names)]


@contextmanager
def _held(domain: int, namespace: str, where: str) -> Iterator[None]:
    """Hold the socket of a domain and namespace on this computer."""
    key = hashlib.sha256(namespace.encode()).hexdigest()[:32]
    address = f'\0ctc_chattering/{domain}/{key}'
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as held:
        try:
            held.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            raise CtcError(f'another bringup runs in {where}: {_holder(address)}; {_CURE}'
                           ) from None
        held.listen()
        yield


def _holder(address: str) -> str:
    """Return which process holds a socket, as far as that is known."""
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as asking:
        asking.setblocking(False)
        asking.connect(address)
        pid, _, _ = struct.unpack('3i', asking.getsockopt(
            socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize('3i')))
        command = Path(f'/proc/{pid}/cmdline').read_bytes().replace(b'\0', b' ').decode(
            errors='replace')
        return f'process {pid}, {"".join(filter(str.isprintable, command)).strip()}'
    return 'a process of which nothing is known'
