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
HTML page, scene and cameras of `ctc live`.

`GraphPage` and `BagPage` fill it. `server.serve` decides who may open it.

The cameras show all points p of the arms as large as the view allows. With the camera's axes and a
view of width w and height h at distance 1, a point is seen if

    |p_x - c_x| <= w/2 (d - p_z),  |p_y - c_y| <= h/2 (d - p_z),                        (CM1)

where c is the point that the camera looks at, and d its distance. The smallest d is found for
width and height alone, and the larger one is used.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import partial
from math import tan
from typing import Annotated, Any, Literal, NamedTuple

from ctc_chattering.analysis.markup import asset, component, fragment, Markup
from ctc_chattering.analysis.markup import page as render_page
from ctc_chattering.control.controller import ControllerConfig
from ctc_chattering.live import require_viser
from ctc_chattering.live.page_socket import PageSocket
from ctc_chattering.live.server import free_port, HOST, serve
from ctc_chattering.live.skeleton import body_meshes, quaternion, root_positions, Skeleton, stage
from ctc_chattering.numerics.linear_algebra import Array
from msgspec import Meta
import numpy as np
from scipy.spatial.transform import Rotation  # type: ignore[import-untyped]

#: Blue and orange of the palette of Okabe and Ito.
_ARM_COLOUR = (0, 114, 178)
_GHOST_COLOUR = (230, 159, 0)
#: Factor on the error with which the ghost is drawn.
Magnification = Literal[1, 10, 100, 1000]
#: Vertical angle of view [rad].
FIELD_OF_VIEW = 0.8
#: Width over height of a view that has not said it.
_USUAL_ASPECT = 0.9
#: Width over height of a view, as a browser sends it.
Aspect = Annotated[float, Meta(ge=0.3, le=3.0)]
#: Right, up and backward of a camera that turns to -60° from x and looks down by 12°.
_CAMERA_AXES = Rotation.from_euler('ZX', (30.0, 78.0), degrees=True).as_matrix().T


class Page:
    """
    Page of a graph or of bags.

    Parameters
    ----------
    title : str
    host : str
        Address to listen on.
    port : int or None
        Port, or None for the first free one.

    Attributes
    ----------
    server : PageServer
    socket : PageSocket
        WebSocket of the page around the scene.
    cameras : Cameras
    magnification : int
        Factor on the error with which ghosts are drawn.

    Raises
    ------
    CtcError
        If the port is taken, the address is not this machine's, or access cannot be checked.

    """

    def __init__(self, title: str, host: str = HOST, port: int | None = None) -> None:
        self.socket = PageSocket()
        self.magnification = 1
        page = render_page(
            'ctc_chattering.live',
            'live.html',
            title=title,
            component=component(),
            style=asset('ctc_chattering.live', 'web/live.css'),
            scripts=scripts('numbers.js', 'player.js', 'status.js', 'controls.js', 'view.js',
                            'page.js'))
        self.server = serve(require_viser(), host, free_port(host, port), page, self.socket)
        self.server.viser.scene.set_up_direction('+z')
        self.cameras = Cameras(self.server.viser, self.socket)
        self.socket.on('magnify', Magnification, partial(setattr, self, 'magnification'))

    def show_arms(self, skeletons: Sequence[Skeleton | None]) -> list[ArmView | None]:
        """Replace the arms in the scene by others, side by side."""
        scene = self.server.viser.scene
        scene.reset()
        reach, floor = stage(skeletons)
        scene.add_grid('/grid', 4.0 * reach, 4.0 * reach, cell_size=reach / 4,
                       section_size=reach, position=(0.0, 0.0, floor))
        # Pages answer a new text with the shape of their view.
        self.socket.send(scene=' '.join(
            f'{len(x.bodies)}:{x.kinematics.n}:{x.reach:.3f}' for x in skeletons if x is not None))
        roots = root_positions(len(skeletons), reach)
        return [None if skeleton is None else ArmView(scene, skeleton, f'/arm{i}', root)
                for i, (skeleton, root) in enumerate(zip(skeletons, roots))]

    def close(self) -> None:
        """Stop serving."""
        self.server.stop()


def describe_law(config: ControllerConfig) -> str:
    """Return the names of law and switching."""
    return f'{config.law}, {config.switching}' if config.takes('switching') else config.law


def scripts(*names: str) -> Markup:
    """Return scripts of ``live/web/`` for a page."""
    return fragment(
        '{% for x in scripts %}<script>\n{{ x }}</script>\n{% endfor %}',
        scripts=[asset('ctc_chattering.live', f'web/{name}') for name in names])


