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

"""A study: every switching, or every law, in every case."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from ctc_chattering.analysis.compilation import compile_setups
from ctc_chattering.arguments import checked, whole
from ctc_chattering.errors import near, ParameterError
from ctc_chattering.studies import cases
from ctc_chattering.studies.study import CaseOutcome, run_cases, setup_of
from ctc_chattering.studies.study_files import LAWS, SWITCHINGS


@checked(laws=bool, groups=Sequence, show=Callable, progress=(Callable, type(None)))
def study(laws: bool = False, groups: Sequence[str] = (), jobs: int = 1,
          show: Callable[[str], None] = print,
          progress: Callable[[int, int], None] | None = None) -> list[CaseOutcome]:
    """
    Run the paper's arm under every switching over sample periods, gains and imperfections.

    Parameters
    ----------
    laws : bool
        Every law, with recommended settings, in place of every switching.
    groups : sequence of str
        Cases to run, such as ``Drive lag`` or ``Encoder resolution``; empty for all, minutes.
    jobs : int
        Processes; with more than 1 a script needs ``if __name__ == '__main__'``.
    show : callable
        Takes lines about what is compiled.
    progress : callable, optional
        Called with the number of outcomes that are there, and of all.

    Returns
    -------
    list of CaseOutcome
        One a case and switching or law, each with ``case``, ``variant`` and ``score``; for
        `write_study`.

    Raises
    ------
    CtcError
        If an argument is not allowed, before anything is run.

    """
    known = list(dict.fromkeys(case.group for case in cases.CASES))
    for name in groups:
        if name not in known:
            raise ParameterError('groups', name, ' | '.join(known) + near(name, known))
    jobs, kind = whole('jobs', jobs, 1), LAWS if laws else SWITCHINGS
    chosen = [case for case in cases.CASES if case.group in (groups or known)]
    compile_setups((setup_of(case, x) for case in chosen for x in kind.variants), show)
    found: list[CaseOutcome] = []
    for outcome in run_cases(chosen, kind.variants, jobs):
        found.append(outcome)
        if progress is not None:
            progress(len(found), len(chosen) * len(kind.variants))
    return found
