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

"""What numba could not tell apart is not marked: a method of a record, and a field of another."""

from importlib import import_module
import inspect
import pkgutil

import ctc_chattering
from ctc_chattering.compiled import compilable

#: Folders with functions that are compiled.
FOLDERS = 'control', 'dynamics', 'numerics', 'simulation'


def test_no_method_has_the_name_of_a_field() -> None:
    for folder in FOLDERS:
        package = import_module(f'{ctc_chattering.__name__}.{folder}')
        for module in pkgutil.walk_packages(package.__path__, f'{package.__name__}.'):
            import_module(module.name)
    assert len(compilable.RECORDS) > 30
    fields = {name for marked in compilable.RECORDS for name in marked.__annotations__}
    for marked in compilable.RECORDS:
        methods = inspect.getmembers(marked, inspect.isfunction)
        assert not fields & {name for name, _ in methods if not name.startswith('_')}
