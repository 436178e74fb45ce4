"""
Run the tests that start ROS processes beside busy loops: a test must pass on a busy machine.

``make test-load``, or with arguments for pytest:
``.venv/bin/python test/support/load.py --loops 4 test/nodes/test_nodes.py -k plant``.
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
