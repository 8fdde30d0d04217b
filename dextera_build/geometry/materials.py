"""The material table: properties assumed for a material recognised by appearance."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Material:
    """Properties with their uncertainty. Densities are log-normal: `sigma` 0.1 means about ten per cent."""

    wall_density: float
    """Density of the substance, for a body with modelled walls [kg/m^3]."""
    wall_sigma: float
    """Standard deviation of log `wall_density`."""
    bulk_density: float
    """Density of a whole product with contents and voids, per volume of its outer hull [kg/m^3]."""
    bulk_sigma: float
    """Standard deviation of log `bulk_density`."""
    friction: float
    """Sliding friction coefficient against a wooden or laminate table."""
    friction_sigma: float
    """Standard deviation of `friction`."""
    restitution: float
    """Coefficient of restitution of a slow impact on a table."""
    restitution_sigma: float
    """Standard deviation of `restitution`."""
    source: str
    """Source of the densities."""


_YCB = "YCB object set, published masses and sizes"

# Friction and restitution are centres of wide handbook ranges for dry contact with wood; their sigmas span the ranges.
TABLE: dict[str, Material] = {
    "cardboard": Material(
        700.0, 0.15, 480.0, 0.60, 0.40, 0.10, 0.20, 0.10, f"four filled boxes of the {_YCB}; paperboard 600-850"
    ),
    "ceramic": Material(
        2300.0,
        0.10,
        800.0,
        0.45,
        0.45,
        0.12,
        0.40,
        0.15,
        "stoneware and porcelain 2000-2500; vessel with unseen inside",
    ),
    "electronics": Material(
        1900.0, 0.25, 1300.0, 0.25, 0.40, 0.12, 0.25, 0.10, "closed notebooks, 1.2-2.2 kg over their outer volume"
    ),
    "fabric": Material(400.0, 0.40, 250.0, 0.50, 0.50, 0.15, 0.10, 0.05, "folded cotton and polyester 100-500"),
    "food": Material(950.0, 0.15, 950.0, 0.15, 0.45, 0.15, 0.20, 0.10, "fruit 800-1050"),
    "glass": Material(
        2500.0, 0.03, 900.0, 0.45, 0.35, 0.10, 0.45, 0.15, "soda-lime glass 2450-2550; filled or empty jar"
    ),
    "metal": Material(
        # Cups and cans may be aluminium or steel, hence the wide interval.
        5000.0,
        0.45,
        1000.0,
        0.35,
        0.35,
        0.12,
        0.35,
        0.15,
        f"between aluminium 2700 and steel 7850; cans of the {_YCB}",
    ),
    "paper": Material(750.0, 0.15, 750.0, 0.20, 0.40, 0.10, 0.15, 0.10, "stacked paper and books 600-900"),
    "plastic": Material(
        1000.0,
        0.12,
        800.0,
        0.45,
        0.35,
        0.10,
        0.35,
        0.15,
        f"PP to ABS 900-1150; filled bottles of the {_YCB}, hollow toys",
    ),
    "rubber": Material(1150.0, 0.15, 900.0, 0.40, 0.80, 0.20, 0.60, 0.15, "natural and synthetic rubber 920-1400"),
    "wood": Material(650.0, 0.25, 600.0, 0.30, 0.45, 0.12, 0.30, 0.10, "spruce 450 to oak 750"),
}
"""Key -> material; the keys are the valid values of `Element.material`."""


def doubted(name: str, confidence: float) -> Material:
    """A material with the standard deviations of a mixture: `name` with this probability, otherwise any other.

    Args:
        name: Key of `TABLE`.
        confidence: Probability, 0 to 1; the others are equally probable.
    """
    own, others = TABLE[name], [other for key, other in TABLE.items() if key != name]

    def spread(centre: str, sigma: str, *, log: bool = False) -> float:
        def at(material: Material) -> float:
            value = float(getattr(material, centre))
            return float(np.log(value)) if log else value

        squares = [(at(other) - at(own)) ** 2 + getattr(other, sigma) ** 2 for other in others]
        return float(np.sqrt(confidence * getattr(own, sigma) ** 2 + (1.0 - confidence) * np.mean(squares)))

    return replace(
        own,
        wall_sigma=spread("wall_density", "wall_sigma", log=True),
        bulk_sigma=spread("bulk_density", "bulk_sigma", log=True),
        friction_sigma=spread("friction", "friction_sigma"),
        restitution_sigma=spread("restitution", "restitution_sigma"),
    )


def mixed(shares: Mapping[str, float], rest: Material) -> Material:
    """A material with the friction and restitution of a mixture: mean and standard deviation over its parts.

    Args:
        shares: Key of `TABLE` -> probability; what they lack of 1 is that of `rest`.
        rest: A material, which gives the densities, too.
    """
    parts = [*((share, TABLE[name]) for name, share in shares.items()), (1.0 - sum(shares.values()), rest)]

    def moments(centre: str, sigma: str) -> tuple[float, float]:
        mean = sum(share * getattr(part, centre) for share, part in parts)
        square = sum(share * ((getattr(part, centre) - mean) ** 2 + getattr(part, sigma) ** 2) for share, part in parts)
        return mean, math.sqrt(square)

    friction, friction_sigma = moments("friction", "friction_sigma")
    restitution, restitution_sigma = moments("restitution", "restitution_sigma")
    return replace(
        rest,
        friction=friction,
        friction_sigma=friction_sigma,
        restitution=restitution,
        restitution_sigma=restitution_sigma,
    )
