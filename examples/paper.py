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


"""
The paper in 20 lines: both laws against friction that the controller does not know.

``python paper.py`` prints the errors of the README's table, and writes the paper's figures
2 to 5 into ``paper/``.
"""

from __future__ import annotations

from ctc_chattering import load_parameters, save_figures, simulate

results = []
for law in ('compensation', 'chattering'):
    setup = load_parameters('friction', {'controller': {'law': law}})
    result = simulate(setup)
    e1, e2 = result.metrics()['rms_error_rad']
    print(f'{law:12} RMS error {e1:.2e}, {e2:.2e} rad')
    results.append(result)

weak, strong = ((x.e[x.t >= 5.0, 1] ** 2).mean() ** 0.5 for x in results)
print(f'The chattering term divides the error of joint 2 by {weak / strong:.0f}.')
for figure in save_figures(results, 'paper'):
    print(figure.path, '-', figure.title)
