"""The photograph before the twin, at its camera: a slider wipes from one to the other, or blends them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary, ref

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import quaternions, transforms
from dextera_build.view.panel import note_wipe

DEPTH_M = 0.05
"""Distance of the photograph from the camera: nearer than anything that it shows [m]."""
MARGIN = 1.05
"""Field of view of "look from the camera" over that of the photograph."""
WAYS = ("Wipe", "Blend")
DOT_PX = 3
"""Half the width of the mark of a pixel that was asked for [px]."""
MARKS = ((255, 120, 0), (0, 120, 255))
"""Colours of the marks, one after the other."""
_SHOWN: WeakKeyDictionary[Any, ref[Comparison]] = WeakKeyDictionary()
"""Viewer -> its photograph now; viser keeps for good what it calls when a client connects."""


class Comparison:
    """A photograph that covers a part of the view, from the left, or is partly transparent.

    Args:
        server: A viser server.
        name: Scene node.
        camera: Intrinsics of the photograph [px].
        world_from_camera: T_world_camera (4, 4), OpenCV axes.
        pixels: (H, W, 3) uint8 sRGB.
    """

    def __init__(
        self, server: Any, name: str, camera: Camera, world_from_camera: np.ndarray, pixels: np.ndarray
    ) -> None:
        self.aside: list[Any] = []
        """Scene nodes that are hidden in the view from the camera: its frustum."""
        self._server, self._camera, self._pose, self._pixels = server, camera, world_from_camera, pixels
        # An image of viser has x right, y down, and is seen from both sides.
        self.picture = server.scene.add_image(
            name,
            pixels,
            *self._size(camera.width),
            wxyz=quaternions.from_matrix(world_from_camera[:3, :3]),
            position=self._middle(camera.width),
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
        note_wipe(server, "Photograph [%]", name)
        with server.gui.add_folder("Photograph and twin"):
            self._share = server.gui.add_slider("Photograph [%]", min=0, max=100, step=1, initial_value=0)
            self._way = server.gui.add_dropdown("By", WAYS, initial_value=WAYS[0])
            look = server.gui.add_button("Look from the camera")
        self._share.on_update(lambda _: self.update())
        self._way.on_update(lambda _: self.update())
        look.on_click(lambda event: self.look(event.client))
        self._begin()

    def _begin(self) -> None:
        """Open every view at the photograph's camera; how wide the window is, is known once it is there."""
        start = self._server.initial_camera
        start.position = tuple(self._pose[:3, 3].tolist())
        start.up = tuple((-self._pose[:3, 1]).tolist())
        start.look_at = tuple((self._pose[:3, 3] + self._pose[:3, 2]).tolist())
        start.fov = float(MARGIN * 2 * np.arctan2(self._camera.height / 2, self._camera.fy))
        if self._server not in _SHOWN:
            self._server.on_client_connect(partial(_look, ref(self._server)))
        _SHOWN[self._server] = ref(self)

    def update(self) -> None:
        """Apply the values of the controls."""
        share = float(self._share.value) / 100.0
        self.picture.visible = share > 0
        if share == 0:
            return
        if self._way.value == "Blend":
            opaque = np.full((*self._pixels.shape[:2], 1), round(255 * share), np.uint8)
            self._hang(np.concatenate([self._pixels, opaque], axis=2))
        else:
            self._hang(self._pixels[:, : max(1, round(share * self._camera.width))])

    def ask(self, client: Any, mask: np.ndarray, count: int, answer: Callable[[list[tuple[int, int]]], None]) -> None:
        """Show the whole photograph to a client, an object in it, and take the pixels that are clicked.

        Args:
            client: Is moved to the photograph's camera.
            mask: (H, W) bool, the object; everything else is dark.
            count: Number of pixels to take.
            answer: Takes columns and rows of the pixels [px]; the photograph is then as before.
        """
        shown = np.where(mask[..., None], self._pixels, self._pixels // 3)
        found: list[tuple[int, int]] = []

        def clicked(event: Any) -> None:
            column, row = self.pixel(event.ray_origin, event.ray_direction)
            colour = MARKS[len(found) % len(MARKS)]
            shown[max(0, row - DOT_PX) : row + DOT_PX + 1, max(0, column - DOT_PX) : column + DOT_PX + 1] = colour
            found.append((column, row))
            self._hang(shown)
            if len(found) == count:
                self.picture.remove_click_callback("all")
                self.update()
                answer(found)

        self.picture.remove_click_callback("all")
        self._hang(shown)
        self.picture.visible = True
        self.picture.on_click(clicked)
        if client is not None:
            self.look(client)

    def pixel(self, origin: Any, direction: Any) -> tuple[int, int]:
        """Column and row of the pixel that a ray meets, from its origin and direction in the world."""
        start = transforms.apply(transforms.invert(self._pose), np.array([origin]))[0]
        along = self._pose[:3, :3].T @ np.asarray(direction, np.float64)
        met = start + (DEPTH_M - start[2]) / along[2] * along
        column, row = self._camera.project(met[None])[0].round().astype(int)
        return int(np.clip(column, 0, self._camera.width - 1)), int(np.clip(row, 0, self._camera.height - 1))

    def look(self, client: Any) -> None:
        """Move a client's camera to the photograph's, with a field of view that holds all of it."""
        for handle in self.aside:
            handle.visible = False
        camera = self._camera
        upright = 2 * np.arctan2(camera.height / 2, camera.fy)
        across = 2 * np.arctan(camera.width / 2 / camera.fx / max(client.camera.aspect, 0.1))
        with client.atomic():
            client.camera.position = tuple(self._pose[:3, 3].tolist())
            client.camera.up_direction = tuple((-self._pose[:3, 1]).tolist())
            client.camera.look_at = tuple((self._pose[:3, 3] + self._pose[:3, 2]).tolist())
            client.camera.fov = float(min(MARGIN * max(upright, across), 2.5))

    def _hang(self, pixels: np.ndarray) -> None:
        columns = pixels.shape[1]
        with self._server.atomic():
            self.picture.image = pixels
            self.picture.render_width, self.picture.render_height = self._size(columns)
            self.picture.position = self._middle(columns)

    def _size(self, columns: int) -> tuple[float, float]:
        """Width and height of the first `columns` of the photograph [m]."""
        return DEPTH_M * columns / self._camera.fx, DEPTH_M * self._camera.height / self._camera.fy

    def _middle(self, columns: int) -> np.ndarray:
        """Their middle in the world [m]; pixel centres are integers."""
        camera = self._camera
        x = ((columns - 1) / 2 - camera.cx) / camera.fx
        y = ((camera.height - 1) / 2 - camera.cy) / camera.fy
        return np.asarray(transforms.apply(self._pose, DEPTH_M * np.array([[x, y, 1.0]]))[0])


def _look(server: ref[Any], client: Any) -> None:
    """Move a new client's camera to the photograph that its viewer shows."""
    now = _SHOWN.get(server())
    if (comparison := now() if now is not None else None) is not None:
        comparison.look(client)
