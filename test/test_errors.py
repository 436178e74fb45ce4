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

"""What is said of a wrong name, and what counts as a wrong command line."""

from __future__ import annotations

from ctc_chattering.errors import as_usage_error, ParameterError, suggest, UsageError
import pytest


@pytest.mark.parametrize(('value', 'said'), [
    ('chatering', '; did you mean chattering?'), ('CHATTERING', '; did you mean chattering?'),
    ('chattering', ''), ('xyz', ''), ('', ''), (6, ''), (None, ''), (['chatering'], '; did you')])
def test_the_nearest_name_is_named(value: object, said: str) -> None:
    assert suggest(value, ('chattering', 'compensation')).startswith(said)
    assert bool(suggest(value, ('chattering', 'compensation'))) == bool(said)


@pytest.mark.parametrize(('name', 'usage'), [
    ('law', True), ('controller: law', True), ('spec.yaml: tune.law', True), ('outlaw', False),
    ('ka', False)])
def test_only_what_stands_on_the_command_line_is_its_fault(name: str, usage: bool) -> None:
    kind = UsageError if usage else ParameterError
    with pytest.raises(kind, match='allowed: that'), as_usage_error(['law', 'switching']):
        raise ParameterError(name, 'this', 'that')
