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

"""ROS domains of one's own, held by real processes."""

from __future__ import annotations

import os
from pathlib import Path
import subprocess
import sys
import tempfile

from ctc_chattering.errors import CtcError
from ctc_chattering.ros.domain import DOMAINS, own_domain
import pytest

NAMES = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
HOLD = ('import os\nfrom ctc_chattering.ros.domain import own_domain\n'
        'with own_domain() as d: print(d, os.environ["ROS_DOMAIN_ID"], flush=True); input()')


@pytest.fixture(autouse=True)
def own_locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep the locks away from those of runs on this host."""
    monkeypatch.setenv('TMPDIR', str(tmp_path))
    monkeypatch.setattr(tempfile, 'tempdir', None)


def holder() -> subprocess.Popen[str]:
    env = {**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])}
    return subprocess.Popen([sys.executable, '-c', HOLD], env=env, text=True,
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def said(process: subprocess.Popen[str]) -> int:
    assert process.stdout is not None
    domain, in_environment = process.stdout.readline().split()
    assert domain == in_environment
    return int(domain)


def test_two_processes_and_ourselves(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that all but two domains being held, those two are found, and then none."""
    monkeypatch.setattr('ctc_chattering.ros.domain.DOMAINS', range(1, 4))
    monkeypatch.setattr('random.sample', lambda domains, _: list(domains))
    with holder() as first, holder() as second:
        taken = {said(first), said(second)}
        assert len(taken) == 2
        assert taken <= set(DOMAINS)
        with own_domain() as ours:
            assert ours not in taken
        for process in (first, second):
            process.communicate('\n', timeout=20)
            assert process.returncode == 0


def test_all_held_then_one_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check the error when none is left, and that a killed holder frees its domain."""
    with holder() as process:
        domain = said(process)
        monkeypatch.setattr('ctc_chattering.ros.domain.DOMAINS', range(domain, domain + 1))
        with pytest.raises(CtcError) as error, own_domain():
            pass
        assert len(str(error.value).splitlines()) == 1
        process.kill()
        process.communicate(timeout=20)
    with own_domain() as ours:
        assert ours == domain


@pytest.mark.parametrize('before', [None, '77'])
def test_environment_is_put_back(before: str | None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Check both variables, also when what is done inside fails."""
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
        if before is not None:
            monkeypatch.setenv(name, before)
    with pytest.raises(ZeroDivisionError), own_domain() as domain:
        assert os.environ['ROS_DOMAIN_ID'] == str(domain)
        assert os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] == 'LOCALHOST'
        raise ZeroDivisionError
    assert [os.environ.get(name) for name in NAMES] == [before, before]


def test_lock_is_freed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check that the only domain there is can be had again and again, not twice at once."""
    monkeypatch.setattr('ctc_chattering.ros.domain.DOMAINS', range(5, 6))
    for _ in range(3):
        with own_domain() as domain:
            assert domain == 5
            with pytest.raises(CtcError), own_domain():
                pass


def test_domains_have_their_ports() -> None:
    """Check that no domain's ports, 7400 + 250 d and on, are in the ephemeral range."""
    assert min(DOMAINS) > 0
    assert 7400 + 250 * max(DOMAINS) + 250 <= 32768 + 250
    for domain in DOMAINS:
        assert 7400 + 250 * domain < 32768