class ArmView:
    """
    Arm and ghost in the scene.

    Each is hidden until its position is known.

    Parameters
    ----------
    scene : SceneApi
    skeleton : Skeleton
    name : str
        Name of its node in the scene.
    root : sequence of float, shape (3,)
        Position of its root [m].

    """

    def __init__(self, scene: Any, skeleton: Skeleton, name: str,
                 root: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self._skeleton = skeleton
        self._root = np.array(root)
        meshes = body_meshes(skeleton)
        #: Corners of each body's boxes, shape (N, 3) [m].
        self._corners = [
            np.reshape([mesh.bounding_box.vertices for mesh in body], (-1, 3)) for body in meshes]
        scene.add_frame(name, show_axes=False, position=root)
        self._arm = _DrawnArm(scene, f'{name}/arm', meshes, color=_ARM_COLOUR)
        # Only what is behind the arm is drawn of the larger ghost, so the arm keeps its colour.
        self._ghost = _DrawnArm(
            scene, f'{name}/ghost', [[_enlarged(mesh, 1.03) for mesh in body] for body in meshes],
            color=_GHOST_COLOUR, opacity=0.6, side='back')

    def points(self, positions: Iterable[Array]) -> Array:
        """
        Return corners of boxes around the bodies at some positions.

        Parameters
        ----------
        positions : iterable of ndarray, shape (n,)
            Joint positions [rad or m].

        Returns
        -------
        ndarray, shape (N, 3)
            Corners [m].

        """
        points = [
            corners @ pose[:3, :3].T + pose[:3, 3] + self._root
            for q in positions
            for corners, pose in zip(self._corners, self._skeleton.poses(q))]
        return np.concatenate([np.empty((0, 3)), *points])

    def show(self, q: Array | None, q_d: Array | None, magnification: float = 1.0) -> None:
        """
        Draw the arm and the ghost where their positions are known.

        Parameters
        ----------
        q, q_d : ndarray, shape (n,), or None
            Position and desired position [rad or m].
        magnification : float
            Factor on the error. A joint of the ghost is at most 1 rad or m away then.

        """
        if q is not None and q_d is not None and magnification != 1:
            q_d = q + np.clip(magnification * (q_d - q), -1.0, 1.0)
        for drawn_arm, position in ((self._arm, q), (self._ghost, q_d)):
            if position is not None:
                drawn_arm.show(self._skeleton.poses(position))


class _DrawnArm:
    """
    Bodies of an arm in the scene.

    Parameters
    ----------
    scene : SceneApi
    name : str
        Name of its node in the scene.
    meshes : sequence of sequences of Trimesh
        Meshes of each body.
    **style : Any
        Colour, opacity and side for viser.

    """

    def __init__(self, scene: Any, name: str, meshes: Sequence[Sequence[Any]],
                 **style: Any) -> None:
        self.root = scene.add_frame(name, show_axes=False, visible=False)
        self.frames = []
        for i, body in enumerate(meshes):
            self.frames.append(scene.add_frame(f'{name}/{i}', show_axes=False))
            for k, mesh in enumerate(body):
                scene.add_mesh_simple(
                    f'{name}/{i}/{k}', np.asarray(mesh.vertices), np.asarray(mesh.faces),
                    flat_shading=False, cast_shadow=False, receive_shadow=False, **style)

    def show(self, poses: Array) -> None:
        """Move the bodies to poses, shape (bodies, 4, 4)."""
        for frame, pose in zip(self.frames, poses):
            frame.wxyz = quaternion(pose[:3, :3])
            frame.position = pose[:3, 3]
        self.root.visible = True


def _enlarged(mesh: Any, scale: float) -> Any:
    """Return a mesh that is larger around its middle."""
    larger = mesh.copy()
    middle = mesh.vertices.mean(axis=0)
    larger.vertices = middle + scale * (mesh.vertices - middle)
    return larger


class CameraPose(NamedTuple):
    """Position and target of a camera, each of shape (3,) [m]."""

    position: tuple[float, ...]
    look_at: tuple[float, ...]


def fit_camera(points: Array, aspect: float = _USUAL_ASPECT) -> CameraPose:
    """
    Return the camera that shows points by (CM1).

    Parameters
    ----------
    points : ndarray, shape (N, 3)
        Points of the arms [m].
    aspect : float
        Width over height of the view.

    """
    seen = points @ _CAMERA_AXES.T
    depth = seen[:, 2:]
    # The arms fill 85 % of the width or of the height.
    half_size = 0.85 * tan(0.5 * FIELD_OF_VIEW) * np.array((aspect, 1.0))
    low = (depth - seen[:, :2] / half_size).max(axis=0)
    high = (depth + seen[:, :2] / half_size).max(axis=0)
    middle = 0.5 * half_size * (high - low)
    distance = 0.5 * (high + low).max()
    return CameraPose(*(
        tuple((np.append(middle, z) @ _CAMERA_AXES).tolist()) for z in (distance, depth.mean())))


class Cameras:
    """
    Cameras of all browsers.

    Parameters
    ----------
    viser : ViserServer
    socket : PageSocket
        Browsers send the shape of their view, and whether their camera was moved.

    """

    def __init__(self, viser: Any, socket: PageSocket) -> None:
        self._viser = viser
        self._points: Array | None = None
        self._aspect = _USUAL_ASPECT
        self._moved_by_user = False
        socket.on('aspect', Aspect, self._on_aspect)
        socket.on('moved', None, self._on_moved)

    def look(self, points: Array, after_move: bool = True) -> None:
        """
        Show points.

        Parameters
        ----------
        points : ndarray, shape (N, 3)
            Points of the arms [m].
        after_move : bool
            False leaves a camera alone that the user has moved.

        """
        if len(points):
            self._points = points
            self._moved_by_user = self._moved_by_user and not after_move
            self._show()

    def _on_aspect(self, aspect: float) -> None:
        self._aspect = aspect
        self._show()

    def _on_moved(self, _: None) -> None:
        self._moved_by_user = True

    def _show(self) -> None:
        if self._points is None:
            return
        pose = fit_camera(self._points, self._aspect)
        initial = self._viser.initial_camera
        initial.fov = FIELD_OF_VIEW
        initial.position, initial.look_at = pose
        if self._moved_by_user:
            return
        for client in self._viser.get_clients().values():
            with suppress(Exception), client.atomic():  # Browsers may send odd cameras.
                client.camera.position, client.camera.look_at = pose
