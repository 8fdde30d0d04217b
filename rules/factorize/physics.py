"""factorize.physics: mass, inertia and contact of every link, with their uncertainty."""

from __future__ import annotations

import math

from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.object import Body, Inertial, Link, Physics
from dextera_build.artifacts.view import Traits
from dextera_build.errors import did_you_mean, listing
from dextera_build.geometry import massprops
from dextera_build.geometry.materials import TABLE, Material
from dextera_build.rule import Context, Options, rule

NINETY = 1.6449
"""Half width of a central 90 % interval of a normal distribution, in standard deviations."""


class PhysicsOptions(Options):
    """Options of factorize.physics."""

    material: str = ""
    """Key of the material table; empty uses the material proposed by parsing."""
    mass_kg: PositiveFloat | None = None
    """Weighed mass of the whole body [kg]; None estimates it from material and volume."""
    mass_sigma: NonNegativeFloat = 0.02
    """Relative standard deviation of `mass_kg`."""
    volume_sigma: NonNegativeFloat = 0.10
    """Relative standard deviation of the volume of a body without a cavity, half of which is unseen."""
    wall_sigma: NonNegativeFloat = 0.35
    """Relative standard deviation of the volume of walls; their thickness is mostly assumed."""


@rule(version=2)
def physics(ctx: Context, body: Body, traits: Traits, *, options: PhysicsOptions) -> Physics:
    """Return mass properties of every link, in the object frame with all joints at 0, in SI units of the unscaled body.

    The mass of a body with a cavity is the material's density times the volume of its walls. Any other body has unseen
    contents and voids, so the bulk density of such products is used.
    """
    name = options.material or traits.material
    if name not in TABLE:
        hint = did_you_mean(name, TABLE) or "set `material` of the element in `scene.yaml` to one that exists"
        ctx.fail(f"no material is called `{name}`", hint=hint, exist=listing(TABLE))
    material = TABLE[name]
    density, sigma, source = _density(material, name, body.hollow, options)
    solids = {label: _solid(ctx, label, link) for label, link in body.links.items()}
    if options.mass_kg is not None:
        density = options.mass_kg / sum(solid.volume for solid in solids.values())
        sigma, source = options.mass_sigma, "weighed"
    links = {label: _inertial(solid, density, sigma, source) for label, solid in solids.items()}
    mass = sum(link.mass_kg for link in links.values())
    low, high = (mass * math.exp(side * NINETY * sigma) for side in (-1, 1))
    ctx.metric("mass", mass, "kg")
    ctx.metric("volume", sum(solid.volume for solid in solids.values()) * 1e6, "cm3")
    ctx.say(f"{_grams(mass)} ({_grams(low)} to {_grams(high)}), {source}, friction {material.friction:.2f}")
    return Physics(
        links=links,
        friction=material.friction,
        friction_sigma=material.friction_sigma,
        restitution=material.restitution,
        restitution_sigma=material.restitution_sigma,
        material=name,
        weighed=options.mass_kg is not None,
    )


def _density(material: Material, name: str, hollow: bool, options: PhysicsOptions) -> tuple[float, float, str]:
    """Density [kg/m^3], standard deviation of the log mass, and a description."""
    if hollow:
        sigma = math.hypot(material.wall_sigma, options.wall_sigma)
        return material.wall_density, sigma, f"material table: {name}, walls at {material.wall_density:.0f} kg/m3"
    sigma = math.hypot(material.bulk_sigma, options.volume_sigma)
    return material.bulk_density, sigma, f"material table: {name}, whole at {material.bulk_density:.0f} kg/m3"


def _solid(ctx: Context, label: str, link: Link) -> massprops.MassProperties:
    mesh = link.mesh
    hint = "the mesh of this link must be closed, see `factorize.mesh` and `factorize.articulate`"
    ctx.check(mesh.is_closed, f"link `{label}` is open, it has no volume", hint=hint)
    try:
        solid = massprops.of_mesh(mesh.vertices, mesh.faces)
    except ValueError as error:
        ctx.fail(f"link `{label}` has no mass: {error}", hint=hint)
    ctx.check(
        massprops.is_physical(solid.inertia),
        f"link `{label}`: the principal moments break the triangle inequality",
        hint=hint,
        moments=massprops.principal(solid.inertia),
    )
    return solid


def _inertial(solid: massprops.MassProperties, density: float, sigma: float, source: str) -> Inertial:
    mass = density * solid.volume
    x, y, z = (float(value) for value in solid.centre)
    return Inertial(
        mass_kg=mass,
        mass_low_kg=mass * math.exp(-NINETY * sigma),
        mass_high_kg=mass * math.exp(NINETY * sigma),
        centre=(x, y, z),
        inertia=massprops.six(solid.inertia * density),
        source=source,
    )


def _grams(kilograms: float) -> str:
    return f"{kilograms:.2f} kg" if kilograms >= 1.0 else f"{kilograms * 1000:.0f} g"
