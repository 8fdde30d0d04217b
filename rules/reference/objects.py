"""Kinds of objects in a reference world: their options and construction.

A new kind is a class with a literal `kind` and a `parts()`, listed in `ThingOptions`.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.scenes.world import Hinge, Part
from dextera_build.geometry import transforms
from dextera_build.rule import Fraction

from . import solids, textures, walls
from .assembly import Assembly
from .basket import Basket
from .on_table import Placed


class Carton(Placed):
    """A cardboard box with printed faces."""

    kind: Literal["carton"]
    mass_kg: PositiveFloat = 0.46
    """Mass with its contents [kg]."""
    friction: PositiveFloat = 0.42
    """Sliding friction coefficient of cardboard."""
    size_m: tuple[PositiveFloat, PositiveFloat, PositiveFloat] = (0.11, 0.06, 0.18)
    """Width, depth, height [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.9, 0.72, 0.2)
    """Ground colour, sRGB."""
    accent: tuple[Fraction, Fraction, Fraction] = (0.75, 0.15, 0.12)
    """Colour of the print, sRGB."""
    brand: str = "CRUNCH"
    """The large print."""
    line: str = "OAT & HONEY"
    """The small print."""

    def parts(self) -> dict[str, Part]:
        """The box."""
        atlas = textures.carton(self.brand, self.line, self.colour, self.accent, self.seed)
        box = solids.box(self.size_m, atlas, atlas=True)
        return {"box": Part(mesh=box, gloss=0.15, pieces=walls.whole(box))}


class Cylinder(Placed):
    """A can or jar: a solid cylinder with a band."""

    kind: Literal["cylinder"]
    mass_kg: PositiveFloat = 0.4
    """Mass of the full can [kg]."""
    friction: PositiveFloat = 0.34
    """Sliding friction coefficient of a printed can."""
    radius_m: PositiveFloat = 0.035
    """Radius [m]."""
    height_m: PositiveFloat = 0.12
    """Height [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.75, 0.76, 0.78)
    """sRGB."""
    band: tuple[Fraction, Fraction, Fraction] = (0.2, 0.5, 0.25)
    """Colour of the label, sRGB."""

    def parts(self) -> dict[str, Part]:
        """The can."""
        r, h = self.radius_m, self.height_m
        profile = np.array([[0, 0], [r - 0.001, 0], [r, 0.001], [r, h - 0.001], [r - 0.001, h], [0, h]])
        whole = 2 * r + h
        ends = ((r + 0.1 * h) / whole, (r + 0.9 * h) / whole)
        picture = textures.banded(textures.plain(512, 1024, self.colour, 0.02, 8, self.seed), ((*ends, self.band),))
        can = solids.turned(profile, picture)
        return {"can": Part(mesh=can, gloss=0.4, pieces=walls.whole(can))}


class Bowl(Placed):
    """A hollow round bowl with a foot."""

    kind: Literal["bowl"]
    mass_kg: PositiveFloat = 0.42
    """Mass of the stoneware [kg]."""
    friction: PositiveFloat = 0.5
    """Sliding friction coefficient of glazed stoneware on an unglazed foot."""
    radius_m: PositiveFloat = 0.075
    """Outer radius of the rim [m]."""
    foot_radius_m: PositiveFloat = 0.036
    """Radius of the foot [m]."""
    height_m: PositiveFloat = 0.058
    """Height [m]."""
    wall_m: PositiveFloat = 0.005
    """Thickness of the wall [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.5, 0.51, 0.52)
    """sRGB."""
    speck: tuple[Fraction, Fraction, Fraction] = (0.28, 0.29, 0.3)
    """Colour of the specks, sRGB."""

    def parts(self) -> dict[str, Part]:
        """The shell."""
        t = np.linspace(0, np.pi / 2, 18)
        rise = self.height_m - 0.006
        outer = np.c_[
            self.foot_radius_m + (self.radius_m - self.foot_radius_m) * np.sin(t), 0.006 + rise * (1 - np.cos(t))
        ]
        span, depth = self.radius_m - self.wall_m, self.height_m - self.wall_m
        inner = np.c_[span * np.sin(t) ** 0.9, self.wall_m + depth * (1 - np.cos(t))][::-1]
        middle = (outer[-1] + inner[0]) / 2 + [0, 0.0012]
        foot = [[0, 0], [self.foot_radius_m - 0.001, 0], [self.foot_radius_m, 0.001]]
        profile = np.concatenate([foot, outer, [middle], inner[:-1], [[0, self.wall_m]]])
        picture = textures.speckled(768, 1536, self.colour, self.speck, 0.3, self.seed)
        shell = solids.turned(profile, picture)
        return {"shell": Part(mesh=shell, gloss=0.5, pieces=walls.vessel(profile))}


