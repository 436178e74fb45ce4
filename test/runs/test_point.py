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

"""Points: the run that a text names, or what is missing in it."""

from __future__ import annotations

from ctc_chattering.errors import UsageError
from ctc_chattering.runs.points import find_run
from map_specs import runs
import pytest

RUNS = runs()


@pytest.mark.parametrize('run', [0, 5, 13, 23])
def test_a_run_by_its_number_and_by_what_its_row_says(run: int) -> None:
    row = RUNS.columns(run)
    text = 'friction={friction},rate={rate}, law={variant} , repeat={repeat}'.format(**row)
    assert find_run(RUNS, str(run)) == find_run(RUNS, text) == run


def test_the_nearest_value_is_taken() -> None:
    assert find_run(RUNS, 'friction=6.9,rate=0.1,law=compensation,repeat=1') == find_run(
        RUNS, 'friction=5,rate=2e-3,law=compensation,repeat=1')


def test_what_has_one_value_may_be_left_out() -> None:
    assert find_run(runs(axes=None, laws=['compensation']), 'repeat=1') == 1


@pytest.mark.parametrize(('text', 'words'), [
    ('24', ['run: 24', '0 to 23']), ('-1', ['POINT', 'a run number, or name=value']),
    ('', ['POINT', 'a run number']), ('friction', ['friction', 'name=value']),
    ('friction=', ['friction=', 'name=value']), ('load=3', ['load', 'friction, rate, law']),
    ('friction=5,law=compensation,repeat=0', ['rate', '0.001, 0.002', 'more than one']),
    ('friction=5,rate=1e-3,repeat=0', ['law', 'compensation, chattering implicit']),
    ('friction=5,rate=1e-3,law=compensation', ['repeat', '0, 1', 'more than one']),
    ('friction=much,rate=1e-3,law=compensation,repeat=0', ["'much'", 'a number']),
    ('friction=nan,rate=1e-3,law=compensation,repeat=0', ['nan', 'a number']),
    ('friction=5,rate=1e-3,law=integral,repeat=0', ['integral', 'chattering implicit']),
    ('friction=5,rate=1e-3,law=compensation,repeat=2', ['repeat: 2', '0 to 1']),
    ('friction=5,rate=1e-3,law=compensation,repeat=0.5', ['repeat: 0.5', '0 to 1'])])
def test_what_is_no_point(text: str, words: list[str]) -> None:
    with pytest.raises(UsageError) as error:
        find_run(RUNS, text)
    assert [word for word in (f'--explain {text}', *words) if word not in str(error.value)] == []
