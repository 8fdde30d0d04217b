"""The fixtures of a reference world: table, pedestal of the robot, floor, walls."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat, PositiveInt

from dextera_build.artifacts.scenes.world import Part, Thing
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import transforms
from dextera_build.rule import Fraction, Options

from . import solids, textures, walls


class TableOptions(Options):
    """A table with its top at z = 0."""

    centre_m: tuple[float, float] = (0.0, 0.0)
    """x and y of the centre [m]."""
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (1.4, 0.9, 0.035)
    """Width, depth, thickness of the top [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.62, 0.45, 0.30)
    """sRGB."""
    surface: Literal["wood", "plain", "speckled"] = "wood"
    """Surface of the top: boards, one colour, or a colour with specks."""
    planks: PositiveInt = 6
    """Number of boards of a wooden top."""
    gloss: Fraction = 0.25
    """Strength of highlights, 0..1."""
    seed: NonNegativeInt = 11
    """Seed of the grain."""

    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper corner of the top, (2,) each [m]."""
        half = np.array(self.size_m[:2]) / 2
        return np.array(self.centre_m) - half, np.array(self.centre_m) + half

    def parts(self) -> dict[str, Part]:
        """Top and legs, in the world frame."""
        x, y, z = self.size_m
        rows = round(2048 * y / x)
        grain, edge = self._picture(rows, self.planks, self.seed), self._picture(rows, 1, self.seed + 1)
        top = solids.slab(self.size_m, 0.02, 0.003, np.concatenate([grain, edge]))
        parts = {"table": Part(mesh=_at(top, (*self.centre_m, -z)), gloss=self.gloss)}
        steel = textures.plain(64, 64, (0.2, 0.2, 0.21), 0.03, 4, self.seed)
        for number, (i, j) in enumerate(((-1, -1), (1, -1), (-1, 1), (1, 1))):
            place = (self.centre_m[0] + i * (x / 2 - 0.06), self.centre_m[1] + j * (y / 2 - 0.06), -0.74)
            leg = _at(solids.box((0.05, 0.05, 0.74 - z), steel), place)
            parts[f"leg_{number}"] = Part(mesh=leg)
        return parts

    def _picture(self, rows: int, planks: int, seed: int) -> np.ndarray:
        if self.surface == "plain":
            return textures.plain(rows, 2048, self.colour, 0.03, 6, seed)
        if self.surface == "speckled":
            return textures.speckled(rows, 2048, self.colour, _darker(self.colour), 0.25, seed)
        return textures.wood(rows, 2048, self.colour, planks, seed)


def _darker(colour: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue = (0.55 * value for value in colour)
    return red, green, blue


class RoomOptions(Options):
    """Floor, back wall with a skirting board, and the robot's pedestal."""

    floor_z_m: float = -0.74
    """Height of the floor [m]."""
    wall_y_m: float = 1.9
    """y of the back wall [m]."""
    width_m: PositiveFloat = 5.0
    """Width of floor and wall [m]."""
    wall: tuple[Fraction, Fraction, Fraction] = (0.80, 0.81, 0.80)
    """sRGB."""
    floor: tuple[Fraction, Fraction, Fraction] = (0.47, 0.47, 0.46)
    """sRGB."""
    pedestal_m: tuple[float, float, float, float] | None = None
    """x and y of the centre, edge length, height of the top above z = 0 [m]; None omits the pedestal."""
    seed: NonNegativeInt = 21
    """Seed of the textures."""

    def parts(self) -> dict[str, Part]:
        """All parts, in the world frame."""
        w, z, y = self.width_m, self.floor_z_m, self.wall_y_m
        floor = textures.plain(1024, 1024, self.floor, 0.10, 6, self.seed)
        wall = textures.plain(512, 1024, self.wall, 0.025, 5, self.seed + 1)
        board = textures.plain(64, 512, (0.92, 0.92, 0.9), 0.02, 4, self.seed + 2)
        parts = {
            "floor": Part(mesh=_at(solids.box((w, w, 0.02), floor), (0, y - w / 2, z - 0.02)), gloss=0.1),
            "wall": Part(mesh=_at(solids.box((w, 0.05, 3.0), wall), (0, y + 0.025, z))),
            "skirting": Part(mesh=_at(solids.box((w, 0.015, 0.09), board), (0, y - 0.0075, z)), gloss=0.2),
        }
        if self.pedestal_m is not None:
            x, front, size, top = self.pedestal_m
            steel = textures.plain(256, 256, (0.30, 0.31, 0.33), 0.03, 8, self.seed + 3)
            block = _at(solids.box((size, size, top - z), steel), (x, front, z))
            parts["pedestal"] = Part(mesh=block, gloss=0.2)
        return parts


def fixture(name: str, part: Part) -> Thing:
    """A convex part, given in the world frame, as a static object."""
    whole = part.model_copy(update={"pieces": walls.whole(part.mesh)})
    pose = Pose(parent="reference", child="thing", matrix=np.eye(4))
    return Thing(parts={name: whole}, surface=solids.union([part.mesh]), pose=pose)


def _at(mesh: Mesh, place: tuple[float, float, float]) -> Mesh:
    return solids.moved(mesh, transforms.rigid(np.eye(3), np.array(place, np.float64)))
