"""Compiled functions that the loop is not made of alone, without the time of their compilation."""

import os
from pathlib import Path
import subprocess
import sys

FOLDER = Path(__file__).parent


def test_dynamics_as_plain_python() -> None:
    """Run the tests of the slow suite that compile for arrays of their own, not compiled."""
    result = subprocess.run(
        [sys.executable, '-m', 'pytest', '-q', '-p', 'no:cacheprovider', '-m', 'slow',
         str(FOLDER / 'test_dynamics.py')], cwd=FOLDER.parents[1], text=True, capture_output=True,
        env={**os.environ, 'NUMBA_DISABLE_JIT': '1'})
    assert result.returncode == 0, result.stdout + result.stderr
    assert '7 passed' in result.stdout
