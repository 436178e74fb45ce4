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

"""A process in the graph: its signals and its end, Fast DDS, SROS 2, a domain of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, ExitStack, suppress
import ctypes
import os
from pathlib import Path
import random
import signal
import socket
import sys
from types import FrameType

from ctc_chattering.configuration.package_share import config_directory
from ctc_chattering.errors import CtcError

#: Signals that ask a process to end: Ctrl-C, kill, a terminal that was closed, and Ctrl-\\.
STOP = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)


def collect_signals() -> list[int]:
    """Take `STOP` from now on; return the list of the signals that have come."""
    caught: list[int] = []

    def on_signal(number: int, _frame: FrameType | None) -> None:
        caught.append(number)

    for number in STOP:
        take_signal(number, on_signal)
    return caught


@contextmanager
def stop_signals() -> Iterator[list[int]]:
    """Collect `STOP` in the list that is yielded, as `collect_signals` does, until the end."""
    before = {number: signal.getsignal(number) for number in STOP}
    try:
        yield collect_signals()
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def take_signal(number: int, handler: Callable[[int, FrameType | None], None]) -> None:
    """Handle a signal, but for a SIGHUP that is ignored: that is what nohup asks for."""
    if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:
        signal.signal(number, handler)


_CLOCK_MONOTONIC, _SIGEV_THREAD = 1, 2


class _SignalEvent(ctypes.Structure):
    """The C library's sigevent, 64 bytes."""

    _fields_ = (('value', ctypes.c_long), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
                ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p),
                ('rest', ctypes.c_char * 32))


def end_after(delay: float, status: int) -> None:
    """
    Have this process end `delay` [s] from now with `status`, whatever it does meanwhile.

    A thread of Python could not: who hangs may hold the interpreter's lock. The numbers are those
    of Linux with 64 bits.
    """
    libc = ctypes.CDLL(None)
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    event = _SignalEvent(value=status, notify=_SIGEV_THREAD,
                         function=ctypes.cast(libc._exit, ctypes.c_void_p))
    timer = ctypes.c_void_p()
    if libc.timer_create(_CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)) == 0:
        times = (ctypes.c_long * 4)(0, 0, int(delay), round(delay % 1.0 * 1e9))
        libc.timer_settime(timer, 0, times, None)


#: The environment variables by which Fast DDS finds a profile, in 2.x and in 3.x.
VARIABLES = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'FASTDDS_DEFAULT_PROFILES_FILE'


def use_profile() -> None:
    """
    Have this process and its children use `config/fastdds.xml`, if they use no other profile.

    To be called before the first node is made.
    """
    if not any(name in os.environ for name in VARIABLES):
        os.environ[VARIABLES[0]] = str(config_directory() / 'fastdds.xml')


def enlarge_receive_buffers(size: int) -> None:
    """
    Have the kernel keep up to `size` bytes for each UDP socket of this process.

    It keeps what comes while the thread that receives has no processor, by default about 200
    messages; then it drops them. More than ``net.core.rmem_max`` takes a privilege. A profile of
    Fast DDS does not reach the sockets that ROS makes for one host only.

    Parameters
    ----------
    size : int
        Bytes, with what the kernel needs of its own: a kilobyte a message.

    """
    for path in Path('/proc/self/fd').glob('*'):
        with suppress(OSError):
            if not path.readlink().name.startswith('socket:'):
                continue
            with socket.socket(fileno=os.dup(int(path.name))) as it:
                buffer = socket.SOL_SOCKET, socket.SO_RCVBUF
                if (it.family in (socket.AF_INET, socket.AF_INET6)
                        and it.type == socket.SOCK_DGRAM and it.getsockopt(*buffer) < size):
                    it.setsockopt(*buffer, size)


def check_security() -> None:
    """
    Refuse to go on where security is enforced and there is no keystore.

    Raises
    ------
    CtcError
        If it is so.

    """
    if (os.environ.get('ROS_SECURITY_ENABLE') != 'true'
            or os.environ.get('ROS_SECURITY_STRATEGY') != 'Enforce'):
        return
    keystore = os.environ.get('ROS_SECURITY_KEYSTORE')
    if not keystore:
        raise CtcError('ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE is not set')
    if not Path(keystore, 'enclaves').is_dir():
        raise CtcError(f'ROS_SECURITY_STRATEGY is Enforce, but ROS_SECURITY_KEYSTORE={keystore} '
                       'is no keystore: it holds no directory enclaves')


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
