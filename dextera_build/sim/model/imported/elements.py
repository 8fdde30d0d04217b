"""Names, numbers and poses in the XML elements of a URDF."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET

import numpy as np

from dextera_build.sim.model.imported.files import wrong


def named(path: str, elements: list[ET.Element], kind: str) -> dict[str, ET.Element]:
    """Elements by their names.

    Raises:
        RuleError: A name is missing or given twice, or there is no link.
    """
    found: dict[str, ET.Element] = {}
    for element in elements:
        name = element.get("name", "")
        if not name or name in found:
            raise wrong(f"`{path}`: two {kind}s are called `{name}`" if name else f"`{path}`: a {kind} has no name")
        found[name] = element
    if not found and kind == "link":
        raise wrong(f"`{path}` has no links")
    return found


def origin(element: ET.Element) -> tuple[np.ndarray, np.ndarray]:
    """Position [m] and quaternion w x y z of a child `origin`."""
    origin = element.find("origin")
    place = np.array(numbers(origin, "xyz", (0.0, 0.0, 0.0)))
    roll, pitch, yaw = numbers(origin, "rpy", (0.0, 0.0, 0.0))
    (cr, sr), (cp, sp), (cy, sy) = ((math.cos(a / 2), math.sin(a / 2)) for a in (roll, pitch, yaw))
    turn = [
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    ]
    return place, np.array(turn)


def rgba(material: ET.Element) -> list[float]:
    """Colour of a material, 0..1."""
    return numbers(material.find("color"), "rgba", (0.6, 0.6, 0.6, 1.0))


def number(element: ET.Element | None, key: str, default: float | None = None) -> float:
    """One number of an attribute."""
    return numbers(element, key, None if default is None else (default,))[0]


def numbers(element: ET.Element | None, key: str, default: tuple[float, ...] | None = None) -> list[float]:
    """Numbers of an attribute."""
    text = None if element is None else element.get(key)
    if text is None and default is not None:
        return list(default)
    try:
        found = [float(each) for each in (text or "").split()]
    except ValueError:
        found = []
    counts = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3, "rgba": 4}
    if len(found) != counts.get(key, 1) or not all(map(math.isfinite, found)):
        tag = "an element" if element is None else f"<{element.tag}>"
        raise wrong(f"`{key}` of {tag} must be {counts.get(key, 1)} numbers", found=repr(text))
    return found
