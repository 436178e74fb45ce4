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

"""The page: plots, scene and panel, and the server behind it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

from ctc_chattering.analysis.markup import asset, component, fragment, Markup
from ctc_chattering.analysis.markup import page as page_of
from ctc_chattering.live import require_viser
from ctc_chattering.live.arm_view import ArmView, Magnified
from ctc_chattering.live.cameras import Cameras, roots
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, HOST, serve, stop
from ctc_chattering.live.skeleton import Skeleton, stage

_SCRIPTS = ('numbers.js', 'player.js', 'status.js', 'controls.js', 'view.js', 'page.js')


class Page:
    """
    What is common to the page of a graph and that of a bag.

    Parameters
    ----------
    title : str
    host : str
        Address to listen on.
    port : int or None
        Port; None for the first free one.

    Attributes
    ----------
    server : ViserServer
    url : str
        What to open, with the token without which nothing is shown.
    socket : PageSocket
        The WebSocket of samples and words.
    magnified : int
        What errors are multiplied by where the ghost is drawn; one of `Magnified`.
    cameras : Cameras
        Of the browsers.

    Raises
    ------
    CtcError
        If the port is taken, the address is none of this machine's, or access cannot be checked.

    """

    def __init__(self, title: str, host: str = HOST, port: int | None = None) -> None:
        self.socket, self.magnified = PageSocket(), 1
        page = page_of('ctc_chattering.live', 'live.html', title=title, component=component(),
                       style=asset('ctc_chattering.live', 'web/live.css'),
                       scripts=scripts(_SCRIPTS))
        self.server, self.url = serve(
            require_viser(), host, free_port(host, port), page, self.socket)
        self.server.scene.set_up_direction('+z')
        self._arms: list[ArmView] = []
        self._grid: Any = None
        self.cameras = Cameras(self.server, self.socket)
        self.socket.on('magnify', Magnified, partial(setattr, self, 'magnified'))

    def show_arms(self, skeletons: Sequence[Skeleton | None]) -> list[ArmView | None]:
        """Put arms side by side into the scene, in place of those there."""
        for arm in self._arms:
            arm.remove()
        (reach, _, floor), count = stage(skeletons), len(skeletons)
        views = [None if skeleton is None else ArmView(self.server, skeleton, f'arm{i}', place)
                 for i, (skeleton, place) in enumerate(zip(skeletons, roots(count, reach)))]
        self._arms = [view for view in views if view is not None]
        if self._grid is not None:
            self._grid.remove()
        self.socket.tell(scene=' '.join(
            f'{len(x.bodies)}:{x.n}:{x.reach:.3f}' for x in skeletons if x is not None))
        self._grid = self.server.scene.add_grid(
            '/grid', 4.0 * reach, 4.0 * reach, cell_size=reach / 4, section_size=reach,
            position=(0.0, 0.0, floor))
        return views

    def close(self) -> None:
        """Stop serving."""
        stop(self.server)


def scripts(names: Sequence[str]) -> Markup:
    """Return scripts of ``live/web/`` for a page."""
    return fragment('{% for x in scripts %}<script>\n{{ x }}</script>\n{% endfor %}', scripts=[
        asset('ctc_chattering.live', f'web/{name}') for name in names])
