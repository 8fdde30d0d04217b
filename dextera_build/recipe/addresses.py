"""Addresses of recipes, found by file name alone, and of targets; imports little to keep completion fast."""

import os
from dataclasses import dataclass

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


PROFILES = "profile"
MODELS = "model"
_RESERVED = (PROFILES, MODELS)
"""Folders whose files are no recipes."""


def addresses(folders: "Iterable[str]") -> "Iterator[tuple[str, str]]":
    """Address and file of every recipe below the folders; the first file of an address wins."""
    seen = set()
    for folder in folders:
        inside = ((place, name) for place, _, names in os.walk(folder) for name in names if name.endswith(".yaml"))
        for file in sorted((f"{place}/{name}" for place, name in inside), key=lambda file: file.split("/")):
            address = file[len(folder) + 1 : -len(".yaml")]
            if address.split("/")[0] in _RESERVED:
                continue
            if "." not in address and address.isprintable() and address not in seen:
                seen.add(address)
                yield address, file


@dataclass(frozen=True)
class Target:
    """`twin/laptop_scene:body[mug].mesh`: a recipe, and one of its targets or nodes."""

    recipe: str
    node: str
    """Name of a target or address of a node; "" means the default targets."""


def parse_target(text: str) -> Target:
    """Read `RECIPE` or `RECIPE:NODE`."""
    recipe, _, node = text.partition(":")
    return Target(recipe.removesuffix(".yaml").removeprefix("recipes/"), node)
