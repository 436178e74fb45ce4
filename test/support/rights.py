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

"""The rights of who runs the tests, for what must be started with them."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
import ctypes

_PR_CAPBSET_DROP = 24
_CAP_IPC_LOCK, _CAP_SYS_NICE = 14, 23
#: A thread that still has the rights of who runs the tests, and passes them on to what it starts.
WITH_RIGHTS = ThreadPoolExecutor(1)


def drop_rights() -> None:
    """Have what this thread starts from now on ask for real-time scheduling in vain."""
    WITH_RIGHTS.submit(int).result()  # It takes its rights from us when it begins.
    for capability in (_CAP_IPC_LOCK, _CAP_SYS_NICE):
        ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0)
