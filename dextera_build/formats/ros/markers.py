"""`visualization_msgs/MarkerArray`: shapes in frames, which RViz and Foxglove draw (layout of Humble and later)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dextera_build.formats.ros.cdr import Cdr

CUBE, TRIANGLES = 1, 11
"""`Marker.CUBE`, `Marker.TRIANGLE_LIST`."""


@dataclass(frozen=True)
class Marker:
    """A shape that follows its frame."""

    frame: str
    """Frame that it is fixed to."""
    name: str
    """Its namespace: unique in the topic."""
    kind: int
    """`CUBE` or `TRIANGLES`."""
    colour: tuple[float, float, float, float]
    """Red, green, blue and opacity, 0..1; for triangles with `colours` only the opacity is used."""
    pose: np.ndarray = field(default_factory=lambda: np.array([0.0, 0, 0, 1, 0, 0, 0]))
    """Position [m] and quaternion w x y z (7,) in the frame."""
    size: np.ndarray = field(default_factory=lambda: np.ones(3))
    """Edges of a cube (3,) [m]; factors for triangles."""
    points: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    """(3 F, 3) float64 corners of triangles [m]."""
    colours: np.ndarray = field(default_factory=lambda: np.zeros((0, 4), np.float32))
    """(3 F, 4) float32 of the corners, or none."""


def marker_array(stamp: int, markers: Sequence[Marker]) -> bytes:
    """The message as CDR; `stamp` in nanoseconds."""
    message = Cdr().u32(len(markers))
    for marker in markers:
        message.i32(stamp // 1_000_000_000).u32(stamp % 1_000_000_000).string(marker.frame)
        message.string(marker.name).i32(0, marker.kind, 0)
        message.f64(marker.pose[:3]).f64(np.roll(marker.pose[3:], -1)).f64(marker.size).f32(marker.colour)
        message.i32(0).u32(0).boolean(True)  # unlimited lifetime, locked to its frame
        message.rows(np.asarray(marker.points, np.float64)).rows(np.asarray(marker.colours, np.float32))
        message.string("").i32(0).u32(0).string("").string("").u8s(b"")  # no texture
        message.u32(0).string("").string("").string("").u8s(b"").boolean(False)  # no text, no mesh file
    return message.bytes()
