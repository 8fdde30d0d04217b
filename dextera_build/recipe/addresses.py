"""Which recipes a project has, by name alone, and how a target is written; completion waits for this module."""

import os
from dataclasses import dataclass

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator


def addresses(folders: "Iterable[str]") -> "Iterator[tuple[str, str]]":
    """Address and file of every recipe below some folders; of one address the first counts."""
    seen = set()
    for folder in folders:
        inside = ((place, name) for place, _, names in os.walk(folder) for name in names if name.endswith(".yaml"))
        for file in sorted((f"{place}/{name}" for place, name in inside), key=lambda file: file.split("/")):
            address = file[len(folder) + 1 : -len(".yaml")]
            if "." not in address and address.isprintable() and address not in seen:
                seen.add(address)
                yield address, file


@dataclass(frozen=True)
class Target:
    """`twin/laptop_scene:body[mug].mesh`: a recipe, and a target or node of it."""

    recipe: str
    node: str
    """Name of a target or address of a node; "" stands for the default targets."""


def parse_target(text: str) -> Target:
    """Read `RECIPE` or `RECIPE:NODE`."""
    recipe, _, node = text.partition(":")
    return Target(recipe.removesuffix(".yaml").removeprefix("recipes/"), node)
