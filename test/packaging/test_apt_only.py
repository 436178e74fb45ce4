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

"""What works where only what apt has is installed: no rosbags, mcap, zstandard, lz4."""

from __future__ import annotations

from pathlib import Path
import pickle
import subprocess
import sys

from bags import entries, Entry, serialized, write_bag
from ctc_chattering.analysis.result import simulate
from ctc_chattering.configuration import parameter_file

#: Records a run, reads it back, and reads a bag that is compressed.
SCRIPT = """
import sys
for name in ('rosbags', 'mcap', 'zstandard', 'lz4', 'lz4.frame'):
    sys.modules[name] = None
from pathlib import Path
import pickle
from ctc_chattering import CtcError
from ctc_chattering.bags.reader import read_bag
from ctc_chattering.bags.repair import repair
from ctc_chattering.bags.writer import BagWriter
import ctc_chattering.bags.player, ctc_chattering.cli.ctc, ctc_chattering.nodes.recorder
messages, tau = pickle.loads(Path('run').read_bytes())
recording = BagWriter(Path('own'))
for message in messages:
    recording.write(*message, '')
recording.close()
assert read_bag('own').run.tau.tobytes() == tau
Path('own/metadata.yaml').unlink()
assert read_bag('own').run.tau.tobytes() == tau
for read in (read_bag, repair):
    try:
        read(Path('compressed'))
    except CtcError as error:
        print(error)
"""


def test_recording_and_reading_without_packages_of_pip(tmp_path: Path) -> None:
    setup = parameter_file.load(None, {'plant': {'duration': 0.05}})
    result = simulate(setup)
    messages = [tuple(x._replace(message=serialized(x.message)))
                for x in entries(result, setup.plant)]
    write_bag(tmp_path / 'compressed', [Entry(*x) for x in messages])
    (tmp_path / 'run').write_bytes(pickle.dumps((messages, result.run.tau.tobytes())))
    done = subprocess.run(
        [sys.executable, '-c', SCRIPT], cwd=tmp_path, text=True, capture_output=True, timeout=120,
        check=False)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert lines[0] == (
        'compressed: it is compressed by zstd, and zstandard is not installed: "pip install '
        'zstandard" or "sudo apt install python3-zstandard"')
    assert len(lines) == 2 and 'zstandard is not installed' in lines[1]
    assert b'zstd' not in (tmp_path / 'own' / 'own_0.mcap').read_bytes()
    assert (tmp_path / 'compressed' / 'metadata.yaml').exists()
