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

"""`ctc repair`: a complete bag of a damaged one."""

from __future__ import annotations

import argparse

from ctc_chattering.cli.options import add_bag as add_options

__all__ = ['DETAILS', 'add_options', 'run']

DETAILS = 'Every tool can read it then; the damaged bag is kept beside it.'


def run(options: argparse.Namespace) -> int:
    """Run `ctc repair`."""
    from ctc_chattering.bags.repair import repair

    done = repair(options.bag)
    print(f'{options.bag}: '
          + (f'{done[0]}; the damaged bag is now {done[1]}' if done else 'nothing to repair'))
    return 0
