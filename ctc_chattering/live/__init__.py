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
Page of a running graph or of bags in the browser.

`ctc live` makes a `Page`, which `GraphPage` or `BagPage` fills. `write_export` writes one of bags.
"""

import logging
from typing import Any

from ctc_chattering.errors import UsageError


def require_viser() -> Any:
    """
    Return the library that serves the page.

    Raises
    ------
    UsageError
        If it is not installed.

    """
    try:
        import viser
    except ImportError as error:
        raise UsageError(
            f'the page needs viser ({error}). Install it with pip install viser') from None
    # A browser that goes away in the middle of a message is no error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    return viser
