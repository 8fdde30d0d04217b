"""Objects of a reference world assembled from boxes and cylinders, described in a recipe."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.scenes.world import Hinge, Part
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import lie, transforms
from dextera_build.rule import Fraction, Options

from . import solids, textures, walls
from .on_table import Placed


class BlockOptions(Options):
    """A box or a cylinder of an assembly."""

    shape: Literal["box", "cylinder"] = "box"
    """Shape; a cylinder stands along z with diameter `size_m[0]`."""
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat]
    """Extents along x, y, z before the rotation [m]."""
    at_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Centre of its base in the object's frame [m]."""
    turn_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Rotations about the object's x, then y, then z axis through that point [deg]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.5, 0.5, 0.5)
    """sRGB."""
    gloss: Fraction = 0.3
    """Strength of highlights, 0..1."""

    def part(self, seed: int) -> Part:
        """The block in the object's frame."""
        picture = textures.plain(256, 256, self.colour, 0.03, 6, seed)
        mesh = solids.moved(self._standing(picture), self._pose())
        return Part(mesh=mesh, gloss=self.gloss, pieces=walls.whole(mesh))

    def _standing(self, picture: np.ndarray) -> Mesh:
        if self.shape == "box":
            return solids.box(self.size_m, picture)
        radius, height = self.size_m[0] / 2, self.size_m[2]
        return solids.turned(np.array([[0, 0], [radius, 0], [radius, height], [0, height]]), picture)

    def _pose(self) -> np.ndarray:
        turn = np.eye(3)
        for axis, angle in zip(np.eye(3), np.radians(self.turn_deg), strict=True):
            turn = lie.rotation(axis * angle) @ turn
        return transforms.rigid(turn, np.array(self.at_m))


class HingeOptions(Options):
    """The hinge of an assembly. Its blocks are described as in the photograph."""

    parts: tuple[str, ...] = Field(min_length=1)
    """The blocks that move relative to the others."""
    origin_m: tuple[float, float, float]
    """A point on the axis, in the object's frame [m]."""
    axis: tuple[float, float, float]
    """Direction; positive motion follows the right-hand rule."""
    range_deg: tuple[float, float]
    """Limits [deg]."""
    position_deg: float
    """Position in the photograph [deg]."""
    friction_nm: NonNegativeFloat = 0.02
    """Dry friction [N m]."""
    damping_nms_rad: NonNegativeFloat = 0.002
    """Viscous damping [N m s/rad]."""
    mass_kg: PositiveFloat
    """Mass of the moving parts, included in the total [kg]."""


class Assembly(Placed):
    """An object of boxes and cylinders that overlap or touch, with a hinge or rigid."""

    kind: Literal["assembly"]
    blocks: dict[str, BlockOptions] = Field(min_length=1)
    """Its parts by name; the lowest stands on z = 0."""
    moves: HingeOptions | None = None
    """Its hinge."""

    def parts(self) -> dict[str, Part]:
        """The blocks."""
        return {name: block.part(self.seed + number) for number, (name, block) in enumerate(self.blocks.items())}

    def hinge(self) -> Hinge | None:
        """The hinge, if any."""
        if self.moves is None:
            return None
        moves, axis = self.moves, np.array(self.moves.axis, np.float64)
        x, y, z = (float(value) for value in axis / np.linalg.norm(axis))
        return Hinge(
            parts=moves.parts,
            origin=moves.origin_m,
            axis=(x, y, z),
            lower=float(np.radians(moves.range_deg[0])),
            upper=float(np.radians(moves.range_deg[1])),
            position=float(np.radians(moves.position_deg)),
            friction_nm=moves.friction_nm,
            damping_nms_rad=moves.damping_nms_rad,
            mass_kg=moves.mass_kg,
        )
