"""A rigid model at trial poses: renders, scores and distances from one ray-casting structure."""

from __future__ import annotations

import copy
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.objects.object import Body
from dextera_build.artifacts.objects.view import Seen
from dextera_build.geometry import cameras, planes, raycast
from dextera_build.geometry.registration import ScaledPose

from ..canonical import bodies

FREE_SPACE_M = 0.01
"""Distance in front of the measured surface above which a model surface is in free space [m]."""


MOST = 1500
"""Maximum number of points on each side of a registration."""


@dataclass(frozen=True)
class Score:
    """Agreement of a placed model with the view, without occluded pixels."""

    iou: float  # between the rendered and the seen mask
    residual_m: float  # mean |depth difference|, capped at 2 cm, over common pixels [m]
    violation: float  # fraction of the rendered pixels in free space

    @property
    def cost(self) -> float:
        """A scalar for comparing poses; lower is better."""
        return (1.0 - self.iou) + self.residual_m / 0.02 + self.violation


@dataclass(frozen=True)
class Compared:
    """A placed model and the view, per ray: arrays (h, w) or (h, w, 3) in the axes of the world."""

    depth: np.ndarray  # of the model [m], inf without a hit
    normals: np.ndarray  # of the model, unit, towards the camera
    seen: np.ndarray  # measured depth [m], 0 if there is none
    mask: np.ndarray  # bool
    known: np.ndarray  # bool, not hidden by anything nearer
    origin: np.ndarray  # (3,) the camera's position [m]
    directions: np.ndarray  # of the rays, image-plane depth 1
    k: np.ndarray  # (3, 3) intrinsics [px]
    turn: np.ndarray  # (3, 3) R_world_camera
    stride: float  # pixels per ray

    @property
    def drawn(self) -> np.ndarray:
        """Rays that hit the model, (h, w) bool."""
        return np.asarray(np.isfinite(self.depth))

    @property
    def points(self) -> np.ndarray:
        """Hit points, (h, w, 3) [m]; the camera's position for rays without a hit."""
        return np.asarray(self.origin + np.where(self.drawn, self.depth, 0.0)[..., None] * self.directions)

    def pixel_slopes(self, at: np.ndarray, outward: np.ndarray) -> np.ndarray:
        """Vectors (N, 3) whose product with a motion of the point [m] is the motion of its image along `outward` [px].

        Args:
            at: (h, w) bool, N rays that hit the model.
            outward: (N, 2) unit directions in the image, right and down.
        """
        local = self.directions[at] @ self.turn
        right, down = outward[:, 0] * self.k[0, 0], outward[:, 1] * self.k[1, 1]
        slopes = np.column_stack([right, down, -(right * local[:, 0] + down * local[:, 1])]) / self.depth[at, None]
        return np.asarray(slopes @ self.turn.T)


