"""What is freed is given back, and would not be."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

PROGRAM = """
from pathlib import Path
import resource
from ctc_chattering.memory import give_back

def resident():
    return int(Path('/proc/self/statm').read_text().split()[1]) * resource.getpagesize()

{call}
bytearray(1 << 24)
before = resident()
blocks = [bytearray(1 << 20) for _ in range(16)]
blocks.clear()
print(resident() - before)
"""


@pytest.mark.skipif(platform.libc_ver()[0] != 'glibc', reason='a setting of glibc')
@pytest.mark.parametrize('call', ['give_back()', ''])
def test_freed_blocks_are_given_back(call: str) -> None:
    kept = int(subprocess.check_output([sys.executable, '-c', PROGRAM.format(call=call)]))
    assert kept < 1 << 20 if call else kept > 1 << 23
