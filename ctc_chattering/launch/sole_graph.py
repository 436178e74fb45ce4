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
Check that a graph is alone in a domain and namespace.

`bringup` performs this check before its nodes join.

Two graphs would hear each other's messages. Each topic would have competing publishers, and none
would be obeyed. On this computer the graph holds an abstract Unix socket, which has no file.
The kernel frees it however the process ends, and of two graphs that start at once, one gets it.
Graphs on other computers, and nodes that were started one by one, show in the ROS graph.
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

#: Time to look for other nodes [s]. On a busy computer all were seen after 0.25 s.
_SEARCH_S = 0.5
#: Time that nodes which leave, or were killed, have to disappear [s]. The lease of a process is
#: 2 s by `config/fastdds.xml`.
_DEPARTURE_S = 4.0
#: Time between two looks [s].
_STEP_S = 0.02

_REMEDY = ('stop that one first, or start this one with another ROS_DOMAIN_ID or another '
           'namespace, --ros-args -r __ns:=/NAME')


@contextmanager
def sole_graph(node: Node) -> Iterator[None]:
    """
    Be the only graph in a node's domain and namespace.

    No other node of this graph may have joined yet.

    Raises
    ------
    CtcError
        If there is another one, naming its nodes or its process.

    """
    domain, namespace = node.context.get_domain_id(), node.get_namespace()
    scope = f'ROS_DOMAIN_ID {domain} and namespace {namespace}'
    key = hashlib.sha256(namespace.encode()).hexdigest()[:32]
    address = f'\0ctc_chattering/{domain}/{key}'
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as lock:
        try:
            lock.bind(address)
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            raise CtcError(f'another bringup runs in {scope}: {_holder(address)}; {_REMEDY}'
                           ) from None
        lock.listen()  # So that `_holder` of another graph can connect.
        begin, nodes = time.monotonic(), _other_nodes(node)
        while time.monotonic() - begin < (_DEPARTURE_S if nodes else _SEARCH_S):
            time.sleep(_STEP_S)
            nodes = _other_nodes(node)
        if nodes:
            raise CtcError(f'another graph runs in {scope}: {", ".join(nodes)}; {_REMEDY}')
        yield


def _other_nodes(node: Node) -> list[str]:
    """Return the full names of another graph's nodes."""
    names = [name for name, namespace in node.get_node_names_and_namespaces()
             if namespace == node.get_namespace() and name in (node.get_name(), *LOOP)]
    names.remove(node.get_name())
    return [f'{node.get_namespace().rstrip("/")}/{name}' for name in sorted(names)]


def _holder(address: str) -> str:
    """Return the process that holds a socket, if known."""
    with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.setblocking(False)
        client.connect(address)
        # The peer's credentials: pid, uid and gid.
        pid, _, _ = struct.unpack('3i', client.getsockopt(
            socket.SOL_SOCKET, socket.SO_PEERCRED, struct.calcsize('3i')))
        command = Path(f'/proc/{pid}/cmdline').read_bytes().replace(b'\0', b' ').decode(
            errors='replace')
        return f'process {pid}, {"".join(filter(str.isprintable, command)).strip()}'
    return 'an unknown process'
