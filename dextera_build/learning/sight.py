"""What cameras showed at the steps of demonstrations: the pictures, distances and points that a policy learns from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from dextera_build.artifacts.tasks.backdrop import Backdrop
from dextera_build.artifacts.tasks.episode import DEPTH_STEP_M
from dextera_build.artifacts.tasks.policy import Channel
from dextera_build.errors import RuleError
from dextera_build.geometry import cameras
from dextera_build.learning.parts import Frames, Part
from dextera_build.policy import features


@dataclass(frozen=True)
class Sight:
    """Frames of one camera at all steps."""

    pictures: Frames
    """Colours (H, W, 3) uint8 sRGB."""
    depth: Frames | None
    """Distances (H, W) uint16 in counts of `DEPTH_STEP_M`, or None."""
    rays: tuple[np.ndarray, ...]
    """Directions (H, W, 3) float32 of the pixels of each part's camera, z = 1; none without depth."""
    parts: np.ndarray
    """Number of the part of each step (N,)."""
    masks: Frames | None
    """Rows of bits of the pixels of robot and objects, see `Backdrop`; None if there is no other background."""
    behind: np.ndarray
    """Other backgrounds (K, H, W, 3) uint8 sRGB."""

    @classmethod
    def of(cls, parts: Sequence[Part], camera: str) -> Self:
        """What the films of a camera show, of which every part has one."""
        deep = all(camera in part.depths for part in parts)
        found = [part.backdrops[camera] for part in parts if camera in part.backdrops]
        return cls(
            Frames([each for part in parts for each in part.pixels[camera]]),
            Frames([each for part in parts for each in part.depths[camera]]) if deep else None,
            tuple(_rays(part, camera) for part in parts) if deep else (),
            np.repeat(np.arange(len(parts)), [sum(part.lengths) for part in parts]),
            Frames([each for part in parts for each in _masks(part, camera)]) if found else None,
            np.concatenate([each.pictures for each in found]) if found else np.zeros((0, 1, 1, 3), np.uint8),
        )

    def at(self, channel: Channel, rows: np.ndarray) -> np.ndarray:
        """The input of a network at steps (N,), as `policy.running.Predict` gets it.

        Args:
            channel: A channel that a camera gives.
            rows: Steps.
        """
        if channel.encoding == "picture":
            return self.pictures.at(rows)
        return features.ranged(channel, self._metres(channel, rows))

    def foreground(self, rows: np.ndarray) -> np.ndarray:
        """Pixels (N, H, W) bool of robot and objects at steps (N,)."""
        assert self.masks is not None
        return Backdrop.unpacked(self.masks.at(rows), self.behind.shape[2])

    def measured(self, channel: Channel, rows: np.ndarray) -> np.ndarray:
        """The distances (M, 1) or points (M, 3) [m] that were measured within reach at steps (N,).

        Raises:
            RuleError: There are none.
        """
        found = self._metres(channel, rows)
        values = found[..., None] if channel.encoding == "depth" else found
        kept = values[(values[..., -1] > 0) & features.near(channel, values[..., -1])]
        if not len(kept):
            raise RuleError(
                f"nothing in the film is within {channel.reach_m:g} m of the camera",
                code="DXB-B516",
                hint="reach_m: 10.0",
            )
        return np.asarray(kept)

    def _metres(self, channel: Channel, rows: np.ndarray) -> np.ndarray:
        """`depth` (N, H, W), or `cloud` (N, h, w, 3) of even pixels, float32 [m]."""
        assert self.depth is not None
        counts, step = self.depth.at(rows), np.float32(DEPTH_STEP_M)
        if channel.encoding == "depth":
            return counts * step
        down, across = features.even(*counts.shape[1:])
        rays = np.stack([each[down, across] for each in self.rays])[self.parts[rows]]
        return np.asarray(counts[:, down, across, None] * step * rays)


def _masks(part: Part, camera: str) -> list[np.ndarray]:
    """The masks of the episodes of a part; without other backgrounds all pixels are kept."""
    found = part.backdrops.get(camera)
    if found is not None:
        return [found.masks[name] for name in part.episodes.items]
    film = part.films[camera]
    rows = (film.height, -(-film.width // 8))
    return [np.broadcast_to(np.uint8(255), (steps, *rows)) for steps in part.lengths]


def _rays(part: Part, name: str) -> np.ndarray:
    camera = part.films[name].camera
    assert camera is not None
    return cameras.rays(camera.height, camera.width, camera.matrix()).astype(np.float32)
