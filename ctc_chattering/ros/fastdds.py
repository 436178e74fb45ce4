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

"""How processes talk to each other under Fast DDS, unless the user says otherwise."""

from __future__ import annotations

from contextlib import suppress
import os
from pathlib import Path
import socket

from ctc_chattering.configuration.package_share import config_directory

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
