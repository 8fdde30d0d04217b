"""factorize.physics: mass, inertia and contact of every link, with their uncertainty."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from pydantic import NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.objects import similar
from dextera_build.artifacts.objects.object import (
    Body,
    Certainty,
    Estimate,
    Inertial,
    Link,
    Physics,
    Placement,
    Rival,
    Support,
)
from dextera_build.artifacts.objects.view import Traits
from dextera_build.errors import did_you_mean, listing
from dextera_build.geometry import massprops
from dextera_build.geometry.materials import TABLE, Material, doubted, mixed
from dextera_build.rule import Context, Fraction, Options, rule
from dextera_build.statistics import Z90

from . import estimated, household

GAP = 0.05
"""Difference between two scores of `factorize.mesh` at which the odds of the hypotheses are e to 1."""
ENCLOSING = 0.85
"""Ratio of bulk to substance density below which a product is a container or has voids."""


class PhysicsOptions(Options):
    """Options of factorize.physics."""

    material: str = ""
    """Key of the material table, assumed certain; empty uses the material proposed by parsing."""
    material_confidence: Fraction = 0.9
    """Probability of the material proposed by parsing, if parsing states none."""
    mass_kg: PositiveFloat | None = None
    """Weighed mass of the whole body [kg]; None estimates it from material and volume."""
    mass_sigma: NonNegativeFloat = 0.02
    """Relative standard deviation of `mass_kg`."""
    volume_sigma: NonNegativeFloat = 0.10
    """Relative standard deviation of the volume of a body without a cavity, half of which is unseen, because of what is
    unseen; it is proportional to the unseen fraction. The shape's own `volume_sigma` is added in squares: of a body
    without depth, it contains the uncertainty of its sizes, and is usually the larger one. Both widen the interval of
    the mass by the material and by things of a household."""
    wall_sigma: NonNegativeFloat = 0.35
    """Relative standard deviation of the volume of walls; their thickness is mostly assumed."""
    shell_m: PositiveFloat = 0.0015
    """Wall thickness of a closed container with unknown contents [m]; gives the mass of an empty one."""
    stiffness_n_m: PositiveFloat | None = None
    """Contact stiffness of the surface, for soft objects [N/m]; None: that of a hard surface."""
    untold_sigma: NonNegativeFloat = 0.2
    """Relative standard deviation of the volume of a shape whose backend states no uncertainty, for masses by its
    material alone."""


@rule(version=6)
def physics(
    ctx: Context,
    body: Body,
    traits: Traits,
    placement: Placement | None = None,
    support: Support | None = None,
    *,
    options: PhysicsOptions,
) -> Physics:
    """Return mass properties of every link, in the object frame with all joints at 0, in SI units of the unscaled body.

    The reported mass and volume are those of the body at its scale, as they end in the twin; while the scale is not
    known, this is said instead.

    The mass of a body with a cavity is the material's density times the volume of its walls. Any other body has unseen
    contents and voids, so the bulk density of such products is used. If the material's products are containers, the
    mass is that of things of a household with about its size, shape and colour, see `household`, and friction and
    restitution are those of their materials, unless the material is certain; with joints, the interval extends down to
    the mass of the walls alone. Both need the size in metres, which `placement` and `support` give; without them,
    meshes are in metres. While it is unknown, neither is applied.

    The interval of the mass combines the uncertainties of the density, of the volume, of the unseen surface or the
    walls, and of the second-best hypothesis. The lower the confidence of the material, the more the intervals of
    density, friction and restitution include the other materials of the table.

    Where parsing states an estimate of mass, friction and restitution, they are combined with it, see `estimated`; not
    where `material` names another material than parsing did, nor with a weighed mass.
    """
    name = options.material or traits.material
    if name not in TABLE:
        hint = did_you_mean(name, TABLE) or "set `material` of the element in `scene.yaml` to one that exists"
        ctx.fail(f"no material is called `{name}`", hint=hint, exist=listing(TABLE))
    confidence = _confidence(traits, body, options)
    material = doubted(name, confidence)
    density, sigma, source = _density(material, name, body, options)
    solids = {label: _solid(ctx, label, link) for label, link in body.links.items()}
    if options.mass_kg is not None:
        density = options.mass_kg / sum(solid.volume for solid in solids.values())
        sigma, source = options.mass_sigma, "weighed"
    links = {label: _inertial(solid, density, sigma, source) for label, solid in solids.items()}
    size = _size(placement, support)
    estimate = traits.estimate if name == traits.material else None
    if options.mass_kg is None and size is not None:
        told = _told(traits, name, confidence, estimate)
        links, source, material = _compared(links, source, body, size, told, material, options)
    material = material if estimate is None else _touched(material, estimate)
    made = Physics(
        links=links,
        friction=material.friction,
        friction_sigma=material.friction_sigma,
        restitution=material.restitution,
        restitution_sigma=material.restitution_sigma,
        stiffness_n_m=options.stiffness_n_m,
        material=name,
        weighed=options.mass_kg is not None,
    )
    _tell(ctx, made, sum(solid.volume for solid in solids.values()), size, placement)
    return made


def _tell(ctx: Context, made: Physics, volume: float, size: float | None, placement: Placement | None) -> None:
    """Report the body as it ends in the twin; `volume` is in cubic units of its meshes, `size` see `_size`."""
    source = next(iter(made.links.values())).source
    rest = f"{source}, friction {made.friction:.2f} ± {Z90 * made.friction_sigma:.2f}"
    if size is None and not made.weighed:
        ctx.say(f"mass and volume not known, since the scale is not; {rest}")
        return
    if size is not None:
        ctx.metric("volume", size**3 * volume * 1e6, "cm3")
    scaled = made if size is None else similar.physics(made, similar.scaled(size))
    scaled = scaled if placement is None else similar.widened(scaled, placement.scale_sigma)
    mass, low, high = (
        sum(getattr(link, name) for link in scaled.links.values())
        for name in ("mass_kg", "mass_low_kg", "mass_high_kg")
    )
    ctx.metric("mass", mass, "kg")
    ctx.say(f"{_grams(mass)} ({_grams(low)} to {_grams(high)}), {rest}")


def _confidence(traits: Traits, body: Body, options: PhysicsOptions) -> float:
    """Probability of the material; unless stated, scaled by the probability that the body is (or is not) a vessel."""
    told = traits.material_confidence
    if options.material or told == 1.0:
        return 1.0
    rival = None if body.certainty is None else body.certainty.rival
    kind = 1.0 if rival is None or rival.hollow == body.hollow else 1.0 / (1.0 + _odds(rival))
    return kind * (options.material_confidence if told is None else told)


def _odds(rival: Rival) -> float:
    """Odds of the second-best hypothesis against the best one."""
    return math.exp(-rival.gap / GAP)


def _density(material: Material, name: str, body: Body, options: PhysicsOptions) -> tuple[float, float, str]:
    """Density [kg/m^3], standard deviation of the log mass, and a description."""
    density, own = (
        (material.wall_density, material.wall_sigma) if body.hollow else (material.bulk_density, material.bulk_sigma)
    )
    rival = None if body.certainty is None else body.certainty.rival
    sigma = math.hypot(own, _volume_sigma(body, options, options.untold_sigma), _rival_sigma(rival, density, material))
    kind = "walls" if body.hollow else "whole"
    return density, sigma, f"material table: {name}, {kind} at {density:.0f} kg/m3"


def _volume_sigma(body: Body, options: PhysicsOptions, untold: float) -> float:
    """Standard deviation of the log volume given the hypothesis, from the fit, or `untold`, and what is unseen."""
    known = body.certainty or Certainty(unseen_fraction=0.5)
    fit = untold if known.volume_sigma is None else known.volume_sigma
    hidden = options.wall_sigma if body.hollow else options.volume_sigma * known.unseen_fraction / 0.5
    return math.hypot(fit, hidden)


def _rival_sigma(rival: Rival | None, density: float, material: Material) -> float:
    """Standard deviation of the log mass from the possibility that the second-best hypothesis is right."""
    if rival is None:
        return 0.0
    odds = _odds(rival)
    other = rival.volume_ratio * (material.wall_density if rival.hollow else material.bulk_density) / density
    return math.sqrt(odds) / (1.0 + odds) * abs(math.log(other))


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
        mass_low_kg=mass * math.exp(-Z90 * sigma),
        mass_high_kg=mass * math.exp(Z90 * sigma),
        centre=(x, y, z),
        inertia=massprops.six(solid.inertia * density),
        source=source,
    )


def _encloses(material: Material) -> bool:
    """Whether products of the material are mostly something else: boxes, bottles and cans with their contents."""
    return material.bulk_density < ENCLOSING * material.wall_density


def _size(placement: Placement | None, support: Support | None) -> float | None:
    """Metres per unit of the meshes; None if it is not known."""
    if support is not None and support.scale == "unknown":
        return None
    return (1.0 if placement is None else placement.scale) * (1.0 if support is None else support.factor)


def _perhaps_empty(full: Inertial, link: Link, size: float, material: Material, options: PhysicsOptions) -> Inertial:
    """The same link with an interval that extends down to the mass of its walls alone."""
    corners = link.mesh.vertices.astype(np.float64)[link.mesh.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    sigma = math.hypot(material.wall_sigma, options.wall_sigma)
    walls = float(area) * options.shell_m / size * material.wall_density * math.exp(-Z90 * sigma)
    return full.model_copy(update={"mass_low_kg": min(full.mass_low_kg, walls)})


def _told(traits: Traits, material: str, confidence: float, estimate: Estimate | None) -> household.Told:
    """What is said about a body: its class, material and colour, and what a model states."""
    words = traits.phrase.lower().split()
    colour = words[0] if words and words[0] in household.COLOURS else ""
    if estimate is None:
        word = words[-1] if words and words[-1] != traits.category else ""
        return household.Told(traits.category, material, confidence, word, colour)
    return household.Told(traits.category, material, confidence, "", colour, estimate.phrase, estimate.mass_kg)


def _compared(
    links: dict[str, Inertial],
    source: str,
    body: Body,
    size: float,
    told: household.Told,
    material: Material,
    options: PhysicsOptions,
) -> tuple[dict[str, Inertial], str, Material]:
    """The links with masses of things of a household, and of a model's estimate, where these apply.

    Also the source of the masses, and the material with the contact of such things.
    """
    if not body.hollow and _encloses(material):
        links = {
            label: _perhaps_empty(link, body.links[label], size, material, options) for label, link in links.items()
        }
        if len(links) == 1:
            (label,) = links
            sides = household.sides(size * body.links[label].mesh.vertices.astype(np.float64))
            spread = _volume_sigma(body, options, 0.0)
            found = household.mass_of(sides, told, _total(links, size), volume_sigma=spread)
            source = f"things of this size and shape, like {' and '.join(found.likely)}"
            material = material if told.confidence == 1.0 else mixed(found.materials, material)
            links = _weighing(links, (found.low_kg, found.middle_kg, found.high_kg), size, _by(source, told))
            return links, _by(source, told), material
    if told.mass_kg is None:
        return links, source, material
    combined = estimated.of_mixture(np.ones(1), [_total(links, size)], told.mass_kg)
    return _weighing(links, combined, size, _by(source, told)), _by(source, told), material


def _by(source: str, told: household.Told) -> str:
    return source if told.mass_kg is None else f"{source}, and a model's estimate"


def _total(links: dict[str, Inertial], size: float) -> estimated.Quantiles:
    """Mass of all links in the world whose metres per unit are `size` [kg]."""
    low, middle, high = (
        size**3 * sum(getattr(link, name) for link in links.values())
        for name in ("mass_low_kg", "mass_kg", "mass_high_kg")
    )
    return low, middle, high


def _weighing(links: dict[str, Inertial], total: estimated.Quantiles, size: float, source: str) -> dict[str, Inertial]:
    """The links with another mass of all of them [kg], shared as before, and its source."""
    low, more, high = (new / old for new, old in zip(total, _total(links, size), strict=True))
    return {
        label: link.model_copy(
            update={
                "mass_kg": link.mass_kg * more,
                "mass_low_kg": link.mass_low_kg * low,
                "mass_high_kg": link.mass_high_kg * high,
                "inertia": tuple(more * part for part in link.inertia),
                "source": source,
            }
        )
        for label, link in links.items()
    }


def _touched(material: Material, estimate: Estimate) -> Material:
    """The material with friction and restitution as the table and a model together say."""
    friction, friction_sigma = estimated.coefficient(material.friction, material.friction_sigma, estimate.friction, 2.0)
    restitution, restitution_sigma = estimated.coefficient(
        material.restitution, material.restitution_sigma, estimate.restitution, 1.0
    )
    return replace(
        material,
        friction=friction,
        friction_sigma=friction_sigma,
        restitution=restitution,
        restitution_sigma=restitution_sigma,
    )


def _grams(kilograms: float) -> str:
    return f"{kilograms:.2f} kg" if kilograms >= 1.0 else f"{kilograms * 1000:.0f} g"