class ModelView:
    """A model in front of one camera.

    Args:
        vertices: (V, 3) in model units.
        faces: (F, 3) int.
        seen: The view to compare with.
        pixels: Approximate number of rays per render.

    Attributes:
        noise_m: Standard deviation of the object's depth [m]; 0 without depth.
    """

    def __init__(self, vertices: np.ndarray, faces: np.ndarray, seen: Seen, pixels: int = 20000) -> None:
        self._scene = raycast.RayScene((vertices, faces))
        self._watch(seen, pixels)

    def coarser(self, seen: Seen, pixels: int) -> ModelView:
        """The same model before the same view, with fewer rays."""
        other = copy.copy(self)
        other._watch(seen, pixels)
        return other

    def _watch(self, seen: Seen, pixels: int) -> None:
        height, width = seen.mask.shape
        stride = max(1, round(float(np.sqrt(height * width / pixels))))
        rows, columns = slice(stride // 2, None, stride), slice(stride // 2, None, stride)
        self._k, self._turn, self._stride = seen.camera.matrix(), seen.world_from_camera[:3, :3], float(stride)
        self._directions = cameras.rays(height, width, self._k)[rows, columns] @ self._turn.T
        self._origin = seen.world_from_camera[:3, 3]
        self._depth = seen.depth[rows, columns].astype(np.float64)
        self._known = ~seen.occluder[rows, columns]
        self._mask = seen.mask[rows, columns]
        measured = seen.depth[seen.mask & (seen.depth > 0.0)]
        self.noise_m = float(planes.depth_sigma(np.median(measured))) if len(measured) else 0.0

    def visible(self, placed: ScaledPose) -> tuple[np.ndarray, np.ndarray]:
        """Model-frame points (N, 3) and outward normals (N, 3) visible to the camera, without occluded ones."""
        depth, normals = self._cast(placed)
        here = np.isfinite(depth) & self._known
        thin = slice(None, None, max(1, int(here.sum()) // MOST))
        points = self._origin + depth[here][thin, None] * self._directions[here][thin]
        return placed.unapply(points), normals[here][thin]

    def score(self, placed: ScaledPose) -> Score:
        """Compare the render of the placed model with the view."""
        depth, _ = self._cast(placed)
        drawn = np.isfinite(depth) & self._known
        seen = self._mask & self._known
        union = int((drawn | seen).sum())
        both = drawn & seen & (self._depth > 0.0)
        difference = np.abs(depth[both] - self._depth[both])
        residual = float(np.minimum(difference, 0.02).mean()) if both.any() else 0.02
        in_front = drawn & (self._depth > 0.0) & (np.where(drawn, depth, 0.0) < self._depth - FREE_SPACE_M)
        violation = float(in_front.sum() / max(int(drawn.sum()), 1))
        return Score(float((drawn & seen).sum() / union) if union else 0.0, residual, violation)

    def compare(self, placed: ScaledPose) -> Compared:
        """The placed model and the view."""
        depth, normals = self._cast(placed)
        return Compared(
            depth=depth,
            normals=normals @ placed.pose[:3, :3].T,
            seen=self._depth,
            mask=self._mask,
            known=self._known,
            origin=self._origin,
            directions=self._directions,
            k=self._k,
            turn=self._turn,
            stride=self._stride,
        )

    def painted(self, placed: ScaledPose, body: Body) -> tuple[np.ndarray, np.ndarray]:
        """Unlit colours (h, w, 3), 0..1, of the placed body, and its pixels inside the mask, (h, w) bool."""
        hits = self._hits(placed)
        where = np.isfinite(hits.distance) & self._known & self._mask
        weights = hits.weights[where].astype(np.float64)
        corners = np.column_stack([1.0 - weights.sum(axis=1), weights])
        pixels = np.zeros((*where.shape, 3))
        pixels[where] = bodies.paint(body, hits.face[where].astype(np.int64), corners)
        return pixels, where

    def thinned(self, pixels: np.ndarray) -> np.ndarray:
        """The pixels of the crop (H, W, ...) through which rays are cast."""
        step = int(self._stride)
        return pixels[step // 2 :: step, step // 2 :: step]

    def distances(self, placed: ScaledPose, points: np.ndarray) -> np.ndarray:
        """Distance (N,) of world points to the placed surface [m]."""
        return np.asarray(self._scene.distances(placed.unapply(points)) * placed.scale, np.float64)

    def model_distances(self, points: np.ndarray) -> np.ndarray:
        """Distance (N,) of model points (N, 3) to the surface, in model units."""
        return self._scene.distances(points).astype(np.float64)

    def _cast(self, placed: ScaledPose) -> tuple[np.ndarray, np.ndarray]:
        """Depth (h, w) [m], inf if empty, and model-frame normals (h, w, 3) towards the camera."""
        hits = self._hits(placed)
        directions = self._directions @ placed.pose[:3, :3]
        normals = hits.normals.astype(np.float64)
        away = (normals * directions).sum(axis=-1) > 0.0
        return hits.distance.astype(np.float64), np.where(away[..., None], -normals, normals)

    def _hits(self, placed: ScaledPose) -> raycast.Hits:
        # Rays are transformed to the model's frame; their parameter, and so the depth, is unchanged.
        rotation = placed.pose[:3, :3]
        origin = (self._origin - placed.pose[:3, 3]) @ rotation / placed.scale
        directions = self._directions @ rotation / placed.scale
        rays = np.concatenate([np.broadcast_to(origin, directions.shape), directions], axis=-1)
        return self._scene.cast(rays)


def seen_points(seen: Seen, most: int = MOST) -> np.ndarray:
    """World points (N, 3) of the object's valid pixels, thinned evenly to about `most`."""
    points = seen.world_points(seen.mask & (seen.depth > 0.0))
    return points[:: max(1, len(points) // most)]
