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

"""SROS 2: what ROS would say at length, or not at all, said at once."""

from __future__ import annotations

import os
from pathlib import Path

from ctc_chattering.errors import CtcError


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
