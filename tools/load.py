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
Run the tests that start ROS processes beside busy loops: a test must pass on a busy machine.

``make test-load``, or with arguments for pytest:
``.venv/bin/python tools/load.py --loops 4 test/nodes/test_nodes.py -k plant``.
"""

from __future__ import annotations

import argparse
import subprocess
import sys

from faults import load


def main() -> int:
    """Return pytest's status."""
    parser = argparse.ArgumentParser(description='All other arguments are for pytest.')
    parser.add_argument('--loops', type=int, default=2, metavar='N',
                        help='busy loops, 2 by default')
    parser.add_argument('--rounds', type=int, default=1, metavar='N',
                        help='how often all is run, once by default; the first failure ends it')
    options, more = parser.parse_known_args()
    for _ in range(options.rounds):
        with load(options.loops):
            status = subprocess.call([
                sys.executable, '-m', 'pytest', '-m', 'ros and not slow', '--numprocesses=auto',
                '--dist=worksteal', '--durations=10', *more])
        if status:
            return status
    return 0


if __name__ == '__main__':
    sys.exit(main())
