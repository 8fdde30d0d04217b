"""YAML 1.2 core scalars with positions: duplicate keys, merge keys and tags are refused, `no` is a string."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

import yaml

from dextera_build.errors import Place, RecipeError

_SCALARS: tuple[tuple[str, re.Pattern[str], str], ...] = (
    ("tag:yaml.org,2002:null", re.compile(r"^(?:~|null|Null|NULL|)$"), "~nN"),
    ("tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), "tTfF"),
    ("tag:yaml.org,2002:int", re.compile(r"^(?:[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+)$"), "-+0123456789"),
    (
        "tag:yaml.org,2002:float",
        re.compile(r"^[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?$"),
        "-+.0123456789",
    ),
)


class _CoreLoader(yaml.SafeLoader):
    """The safe loader with the resolvers of the YAML 1.2 core schema in place of those of YAML 1.1."""

    yaml_implicit_resolvers: dict[str, list[tuple[str, re.Pattern[str]]]] = {}  # noqa: RUF012 (PyYAML's own form)


for _tag, _pattern, _first in _SCALARS:
    _CoreLoader.add_implicit_resolver(_tag, _pattern, list(_first))
# An empty scalar has no first character; PyYAML looks it up under "".
_CoreLoader.yaml_implicit_resolvers.setdefault("", []).append(_SCALARS[0][:2])


@dataclass(frozen=True)
class Node:
    """One YAML value with its place; a mapping holds `dict[str, Node]`, a sequence `list[Node]`."""

    value: Any
    place: Place
    keys: dict[str, Place] = field(default_factory=dict)
    """Where each key of a mapping stands."""

    @property
    def kind(self) -> str:
        """`mapping`, `list`, `text`, `number`, `true/false` or `nothing`."""
        names = {dict: "mapping", list: "list", str: "text", bool: "true/false", type(None): "nothing"}
        return names.get(type(self.value), "number")

    def plain(self) -> Any:
        """The value without places."""
        if isinstance(self.value, dict):
            return {name: inner.plain() for name, inner in self.value.items()}
        if isinstance(self.value, list):
            return [inner.plain() for inner in self.value]
        return self.value

    def placed(self, place: Place) -> Node:
        """The same value with one place for all of it."""
        if isinstance(self.value, dict):
            return Node({name: inner.placed(place) for name, inner in self.value.items()}, place)
        if isinstance(self.value, list):
            return Node([inner.placed(place) for inner in self.value], place)
        return Node(self.value, place)

    def at(self, path: tuple[object, ...]) -> Place:
        """The place of the value below `path` of keys and indices, or of the deepest part that exists."""
        node = self
        for step in path:
            parts = dict(enumerate(node.value)) if isinstance(node.value, list) else node.value
            if not isinstance(parts, dict) or step not in parts:
                break
            node = parts[step]
        return node.place


def parse(text: str, file: str) -> Node:
    """Parse one document.

    Args:
        text: YAML.
        file: Name for messages.

    Raises:
        RecipeError: A syntax error, a duplicate key, a tag, a merge key, an alias or several documents.
    """
    try:
        loader = _CoreLoader(text)
        root = loader.get_single_node()
    except yaml.YAMLError as error:
        raise _syntax_error(error, file) from None
    if root is None:
        raise RecipeError("the file is empty", code="DXB-R101", where=Place(file))
    return _convert(root, file)


def scalar(text: str) -> Any:
    """The value of one flow-style YAML text, as on the command line: `0.001`, `[box, cylinder]`."""
    return parse(text, "the command line").plain() if text else ""


def _convert(node: yaml.Node, file: str) -> Node:
    place = Place(file, node.start_mark.line + 1, node.start_mark.column + 1)
    if isinstance(node, yaml.ScalarNode):
        return Node(_scalar(node, place), place)
    if node.tag not in ("tag:yaml.org,2002:seq", "tag:yaml.org,2002:map"):
        raise RecipeError(f"the tag `{node.tag}` is not known here", code="DXB-R102", where=place)
    if isinstance(node, yaml.SequenceNode):
        return Node([_convert(item, file) for item in node.value], place)
    found: dict[str, Node] = {}
    keys: dict[str, Place] = {}
    for key_node, value_node in node.value:
        key = _convert(key_node, file)
        if not isinstance(key.value, str) or key.value == "<<":
            raise RecipeError(f"a key must be text, this one is {key.plain()!r}", code="DXB-R102", where=key.place)
        if key.value in found:
            raise RecipeError(
                f"`{key.value}` stands twice in one mapping",
                code="DXB-R103",
                where=key.place,
                facts={"first": keys[key.value]},
            )
        found[key.value] = _convert(value_node, file)
        keys[key.value] = key.place
    return Node(found, place, keys)


def _scalar(node: yaml.ScalarNode, place: Place) -> Any:
    text: str = node.value
    match node.tag.rpartition(":")[2]:
        case "str":
            return text
        case "null":
            return None
        case "bool":
            return text.lower() == "true"
        case "int":
            return int(text, 0) if text[:2] in ("0o", "0x") else int(text)
        case "float":
            return float(text)
    raise RecipeError(f"the tag `{node.tag}` is not known here", code="DXB-R102", where=place)


def _syntax_error(error: yaml.YAMLError, file: str) -> RecipeError:
    mark = getattr(error, "problem_mark", None)
    where = Place(file, mark.line + 1, mark.column + 1) if mark else Place(file)
    problem = getattr(error, "problem", None) or str(error)
    return RecipeError(f"not valid YAML: {problem}", code="DXB-R101", where=where)
