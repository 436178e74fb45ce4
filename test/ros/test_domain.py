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

from collections.abc import Sequence
import os
from pathlib import Path
import socket
import subprocess
import sys

from ctc_chattering.errors import CtcError
from ctc_chattering.ros.process import DOMAINS, own_domain
import pytest

NAMES = ('ROS_DOMAIN_ID', 'ROS_AUTOMATIC_DISCOVERY_RANGE')
HOLD = ('import os\nfrom ctc_chattering.ros.process import own_domain\n'
        'with own_domain() as d: print(d, os.environ["ROS_DOMAIN_ID"], flush=True); input()')


def holder() -> subprocess.Popen[str]:
    env = {**os.environ, 'PYTHONPATH': str(Path(__file__).parents[2])}
    return subprocess.Popen([sys.executable, '-c', HOLD], env=env, text=True,
                            stdin=subprocess.PIPE, stdout=subprocess.PIPE)


def said(process: subprocess.Popen[str]) -> int:
    assert process.stdout is not None
    domain, in_environment = process.stdout.readline().split()
    assert domain == in_environment
    return int(domain)


def only(domains: Sequence[int], monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave these domains, which are tried in this order."""
    monkeypatch.setattr('ctc_chattering.ros.process.DOMAINS', domains)
    monkeypatch.setattr('random.sample', lambda found, _: list(found))


def test_two_processes_and_ourselves(monkeypatch: pytest.MonkeyPatch) -> None:
    """What two others hold is passed over, and free once they end, or are killed."""
    with holder() as first, holder() as second:
        taken = [said(first), said(second)]
        with own_domain() as third:
            pass
        assert len({*taken, third} & set(DOMAINS)) == 3
        only([*taken, third], monkeypatch)
        with own_domain() as ours:
            assert ours == third
            with pytest.raises(CtcError) as error, own_domain():
                pass
            assert len(str(error.value).splitlines()) == 1
        first.communicate('\n', timeout=20)
        assert first.returncode == 0
        second.kill()
        second.communicate(timeout=20)
    for domain in taken:
        only([domain], monkeypatch)
        with own_domain() as ours:
            assert ours == domain


@pytest.mark.parametrize('port', [0, 10])
def test_a_domain_in_which_nodes_run(port: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first node of a domain binds these ports, with and without multicast."""
    with own_domain() as domain:
        pass
    only([domain], monkeypatch)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as node:
        node.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        node.bind(('', 7400 + 250 * domain + port))
        with pytest.raises(CtcError), own_domain():
            pass
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


def test_domains_have_their_ports() -> None:
    """Check that no domain's ports, 7400 + 250 d and on, are in the ephemeral range."""
    assert min(DOMAINS) > 0
    assert 7400 + 250 * max(DOMAINS) + 250 <= 32768 + 250
    for domain in DOMAINS:
        assert 7400 + 250 * domain < 32768
