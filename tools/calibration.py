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
Speed of this computer, which belongs beside every time that is reported.

``python tools/calibration.py "make test" BEGIN`` prints the time since BEGIN, in seconds since
1970. The Makefile calls it, and `test/conftest.py` prints `text`.
"""

from __future__ import annotations

import sys
import time


def calibration() -> float:
    """Return the time of ten million ``s += i * i`` [s], from the best of three tenths."""
    return 10.0 * min(_tenth() for _ in range(3))


def _tenth() -> float:
    begin = time.perf_counter()
    s = 0
    for i in range(10 ** 6):
        s += i * i
    return time.perf_counter() - begin


def text() -> str:
    """Return the time of the calibration loop in a sentence."""
    return f'ten million `s += i * i` take {calibration():.2f} s here'


if __name__ == '__main__':
    took, once = time.time() - float(sys.argv[2]), calibration()
    print(f'{sys.argv[1]}: {took:.0f} s, {took / once:.0f} times the {once:.2f} s of ten million '
          '`s += i * i` here')
