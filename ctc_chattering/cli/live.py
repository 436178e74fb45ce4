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

"""`ctc live`: the page of a running graph or of bags, or an export of bags."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import closing, ExitStack
from pathlib import Path
import sys
from typing import Any, TYPE_CHECKING

from ctc_chattering.cli.command_line import say
from ctc_chattering.cli.options import add_number, add_overwrite, add_own, own
from ctc_chattering.errors import UsageError
from ctc_chattering.output_files import check_file

if TYPE_CHECKING:
    from ctc_chattering.live.page import Page


def live_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `ctc live`."""
    parser.add_argument('bags', nargs='*', type=Path, metavar='BAG',
                        help='One bag, or two bags to compare.')
    parser.add_argument('--export', type=Path, metavar='FILE',
                        help='Write a self-contained HTML file of the bags instead of serving a '
                             'page.')
    add_overwrite(parser)
    add_own(parser)
    parser.add_argument('--host', default='127.0.0.1', metavar='H',
                        help='Address to listen on. Default: 127.0.0.1, which other machines '
                             'cannot reach.')
    add_number(parser, '--port', 'Port of the page. Default: the first free port from 8080 on',
               minimum=0, maximum=65535)
    parser.add_argument('--open', action=argparse.BooleanOptionalAction, default=None,
                        help='Open the page in a browser on this computer. Default: yes in a '
                             'terminal.')
    parser.add_argument('--bags-in', type=Path, default=Path(), metavar='DIR',
                        help='Directory in which the page records bags. Default: the current '
                             'directory.')
    parser.add_argument('--read-only', action='store_true',
                        help='Show the graph without controls. Nothing is sent to it.')
    parser.add_argument('--parent', type=int, help=argparse.SUPPRESS)


def run_live(options: argparse.Namespace) -> int:
    """Run `ctc live`."""
    if options.export is not None:
        return _export(options)
    from ctc_chattering.live import require_viser
    require_viser()
    from ctc_chattering.live.page import Page
    from ctc_chattering.live.server import exposure_warning, open_browser
    if options.bags and (options.read_only or options.ros_args):
        raise UsageError('--read-only and --ros-args apply to the page of a graph, not of bags')
    if not options.bags_in.is_dir():
        raise UsageError(f'--bags-in {options.bags_in}: there is no such directory')
    if warning := exposure_warning(options.host):
        say(f'ctc live: {warning}')

    with ExitStack() as open_pages:
        def make_page() -> Page:
            page = Page('ctc live', options.host, options.port)
            print(f'open {page.server.url} in a browser; Ctrl-C stops', flush=True)
            wanted = sys.stdout.isatty() if options.open is None else options.open
            if wanted:
                open_pages.enter_context(open_browser(page.server.url))
            return page

        _serve(options, make_page)
    return 0


def _serve(options: argparse.Namespace, make_page: Callable[..., Page]) -> None:
    """Serve the page until a signal comes."""
    from ctc_chattering.ros.process import collect_signals
    stop = collect_signals()
    if options.parent is not None:
        from ctc_chattering.launch.child_process import end_with
        end_with(options.parent)
    if options.bags:
        from ctc_chattering.live.bag_page import BagPage
        runs = _runs(options)
        with closing(make_page()) as page:
            BagPage(page, runs).run(stop)
        return
    from ctc_chattering.live.graph_page import run_graph_page
    run_graph_page(make_page, stop, options.ros_args, not options.read_only, options.bags_in)


def _runs(options: argparse.Namespace) -> list[Any]:
    """Return the runs of bags."""
    from ctc_chattering.bags.reader import read_bag
    from ctc_chattering.live.bag_page import RecordedRun
    if len(options.bags) > 2:
        raise UsageError(f'{len(options.bags)} bags were given; name one or two')
    runs = []
    for bag in options.bags:
        print(f'{bag} is being read ...', flush=True)
        runs.append(RecordedRun(read_bag(bag, **own(options))))
        if runs[-1].remark:
            say(f'ctc live: {bag}: {runs[-1].remark}')
    return runs


def _export(options: argparse.Namespace) -> int:
    """Write the page of bags into one file."""
    from ctc_chattering.live.bag_page import write_export
    if not options.bags:
        raise UsageError('--export needs a bag; name one or two')
    check_file(options.export, options.overwrite)
    size = write_export(_runs(options), options.export)
    print(f'{options.export}: {size / 1e6:.1f} MB; it opens in a browser and needs no network')
    return 0
