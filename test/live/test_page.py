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

"""Where the page listens, and what is said when it cannot."""

from __future__ import annotations

import socket
import sys

from ctc_chattering.cli.bringup import main as bringup
from ctc_chattering.errors import CtcError
from ctc_chattering.live.controls import numbers
from ctc_chattering.live.page import free_port, PORT, warning_of
from ctc_commands import ctc, refused
import pytest


def test_takes_the_first_free_port_or_the_one_asked_for() -> None:
    assert PORT <= free_port('127.0.0.1', None) < PORT + 50
    assert free_port('127.0.0.1', 0) > 0
    with socket.socket() as other:
        other.bind(('127.0.0.1', 0))
        other.listen()
        taken = other.getsockname()[1]
        with pytest.raises(CtcError, match=f'port {taken}: Address already in use; --port'):
            free_port('127.0.0.1', taken)


@pytest.mark.parametrize('host', ['192.0.2.1', 'no such host'])
def test_an_address_of_another_machine_is_refused(host: str) -> None:
    with pytest.raises(CtcError, match=host):
        free_port(host, None)


def test_says_who_can_see_the_page() -> None:
    assert warning_of('127.0.0.1') == warning_of('localhost') == ''
    assert 'everyone' in warning_of('0.0.0.0')


def test_without_viser_one_line_says_what_to_install(
        monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setitem(sys.modules, 'viser', None)
    refused(ctc('live'), 'viser', 'pip install viser')
    assert bringup(['--live']) == 2
    assert 'pip install' in capsys.readouterr().err


def test_fields_have_numbers_for_all_joints_or_are_sent_as_they_are() -> None:
    assert numbers('10, 12', 2) == numbers('[10.0 12]', 2) == [10.0, 12.0]
    assert numbers('3', 3) == [3.0, 3.0, 3.0]
    assert numbers('1, 2, 3', 2) == [1.0, 2.0, 3.0]  # The service says that it is too many.
    assert numbers('ten', 2) == 'ten'
    assert numbers('', 2) == ''