class Mug(Placed):
    """A hollow mug with a handle towards its +x."""

    kind: Literal["mug"]
    mass_kg: PositiveFloat = 0.31
    """Mass of the ceramic [kg]."""
    friction: PositiveFloat = 0.5
    """Sliding friction coefficient of glazed ceramic."""
    radius_m: PositiveFloat = 0.041
    """Outer radius [m]."""
    height_m: PositiveFloat = 0.095
    """Height [m]."""
    wall_m: PositiveFloat = 0.004
    """Thickness of the wall [m]."""
    reach_m: PositiveFloat = 0.030
    """Protrusion of the handle [m]."""
    colour: tuple[Fraction, Fraction, Fraction] = (0.12, 0.28, 0.62)
    """sRGB."""
    band: tuple[Fraction, Fraction, Fraction] = (0.93, 0.93, 0.9)
    """Colour of the ring, sRGB."""

    def parts(self) -> dict[str, Part]:
        """The shell and the handle, which ends inside the wall."""
        r, h, w = self.radius_m, self.height_m, self.wall_m
        outer = [[0, 0], [r - 0.005, 0], [r - 0.0015, 0.0015], [r, 0.005], [r, h - 0.0015], [r - 0.001, h]]
        inner = [[r - w + 0.001, h], [r - w, h - 0.0015], [r - w, w + 0.006], [r - w - 0.006, w], [0, w]]
        profile = np.array(outer + inner)
        length = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(profile, axis=0), axis=1))])
        base, top = length[3] / length[-1], length[4] / length[-1]
        rings = tuple(
            (base + a * (top - base), base + b * (top - base), self.band) for a, b in ((0.72, 0.78), (0.82, 0.84))
        )
        glaze = textures.plain(768, 1024, self.colour, 0.03, 6, self.seed)
        angle = np.linspace(-np.pi / 2, np.pi / 2, 28)
        path = np.c_[
            r - w / 2 + (self.reach_m + w / 2 - 0.005) * np.cos(angle) ** 0.8,
            np.zeros(28),
            0.52 * h + 0.30 * h * np.sin(angle),
        ]
        handle = solids.tube(path, 0.0065, 0.0045, glaze[:256, :256])
        shell = solids.turned(profile, textures.banded(glaze, rings))
        return {
            "shell": Part(mesh=shell, gloss=0.6, pieces=walls.vessel(profile)),
            "handle": Part(mesh=handle, gloss=0.6, pieces=walls.bar(handle, len(path))),
        }


class Laptop(Placed):
    """An open laptop; its user sits at -y."""

    kind: Literal["laptop"]
    mass_kg: PositiveFloat = 1.6
    """Mass of base and lid together [kg]."""
    friction: PositiveFloat = 0.55
    """Sliding friction coefficient of its rubber feet."""
    width_m: PositiveFloat = 0.32
    """Width [m]."""
    depth_m: PositiveFloat = 0.22
    """Depth of the base [m]."""
    base_m: PositiveFloat = 0.016
    """Thickness of the base [m]."""
    lid_m: PositiveFloat = 0.007
    """Thickness of the lid [m]."""
    opening_deg: float = Field(110.0, ge=0.0, le=180.0)
    """Angle between the display and the keyboard; 0 is closed [deg]."""
    widest_deg: float = Field(135.0, gt=0.0, le=360.0)
    """Maximum opening of the hinge [deg]."""
    lid_kg: PositiveFloat = 0.4
    """Mass of the lid, included in the total [kg]."""
    hinge_friction_nm: NonNegativeFloat = 0.8
    """Dry friction of the hinge [N m]; holding this lid against gravity takes 0.43 N m."""
    hinge_damping_nms_rad: NonNegativeFloat = 0.03
    """Viscous damping of the hinge [N m s/rad]."""

    def hinge(self) -> Hinge:
        """The hinge along the back edge; positive motion opens."""
        x, y, z = (float(value) for value in self._axis())
        return Hinge(
            parts=("lid",),
            origin=(x, y, z),
            axis=(-1.0, 0.0, 0.0),
            lower=0.0,
            upper=float(np.radians(self.widest_deg)),
            position=float(np.radians(self.opening_deg)),
            friction_nm=self.hinge_friction_nm,
            damping_nms_rad=self.hinge_damping_nms_rad,
            mass_kg=self.lid_kg,
        )

    def _axis(self) -> np.ndarray:
        return np.array([0.0, self.depth_m / 2 - 0.006, self.base_m + 0.002])

    def parts(self) -> dict[str, Part]:
        """Base, lid and hinge barrel."""
        base = solids.slab((self.width_m, self.depth_m, self.base_m), 0.012, 0.0015, textures.keyboard(self.seed))
        picture = textures.screen(self.seed)
        half = len(picture) // 2
        # The display is on the other side of the lid: its upper edge is at -y of the closed lid.
        picture = np.concatenate([picture[:half], picture[half:][::-1]])
        lid = solids.slab((self.width_m, self.depth_m - 0.008, self.lid_m), 0.010, 0.001, picture)
        angle = -np.radians(self.opening_deg)
        c, s = np.cos(angle), np.sin(angle)
        axis = self._axis()
        opened = transforms.rigid(np.array([[1, 0, 0], [0, c, -s], [0, s, c]]), axis)
        closed = transforms.rigid(np.eye(3), np.array([0, -(self.depth_m - 0.008) / 2 + 0.002, -0.001]))
        barrel = np.array([[0, 0], [0.0055, 0], [0.0055, 0.7 * self.width_m], [0, 0.7 * self.width_m]])
        turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
        along = transforms.rigid(turn, axis - [0.35 * self.width_m, 0, 0.001])
        hinge = solids.turned(barrel, textures.plain(64, 64, (0.2, 0.2, 0.21), 0.02, 4, self.seed), 24)
        lid, hinge = solids.moved(lid, opened @ closed), solids.moved(hinge, along)
        return {
            "base": Part(mesh=base, gloss=0.3, pieces=walls.whole(base)),
            "lid": Part(mesh=lid, gloss=0.5, pieces=walls.whole(lid)),
            "hinge": Part(mesh=hinge, gloss=0.3, pieces=walls.whole(hinge)),
        }


ThingOptions = Annotated[Carton | Cylinder | Bowl | Basket | Mug | Laptop | Assembly, Field(discriminator="kind")]
"""Any kind of object."""
