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

"""The plots of pages: what is put in; test/live/test_bag_page.py has them in a browser."""

from __future__ import annotations

from ctc_chattering.analysis.interactive_plots import component


def test_style_and_script_stand_in_a_page_with_the_licence_of_uplot() -> None:
    text = str(component())
    assert text.count('<style>') == text.count('</style>') == 1
    assert text.count('<script>') == text.count('</script>') == 1
    assert 'Permission is hereby granted' in text
    assert 'Copyright (c) 2022 Leon Sorokin' in text
    # Nothing is loaded from elsewhere.
    assert 'http' not in text.replace('https://github.com/leeoniya/uPlot', '')
