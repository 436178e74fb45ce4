"""Compiled functions that the loop is not made of alone, without the time of their compilation."""

import os
from pathlib import Path
import subprocess
import sys

FOLDER = Path(__file__).parent


def test_dynamics_and_nearest_point_as_plain_python() -> None:
    """Run the tests of the slow suite that compile for arrays of their own, not compiled."""
    files = [FOLDER / 'test_dynamics.py', FOLDER / 'test_compiled_box_qp.py']
    result = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-m', 'slow',
         *map(str, files)], cwd=FOLDER.parents[1], text=True, capture_output=True,
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1'})
    assert result.returncode == 0, result.stdout + result.stderr
    assert '10 passed' in result.stdout
