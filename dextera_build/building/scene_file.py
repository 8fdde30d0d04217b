"""The text of a `scene.yaml` with the objects that a build found, for people to edit."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence

from dextera_build.artifacts.objects.object import Element
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.building.photographed import Found
from dextera_build.geometry import pictures
from dextera_build.geometry.materials import TABLE
from dextera_build.statistics import Z90

_HEAD = """\
# The proposed objects in the photograph of {recipe}. Edit this file, then build with it:
#   {command}
# `at_px` is [column, row], `box` is [left, top, right, bottom] in pixels of the photograph. Lines that begin with `#`
# are assumptions; without the `#` they count as stated. All fields: docs/recipes.md, "The file scene.yaml".
elements:
"""


def text(found: Found, recipe: str, command: str, built: Mapping[str, Sequence[str]]) -> str:
    """The file.

    Args:
        found: Elements and objects.
        recipe: Address of the recipe.
        command: The command line that builds with the file.
        built: Name of an object -> lines about its results.
    """
    final = dict(zip(found.parsed, found.objects.names, strict=True))
    elements = [element for element in found.elements.elements if element.name in final or element.box]
    by_box = found.elements.asset_source == "rgb"
    lines = [line for each in elements for line in _entry(each, final.get(each.name), found.objects, by_box, built)]
    return _HEAD.format(recipe=recipe, command=command) + "\n".join(lines) + "\n"


def _entry(
    element: Element, name: str | None, objects: Segmentation, by_box: bool, built: Mapping[str, Sequence[str]]
) -> Iterator[str]:
    yield f"  - name: {name_of(name or element.name)}"
    yield f"    phrase: {_scalar(objects.items[name].view.phrase if name else element.phrase)}"
    yield f"    category: {element.category}"
    if not element.interactive:
        yield "    interactive: false    # true: make an object of it"
    else:
        yield f"    body_type: {element.body_type}"
        stated = element.material_confidence == 1.0
        yield f"    material: {element.material}" if stated else _material(element)
    if name is not None:
        yield "    at_px: [{}, {}]".format(*pictures.innermost(objects.mask(name)))
    if element.box and (name is None or by_box):
        yield "    box: [{}, {}, {}, {}]".format(*element.box)
    if name is None and element.interactive:
        yield "    # no mask was found for it, or it stays in the background: see the line of `objects` in the build"
    yield from (f"    # {line}" for line in built.get(name or "", ()))


def _material(element: Element) -> str:
    """The assumed material as a comment, with its probability and the numbers that follow from it."""
    sure = "" if element.material_confidence is None else f", probability {element.material_confidence:.2f}"
    known = TABLE.get(element.material)
    meaning = (
        ""
        if known is None
        else (
            f": walls {known.wall_density:g} kg/m3, a whole {known.bulk_density:g}, "
            f"friction {known.friction:g} ± {Z90 * known.friction_sigma:.2f}"
        )
    )
    return f"    # material: {element.material}    # assumed{sure}{meaning}"


def name_of(proposed: str) -> str:
    """The name in the form that `scene.yaml` takes."""
    return "_".join(re.findall("[a-z0-9]+", proposed.lower())) or "thing"


def _scalar(phrase: str) -> str:
    """The phrase as YAML text."""
    plain = re.fullmatch("[A-Za-z][A-Za-z0-9 ]*[A-Za-z0-9]|[A-Za-z]", phrase)
    return phrase if plain and phrase not in ("true", "false", "null") else "'" + phrase.replace("'", "''") + "'"
