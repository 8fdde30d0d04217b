"""A closed room around the visible scene: floor, four walls, ceiling; unobserved ones are invented."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import lie

from .pieces import Piece, quad
from .scenery import Scenery
from .synthesis import membrane, smooth_part

TABLE_M = 0.74
"""Assumed height of a table over an unobserved floor [m]."""
ROOM_M = 2.5
"""Minimum height of a room [m]."""
BEYOND_M = 1.0
"""Distance of an unobserved wall from the last visible point before it [m]."""
BACK_M = 1.2
"""Distance of an unobserved wall from the camera [m]."""
HEAD_M = 0.3
"""Distance of the ceiling above the camera and the highest visible point [m]."""
GAP_M = 0.02
"""Distance of a wall behind its observed plane [m]."""
TEXELS = 192
"""Edge of a wall's picture."""
SOFT = 0.06
"""Colours of unobserved walls are blended over this fraction of their edge."""


@dataclass(frozen=True)
class Room:
    """An upright box of the world."""

    yaw: float
    """Direction of its first axis [rad]."""
    low: np.ndarray
    """(3,) corner in the room's axes [m]."""
    high: np.ndarray
    """(3,) opposite corner [m]."""
    known: tuple[bool, ...]
    """Whether a plane was observed of: the walls at low and high first axis, those of the second, the floor."""

    @property
    def axes(self) -> np.ndarray:
        """(3, 3) rows are the room's axes in the world."""
        return lie.about_z(-self.yaw)

    def holds(self, points: np.ndarray, margin: float = 0.0) -> np.ndarray:
        """Which world points (..., 3) are inside."""
        local = points @ self.axes.T
        return np.asarray(((local > self.low - margin) & (local < self.high + margin)).all(axis=-1))


def enclose(scenery: Scenery, outline: np.ndarray, yaw: float) -> Room:
    """The room that contains all visible points, the support and the camera.

    Args:
        scenery: The visible empty scene.
        outline: (P, 2) outline of the support [m].
        yaw: Direction of the room if no wall was observed [rad].
    """
    planes = scenery.planes()
    walls = sorted((p for p in planes if abs(p[0][2]) < 0.1), key=lambda p: -p[2])
    if walls:
        yaw = float(np.arctan2(walls[0][0][1], walls[0][0][0]))
        yaw = (yaw + np.pi / 4) % (np.pi / 2) - np.pi / 4
    axes = Room(yaw, np.zeros(3), np.zeros(3), ()).axes
    table = np.concatenate([outline, np.zeros((len(outline), 1))], axis=1) @ axes.T
    eye = scenery.world_from_camera[:3, 3] @ axes.T
    seen = np.concatenate([scenery.points @ axes.T, table])
    low, high, known = np.zeros(3), np.zeros(3), []
    for axis in (0, 1):
        for sign, bound in ((-1, low), (1, high)):
            edge = float(np.quantile(sign * seen[:, axis], 0.995))
            at = [-p[1] * float(p[0] @ axes[axis]) for p in walls if abs(p[0] @ axes[axis]) > 0.98]
            plane = max((sign * a for a in at), default=-np.inf)
            is_known = plane > edge - 0.15 and plane > sign * eye[axis]
            far = max(edge, plane) + GAP_M if is_known else edge + BEYOND_M
            bound[axis] = sign * max(far, sign * eye[axis] + BACK_M * (not is_known))
            known.append(bool(is_known))
    heights = seen[:, 2]
    floors = [-p[1] / p[0][2] for p in planes if p[0][2] > 0.99 and -p[1] < -0.3]
    lowest = min(-TABLE_M, float(np.quantile(heights, 0.002)) - GAP_M)
    low[2] = min(floors) - GAP_M / 2 if floors else lowest
    high[2] = max(low[2] + ROOM_M, float(np.quantile(heights, 0.998)) + HEAD_M, eye[2] + HEAD_M)
    return Room(yaw, low, high, (*known, bool(floors)))


def shell(room: Room, scenery: Scenery) -> list[Piece]:
    """Floor, walls and ceiling, visible from inside; their colours continue the visible parts."""
    (x0, y0, z0), (x1, y1, z1) = room.low, room.high
    # From inside: upper left, lower left, lower right, upper right.
    sides = (
        [[x0, y0, z1], [x0, y0, z0], [x0, y1, z0], [x0, y1, z1]],
        [[x1, y1, z1], [x1, y1, z0], [x1, y0, z0], [x1, y0, z1]],
        [[x1, y0, z1], [x1, y0, z0], [x0, y0, z0], [x0, y0, z1]],
        [[x0, y1, z1], [x0, y1, z0], [x1, y1, z0], [x1, y1, z1]],
        [[x0, y1, z0], [x0, y0, z0], [x1, y0, z0], [x1, y1, z0]],
        [[x0, y0, z1], [x0, y1, z1], [x1, y1, z1], [x1, y0, z1]],
    )
    corners = [np.array(side) @ room.axes for side in sides]
    # Without depth, all pixels that are not the support are on the walls and the floor.
    alone = not len(scenery.points)
    painted = [scenery.colours(_texels(c), 0.25, unmeasured=alone) for c in corners]
    mean = scenery.pixels.reshape(-1, 3).mean(axis=0)
    walls = [colour[shown] for colour, shown in painted[:4] if shown.any()]
    wall = np.concatenate(walls).mean(axis=0) if walls else mean
    neutral = [wall] * 4 + [0.55 * np.full(3, mean.mean()), 0.4 * wall + 0.6 * 235.0]
    return [
        quad(c, _continued(colour, shown, np.asarray(plain)))
        for c, (colour, shown), plain in zip(corners, painted, neutral, strict=True)
    ]


def _texels(corners: np.ndarray) -> np.ndarray:
    """World points (TEXELS, TEXELS, 3) of the texels' centres."""
    share = (np.arange(TEXELS) + 0.5) / TEXELS
    right, down = corners[3] - corners[0], corners[1] - corners[0]
    return np.asarray(corners[0] + share[None, :, None] * right + share[:, None, None] * down)


def _continued(colour: np.ndarray, shown: np.ndarray, plain: np.ndarray) -> np.ndarray:
    """The visible colours, blended to the plain colour with the distance."""
    import cv2

    if shown.mean() < 0.002:
        return np.full((TEXELS, TEXELS, 3), np.clip(plain, 0, 255), np.uint8)
    # Prevent single objects at the border of the visible part from being extended as stripes.
    smooth = smooth_part(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown, SOFT * TEXELS)
    away = cv2.distanceTransform((~shown).astype(np.uint8), cv2.DIST_L2, 3) / TEXELS
    near = np.clip(1.0 - away / SOFT, 0.0, 1.0)[..., None]
    own = membrane(np.where(shown[..., None], colour, 0.0).astype(np.float32), shown)
    fade = np.clip(away / 0.5, 0.0, 1.0)[..., None]
    soft = own * near + smooth * (1 - near)
    return np.asarray(np.clip(soft * (1 - fade) + plain * fade, 0, 255), np.uint8)
