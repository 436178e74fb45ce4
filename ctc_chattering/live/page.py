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

"""The page: plots, panel and scene, the arms in it, and the cameras of the browsers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import partial
from itertools import product
from math import cos, radians, sin, tan
from typing import Annotated, Any, Literal, NamedTuple

from ctc_chattering.analysis.markup import asset, component, fragment, Markup
from ctc_chattering.analysis.markup import page as page_of
from ctc_chattering.configuration.package_share import find_mesh
from ctc_chattering.errors import CtcError
from ctc_chattering.live import require_viser
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, HOST, serve, stop
from ctc_chattering.live.skeleton import LONGEST, places, quaternion, Shape, Skeleton, stage
from ctc_chattering.numerics.linear_algebra import Array
from msgspec import Meta
import numpy as np

_SCRIPTS = ('numbers.js', 'player.js', 'status.js', 'controls.js', 'view.js', 'page.js')
#: Blue and orange of the palette of Okabe and Ito. Of the ghost, larger and transparent, only what
#: is behind the arm is drawn, so that the arm keeps its colour.
ARM_COLOUR, GHOST_COLOUR = (0, 114, 178), (230, 159, 0)
_GHOST_SCALE, _GHOST_OPACITY = 1.03, 0.6
#: What the ghost's distance from the arm may be multiplied by, and the largest that is drawn of a
#: joint then [rad or m].
Magnified = Literal[1, 10, 100, 1000]
_LARGEST = 1.0
#: Of more triangles a link is drawn by its other shapes.
_MOST = 200_000
#: Vertical angle of view [rad]; width of a view as a part of its height where it is not known.
FIELD, ASPECT = 0.8, 0.9
#: Part of the width or of the height of the view, whichever is less room, that the arms fill.
_FILLS = 0.85
#: Direction from the arms to the camera [rad].
_AZIMUTH, _ELEVATION = radians(-60), radians(12)
#: Where a body is furthest out, seen from its middle: corners, edges and faces of a cube.
_WAYS = np.array([x for x in product((-1.0, 0.0, 1.0), repeat=3) if any(x)])
_WAYS /= np.linalg.norm(_WAYS, axis=1)[:, None]
#: Width of a view as a part of its height, as a browser says it.
Aspect = Annotated[float, Meta(ge=0.3, le=3.0)]


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
        self.cameras = Cameras(self.server, self.socket)
        self.socket.on('magnify', Magnified, partial(setattr, self, 'magnified'))

    def show_arms(self, skeletons: Sequence[Skeleton | None]) -> list[ArmView | None]:
        """Put arms side by side into the scene, in place of those there."""
        scene = self.server.scene
        scene.reset()
        reach, floor = stage(skeletons)
        scene.add_grid('/grid', 4.0 * reach, 4.0 * reach, cell_size=reach / 4,
                       section_size=reach, position=(0.0, 0.0, floor))
        self.socket.tell(scene=' '.join(
            f'{len(x.bodies)}:{x.n}:{x.reach:.3f}' for x in skeletons if x is not None))
        return [None if skeleton is None else ArmView(self.server, skeleton, f'arm{i}', place)
                for i, (skeleton, place) in enumerate(
                    zip(skeletons, places(len(skeletons), reach)))]

    def close(self) -> None:
        """Stop serving."""
        stop(self.server)


def scripts(names: Sequence[str]) -> Markup:
    """Return scripts of ``live/web/`` for a page."""
    return fragment('{% for x in scripts %}<script>\n{{ x }}</script>\n{% endfor %}', scripts=[
        asset('ctc_chattering.live', f'web/{name}') for name in names])


class ArmView:
    """
    An arm and its ghost, each hidden until its position is known.

    Parameters
    ----------
    server : ViserServer
    skeleton : Skeleton
    name : str
        Of its nodes in the scene.
    place : sequence of float, shape (3,)
        Where its root is [m].

    Attributes
    ----------
    skeleton : Skeleton
    magnified : int
        What the error is multiplied by where the ghost is drawn; one of `Magnified`.

    """

    def __init__(self, server: Any, skeleton: Skeleton, name: str,
                 place: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.skeleton, self.magnified = skeleton, 1
        self._place = np.array(place)
        server.scene.add_frame(f'/{name}', show_axes=False, position=place)
        shapes = drawn(skeleton)
        self._outlines = [outermost([mesh.vertices for mesh in body]) for body in shapes]
        self._parts, self._frames = {}, {}
        for part, colour, scale, opacity, side in (
                ('arm', ARM_COLOUR, 1.0, None, 'front'),
                ('ghost', GHOST_COLOUR, _GHOST_SCALE, _GHOST_OPACITY, 'back')):
            self._parts[part] = server.scene.add_frame(
                f'/{name}/{part}', show_axes=False, visible=False)
            frames = self._frames[part] = [
                server.scene.add_frame(f'/{name}/{part}/{i}', show_axes=False)
                for i in range(len(shapes))]
            for frame, body in zip(frames, shapes):
                for k, mesh in enumerate(body):
                    vertices, faces = map(np.asarray, (mesh.vertices, mesh.faces))
                    middle = vertices.mean(axis=0)
                    server.scene.add_mesh_simple(
                        f'{frame.name}/{k}', middle + scale * (vertices - middle), faces,
                        color=colour, opacity=opacity, side=side, flat_shading=False,
                        cast_shadow=False, receive_shadow=False)

    def points(self, positions: Iterable[Array]) -> Array:
        """Return the outline of the arm at `positions`, each of shape (n,), shape (N, 3) [m]."""
        found = [np.empty((0, 3))]
        for q in positions:
            found += [outline @ pose[:3, :3].T + pose[:3, 3]
                      for outline, pose in zip(self._outlines, self.skeleton.poses(q))]
        points: Array = np.concatenate(found) + self._place
        return points

    def show(self, q: Array | None, q_d: Array | None) -> None:
        """Draw the arm at `q` and the ghost at `q_d`, each of shape (n,) [rad], where known."""
        if q is not None and q_d is not None and self.magnified != 1:
            q_d = q + np.clip(self.magnified * (q_d - q), -_LARGEST, _LARGEST)
        for part, position in (('arm', q), ('ghost', q_d)):
            if position is None:
                continue
            poses = self.skeleton.poses(position)
            for frame, pose in zip(self._frames[part], poses):
                frame.wxyz, frame.position = quaternion(pose[:3, :3]), pose[:3, 3]
            if not self._parts[part].visible:
                self._parts[part].visible = True


def drawn(skeleton: Skeleton) -> list[list[Any]]:
    """
    Return the meshes of every body.

    A body has its visual shapes; if one of their files is not found or not read, its shapes for
    collisions; and if these are not either, its capsules. An arm without shapes has capsules.
    """
    bare = not any(body.visual or body.collision for body in skeleton.bodies)
    found = []
    for body in skeleton.bodies:
        choices = [x for x in (body.visual, body.collision) if x]
        if choices or bare:
            choices.append(body.capsules)
        made = ([triangles(shape) for shape in shapes] for shapes in choices)
        found.append(next((x for x in made if all(mesh is not None for mesh in x)), []))
    return found


def triangles(shape: Shape) -> Any:
    """Return the mesh of a shape in the frame of its body; None if it is not found or not read."""
    with suppress(Exception):  # Of arbitrary files, readers raise arbitrary exceptions.
        mesh = _mesh(shape)
        if 0 < len(mesh.faces) <= _MOST:
            mesh.apply_transform(shape.pose)
            if np.abs(mesh.vertices).max() < LONGEST:
                return mesh
    return None


def _mesh(shape: Shape) -> Any:
    import trimesh
    sizes = shape.sizes
    if shape.kind == 'mesh':
        path = find_mesh(shape.file)
        if path is None:
            raise CtcError(f'{shape.file}: not found')
        mesh: Any = trimesh.load(path, force='mesh')
        mesh.apply_scale(sizes)
        return mesh
    if shape.kind == 'box':
        return trimesh.creation.box(sizes)
    if shape.kind == 'cylinder':
        return trimesh.creation.cylinder(sizes[0], sizes[1], sections=24)
    if shape.kind == 'sphere':
        return trimesh.creation.icosphere(2, sizes[0])
    ball = trimesh.creation.icosphere(2, sizes[6]).vertices
    ends = [ball + end for end in (sizes[:3], sizes[3:6])]
    return trimesh.convex.convex_hull(np.concatenate(ends))


class Camera(NamedTuple):
    """Where a camera is, and what it looks at, each of shape (3,) [m]."""

    position: tuple[float, ...]
    look_at: tuple[float, ...]


def camera_of(points: Array, aspect: float = ASPECT) -> Camera:
    """
    Return the camera that shows all of some points as large as a view allows.

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        Of the arms, where they are and where they may be [m].
    aspect : float
        Width of the view as a part of its height.

    """
    (ca, sa), (ce, se) = ((cos(x), sin(x)) for x in (_AZIMUTH, _ELEVATION))
    axes = np.array(((-sa, ca, 0.0), (-ca * se, -sa * se, ce), (ca * ce, sa * ce, se)))
    seen = points @ axes.T
    across, depth = seen[:, :2], seen[:, 2:]
    # A point is seen if |across - middle| <= size (distance - depth).
    size = _FILLS * tan(0.5 * FIELD) * np.array((aspect, 1.0))
    least, most = (depth - across / size).max(axis=0), (depth + across / size).max(axis=0)
    middle, distance = 0.5 * size * (most - least), float((0.5 * (most + least)).max())
    return Camera(*(tuple((np.append(middle, x) @ axes).tolist())
                    for x in (distance, depth.mean())))


def outermost(vertices: Sequence[Array]) -> Array:
    """Return those of some points that are furthest out, shape (N, 3); of none, shape (0, 3)."""
    if not vertices:
        return np.empty((0, 3))
    points: Array = np.concatenate(vertices)
    furthest: Array = points[np.unique(np.argmax(points @ _WAYS.T, axis=0))]
    return furthest


class Cameras:
    """
    What browsers look at.

    Parameters
    ----------
    server : ViserServer
    socket : PageSocket
        Where browsers say what shape their view has, and that their camera was moved.

    """

    def __init__(self, server: Any, socket: PageSocket) -> None:
        self._server = server
        self._shown: Array | None = None
        self._aspect, self._moved = ASPECT, False
        socket.on('aspect', Aspect, self._resize)
        socket.on('moved', None, lambda _: setattr(self, '_moved', True))

    def look(self, points: Array, again: bool = True) -> None:
        """Show points, as `camera_of` takes them; not `again` where a camera was moved by hand."""
        if len(points):
            self._shown, self._moved = points, self._moved and not again
            self._show()

    def _resize(self, aspect: float) -> None:
        self._aspect = aspect
        self._show()

    def _show(self) -> None:
        if self._shown is None:
            return
        camera = camera_of(self._shown, self._aspect)
        initial = self._server.initial_camera
        initial.fov = FIELD
        initial.position, initial.look_at = camera
        for client in () if self._moved else self._server.get_clients().values():
            with suppress(Exception), client.atomic():  # Of what a browser says of its camera.
                client.camera.position, client.camera.look_at = camera
