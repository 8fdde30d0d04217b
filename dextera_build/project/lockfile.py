"""`dxb.lock`: the key and the output of each target of a project, and names of objects, under version control.

The file is sorted TOML with one block per target; branches that pin different targets merge without a conflict:

    version = 1

    [cpu."twin/laptop_scene:scene"]
    key = "7f1c..."
    output = "91c2..."
    size = 48213

    [names."twin/laptop_scene:named"]
    mug = { phrase = "blue mug", at_px = [412, 233], photograph = "ab12..." }

A block's name is the profile and the node's address. `size` counts all blobs of the output [bytes]. Blocks of `names`
hold the bindings of `dxb bind`, for all profiles.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from dextera_build.errors import Place, RecipeError, StoreError
from dextera_build.project.settings import is_profile, parse_toml
from dextera_build.recipe.bindings import PROPERTIES, Binding, Names
from dextera_build.store import failpoints, files
from dextera_build.store.blobs import is_digest

_VERSION = 1
_HEAD = "# Which key and output each target has. `dxb build --lock` writes this file, `--locked` builds by it.\n"
_NAMED = "# Which object each name is bound to, by a point in a photograph. `dxb bind` writes these blocks.\n"
_CONFLICT = re.compile(r"^(<{7}|={7}|>{7}|\|{7})( |$)", re.MULTILINE)


@dataclass(frozen=True)
class Pin:
    """The state of a target when it was locked."""

    key: str
    output: str
    """Digest of the output's header."""
    size: int
    """Of the output with all artifacts that it refers to [bytes]."""


@dataclass(frozen=True)
class Name:
    """The target of a pin; names sort in the order of their blocks in the file."""

    profile: str
    recipe: str
    node: str

    def __str__(self) -> str:
        """The target as written on the command line."""
        return f"{self.recipe}:{self.node}"


Pins = Mapping[Name, Pin]
Bindings = Mapping[str, Names]
"""`RECIPE:NODE` -> the names bound there."""


@dataclass(frozen=True)
class Lock:
    """The content of a lock file."""

    pins: Pins = field(default_factory=dict)
    names: Bindings = field(default_factory=dict)


def read(path: Path, shown: str | None = None) -> Lock | None:
    """The content of a lock file, or None if the file does not exist.

    Args:
        path: The file.
        shown: Its name in messages.

    Raises:
        RecipeError: It holds a merge conflict, is not valid, or comes from a newer dxb.
    """
    where = Place(shown or str(path))
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        return None
    except (OSError, UnicodeDecodeError) as error:
        raise RecipeError(f"cannot read the lock file: {error}", code="DXB-R501", where=where) from None
    if mark := _CONFLICT.search(text):
        raise RecipeError(
            "the lock file holds a merge conflict",
            code="DXB-R502",
            where=Place(where.file, text.count("\n", 0, mark.start()) + 1),
            hint=f"take either side with `git checkout --ours {where.file}`, then `dxb build --lock` the targets in it",
        )
    raw = parse_toml(text, where, _wrong)
    if raw.pop("version", None) != _VERSION:
        raise _wrong(f"the lock file has no `version = {_VERSION}`", where)
    named = raw.pop("names", {})
    if not isinstance(named, dict):
        raise _wrong("`names` in the lock file is not a table", where)
    names = {":".join(_address(node, where)): _names(node, block, where) for node, block in named.items()}
    pins: dict[Name, Pin] = {}
    for profile, block in raw.items():
        if not is_profile(profile) or not isinstance(block, dict):
            raise _wrong(f"`{profile}` in the lock file is not a profile", where)
        pins |= {Name(profile, *_address(name, where)): _pin(name, fields, where) for name, fields in block.items()}
    return Lock(pins, names)


