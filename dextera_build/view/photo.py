"""The photograph before the twin, at its camera: a slider wipes from one to the other, or blends them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.geometry import quaternions, transforms
from dextera_build.view.panel import note_wipe

DEPTH_M = 0.05
"""Distance of the photograph from the camera: nearer than anything that it shows [m]."""
MARGIN = 1.05
"""Field of view of "look from the camera" over that of the photograph."""
WAYS = ("Wipe", "Blend")


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
        self._server.on_client_connect(self.look)

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
