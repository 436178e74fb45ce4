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

"""The page: plots, and a view with scene, light and numbers; and the server behind it."""

from __future__ import annotations

from collections.abc import Sequence
import errno
import logging
import socket
from typing import Any

from ctc_chattering.analysis.interactive_plots import component
from ctc_chattering.analysis.markup import asset, fragment, Markup
from ctc_chattering.analysis.markup import page as page_of
from ctc_chattering.errors import CtcError, UsageError
from ctc_chattering.live.access import is_local
from ctc_chattering.live.cameras import Cameras
from ctc_chattering.live.health import COLOURS, ENDED, Light, SIGNS
from ctc_chattering.live.samples_socket import SamplesSocket
from ctc_chattering.live.server import serve, stop
from ctc_chattering.live.skeleton import Skeleton, stage

#: Where the page is by default, and how many ports after it are tried.
HOST, PORT, _TRIED = '127.0.0.1', 8080, 50
#: Width of the panel [px].
_MAIN_WIDTH = 380
_LIGHT = """<div class="ctc-light" data-level="{{ level }}" style="padding:8px 12px">
<b style="color:{{ colour }};font-size:1.25em">{{ sign }}</b><div style="font-size:0.8em">
{%- for line in lines %}<div>{{ line }}</div>{% endfor %}{{ more }}</div></div>"""


class Page:
    """
    What is common to the page of a graph and that of a bag.

    Parameters
    ----------
    title : str
    host : str
        Address to listen on.
    port : int or None
        Port; None for the first free one from `PORT` on.
    dark : bool
        Light letters on dark ground.
    main, reports : str
        Titles of the two tabs on the right; empty for no second one.

    Attributes
    ----------
    server : ViserServer
    url : str
        What to open, with the token without which nothing is shown.
    main : container of GUI elements
        The first tab.
    samples : SamplesSocket
        The WebSocket of the plots.
    numbers, reports : handle
        Of HTML above the tabs, and in the second tab.
    cameras : Cameras
        Of the browsers.

    Raises
    ------
    CtcError
        If the port is taken, the address is none of this machine's, or access cannot be checked.

    """

    def __init__(self, title: str, host: str = HOST, port: int | None = None,
                 dark: bool = False, main: str = 'run', reports: str = '') -> None:
        self.samples = SamplesSocket()
        around = page_of('ctc_chattering.live', 'live.html', title=title, dark=dark,
                         component=component(), parts=_parts())
        self.server, self.url = serve(
            require_viser(), host, free_port(host, port), title, around, self.samples)
        gui = self.server.gui
        gui.configure_theme(dark_mode=dark, show_logo=False, show_share_button=False)
        gui.main_panel.dock_right()
        gui.main_panel.set_width(_MAIN_WIDTH)
        self.server.scene.set_up_direction('+z')
        if dark:
            self.server.scene.set_background_image(_grey(24))
        gui.set_panel_label(title)
        self._light = gui.add_html('')
        self._light_text = ''
        self.numbers = gui.add_html('')
        tabs = gui.add_tab_group()
        self.main = tabs.add_tab(main)
        if reports:
            with tabs.add_tab(reports):
                self.reports = gui.add_html('')
        self._arms: list[Any] = []
        self._grid: Any = None
        self.cameras = Cameras(self.server)

    @property
    def watched(self) -> bool:
        """Whether a browser shows the page."""
        return bool(self.server.get_clients())

    def show_light(self, light: Light, more: Markup) -> None:
        """Show a level with the lines that say why, and `more` below them."""
        text = str(fragment(_LIGHT, level=light.level, colour=COLOURS[light.level],
                            sign=SIGNS[light.level], lines=light.lines, more=more))
        if text != self._light_text:
            self._light_text = self._light.content = text
        self.samples.tell(ended='' if light.level != ENDED else (
            f'{SIGNS[ENDED]}. {"; ".join(light.lines)}'))

    def show_arms(self, skeletons: Sequence[Skeleton | None]) -> list[Any]:
        """Put arms side by side into the scene, in place of those there."""
        for arm in self._arms:
            arm.remove()
        from ctc_chattering.live.arm_view import ArmView
        from ctc_chattering.live.framing import roots
        (reach, _, floor), count = stage(skeletons), len(skeletons)
        views = [None if skeleton is None else ArmView(self.server, skeleton, f'arm{i}', place)
                 for i, (skeleton, place) in enumerate(zip(skeletons, roots(count, reach)))]
        self._arms = [view for view in views if view is not None]
        if self._grid is not None:
            self._grid.remove()
        self.samples.tell(scene=' '.join(
            f'{len(x.bodies)}:{x.n}:{x.reach:.3f}' for x in skeletons if x is not None))
        self._grid = self.server.scene.add_grid(
            '/grid', 4.0 * reach, 4.0 * reach, cell_size=reach / 4, section_size=reach,
            position=(0.0, 0.0, floor))
        return views

    def close(self) -> None:
        """Stop serving."""
        stop(self.server)


def _parts() -> Markup:
    """Return the scripts and the style of the page's own controls and of the frame of the view."""
    def read(name: str) -> Markup:
        return asset('ctc_chattering.live', f'web/{name}')
    return fragment('<style>{{ style }}</style>{% for x in scripts %}<script>{{ x }}</script>'
                    '{% endfor %}', style=read('controls.css'),
                    scripts=[read('controls.js'), read('view.js')])


def _grey(level: int) -> Any:
    """Return a picture of one grey, shape (2, 2, 3)."""
    import numpy as np
    return np.full((2, 2, 3), level, np.uint8)


def require_viser() -> Any:
    """
    Return the library that serves the page.

    Raises
    ------
    UsageError
        If it is not installed; one line that says how to install it.

    """
    try:
        import viser
    except ImportError as error:
        raise UsageError(f'the page needs viser ({error}): pip install viser') from None
    # A browser that goes away in the middle of a message is no error.
    logging.getLogger('websockets').setLevel(logging.CRITICAL)
    return viser


def free_port(host: str, port: int | None) -> int:
    """
    Return the port to listen on.

    Raises
    ------
    CtcError
        If the port asked for is taken, or none is free; with the reason.

    """
    for number in [port] if port is not None else range(PORT, PORT + _TRIED):
        with socket.socket(socket.AF_INET6 if ':' in host else socket.AF_INET) as it:
            it.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                it.bind((host, number))
                return int(it.getsockname()[1])
            except OSError as error:
                reason = error.strerror or str(error)
                if error.errno in (errno.EADDRNOTAVAIL, socket.EAI_NONAME):
                    break
    raise CtcError(f'{host}, port {port or f"{PORT} to {PORT + _TRIED - 1}"}: {reason}; '
                   '--port N takes another one')


def warning_of(host: str) -> str:
    """Return what it means to listen on an address; empty for this machine's own."""
    if is_local(host):
        return ''
    return (f'listening on {host}: everyone who has the address with its token, which the network '
            'carries without encryption, sees the page and, unless --read-only is given, can '
            'change the law and stop the torques')