def write(path: Path, lock: Lock) -> bool:
    """Write the file atomically if its content differs; return whether it was written.

    Raises:
        StoreError: It cannot be written.
    """
    files.clear(str(path.parent))
    text = spell(lock)
    if path.is_file() and path.read_bytes() == text.encode():
        return False
    failpoints.reach("pins.write")
    try:
        files.write(str(path), text.encode(), 0o644)
    except StoreError as error:
        facts = {name: fact for name, fact in error.facts.items() if name != "file"}
        raise StoreError(
            "the lock file cannot be written",
            code="DXB-S107",
            where=Place(str(path)),
            facts=facts,
            hint="the results are in the store; free space or allow writing, and build again",
        ) from None
    return True


def spell(lock: Lock) -> str:
    """The text of a lock file; equal contents have equal texts."""
    blocks = [f"{_HEAD}\nversion = {_VERSION}\n"]
    for name in sorted(lock.pins, key=lambda name: (name.profile, str(name))):
        pin = lock.pins[name]
        blocks.append(
            f'[{name.profile}.{_quoted(str(name))}]\nkey = "{pin.key}"\noutput = "{pin.output}"\nsize = {pin.size}\n'
        )
    named = [node for node in sorted(lock.names) if lock.names[node]]
    for number, node in enumerate(named):
        lines = [f"{_quoted(name)} = {_spelled(binding)}\n" for name, binding in sorted(lock.names[node].items())]
        blocks.append(f"{'' if number else _NAMED}[names.{_quoted(node)}]\n{''.join(lines)}")
    return "\n".join(blocks)


def _spelled(binding: Binding) -> str:
    assert binding.at_px is not None, "a binding in the lock file has a point"
    said = [f"{key} = {_quoted(binding.properties[key])}" for key in PROPERTIES if key in binding.properties]
    column, row = binding.at_px
    return f"{{ {', '.join([*said, f'at_px = [{column}, {row}]', f'photograph = {_quoted(binding.photograph)}'])} }}"


def _quoted(text: str) -> str:
    # TOML has the same escapes as JSON, except for DEL, which must be escaped in TOML.
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _address(name: str, where: Place) -> tuple[str, str]:
    recipe, colon, node = name.partition(":")
    if not (recipe and colon and node):
        raise _wrong(f"`{name}` in the lock file is not of the form `RECIPE:NODE`", where)
    return recipe, node


def _names(node: str, block: object, where: Place) -> dict[str, Binding]:
    if not isinstance(block, dict):
        raise _wrong(f"`names` of `{node}` in the lock file is not a table", where)
    return {name: _binding(name, fields, where) for name, fields in block.items()}


def _binding(name: str, fields: object, where: Place) -> Binding:
    match fields:
        case {"at_px": [int(column), int(row)], "photograph": str(photograph), **rest} if (
            is_digest(photograph)
            and min(column, row) >= 0
            and not isinstance(column, bool)
            and not isinstance(row, bool)
            and all(key in PROPERTIES and isinstance(value, str) and value for key, value in rest.items())
        ):
            return Binding((column, row), photograph, {str(key): str(value) for key, value in rest.items()})
    raise RecipeError(
        f"the name `{name}` in the lock file does not have `at_px`, `photograph` and no more than {PROPERTIES}",
        code="DXB-R504",
        where=where,
        hint=f"remove its line, and bind it again: `dxb bind TARGET {name} --at COLUMN,ROW`",
    )


def _pin(name: str, fields: object, where: Place) -> Pin:
    match fields:
        case {"key": str(key), "output": str(output), "size": int(size), **rest} if (
            not rest and is_digest(key) and is_digest(output) and not isinstance(size, bool) and size >= 0
        ):
            return Pin(key, output, size)
    raise _wrong(f"the block of `{name}` in the lock file does not have exactly `key`, `output` and `size`", where)


def _wrong(message: str, where: Place) -> RecipeError:
    return RecipeError(
        message, code="DXB-R503", where=where, hint="`git diff` shows what was edited; `dxb build --lock` writes blocks"
    )
