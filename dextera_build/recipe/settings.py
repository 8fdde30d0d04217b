"""Options given outside the recipe: `body[mug].mesh.primitives.wall_m=0.004`."""

from __future__ import annotations

import re
import shlex
from collections.abc import Container
from dataclasses import dataclass, replace

from dextera_build.errors import Place, UsageError
from dextera_build.recipe import strict_yaml
from dextera_build.recipe.strict_yaml import Node

COMMAND_LINE = Place("the command line")
_STEP = re.compile(r"(?P<name>[a-z0-9_/:]+)(?:\[(?P<label>[^\]]+)\])?(?P<end>\.|\s*=|$)")


@dataclass(frozen=True)
class Setting:
    """One option of one call, or of all copies of a call in a group."""

    text: str
    call: tuple[str, ...]
    labels: tuple[str | None, ...]
    """One per enclosing group; None means every copy."""
    option: tuple[str, ...]
    """The option; in a group of options, below the group's name: `("primitives", "wall_m")`."""
    value: Node

    def at(self, calls: Container[tuple[str, ...]]) -> Setting:
        """The same setting, with the names that follow one of these calls as groups of options.

        Raises:
            UsageError: A name that is no group, or a group around another group, has a label.
        """
        for size in range(len(self.call), 0, -1):
            if (call := self.call[:size]) in calls:
                for place, label in enumerate(self.labels):
                    if label is not None and place != size - 2:
                        raise _misplaced(self.text, self.call[place], label)
                option = (*self.call[size:], *self.option)
                return replace(self, call=call, labels=self.labels[: size - 1], option=option)
        return self


def of_input(name: str, text: str) -> Place:
    """The place of an input that the command line gives."""
    return Place(f"{COMMAND_LINE}: --input {shlex.quote(f'{name}={text}')}")


def put(arguments: dict[str, Node], path: tuple[str, ...], value: Node) -> None:
    """Set an option, or a part of a group of options, of which the recipe may set others."""
    name, *inner = path
    if not inner:
        arguments[name] = value
        return
    known = arguments.get(name)
    group = dict(known.value) if known is not None and isinstance(known.value, dict) else {}
    put(group, tuple(inner), value)
    arguments[name] = Node(group, value.place, {key: node.place for key, node in group.items()})


def parse(text: str) -> Setting:
    """Read `NODE.OPTION=VALUE`; the value is YAML.

    Raises:
        UsageError: The text does not have this form.
    """
    steps: list[re.Match[str]] = []
    place, end = len(text) - len(text.lstrip()), "."
    # A label may contain dots and equals signs: `sweep[voxel_m=0.001].mesh.primitives.wall_m=0.004`.
    while end == "." and (step := _STEP.match(text, place)) is not None:
        steps.append(step)
        place, end = step.end(), step["end"].strip()
    value = text[place:]
    if end != "=" or len(steps) < 2:
        raise UsageError(
            f"`{text}` is not a setting",
            code="DXB-U106",
            hint="`--set 'body[mug].mesh.primitives.wall_m=0.004'` sets one option of one node",
        )
    parts = [(step["name"], step["label"]) for step in steps]
    for name, label in parts[-2:]:
        if label is not None:
            raise _misplaced(text, name, label)
    where = Place(f"{COMMAND_LINE}: --set {shlex.quote(text)}")
    return Setting(
        text,
        tuple(name for name, _ in parts[:-1]),
        tuple(label for _, label in parts[:-2]),
        (parts[-1][0],),
        strict_yaml.parse(value or '""', str(COMMAND_LINE), where),
    )


def _misplaced(text: str, name: str, label: str) -> UsageError:
    return UsageError(
        f"`{text}`: `{name}[{label}]` selects nothing, only the innermost group around a node takes a label",
        code="DXB-U219",
        hint="`--set 'body[mug].mesh.primitives.wall_m=0.004'`; without a label it sets the option in every copy",
    )
