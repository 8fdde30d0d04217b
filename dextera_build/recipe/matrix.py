"""Parameter sweeps: expands lists of values to labelled copies, all known before anything runs.

`matrix: {voxel_m: [0.001, 0.002], seed: [1, 2]}` gives four copies: `voxel_m=0.001,seed=1`, ... Their options may use
`$matrix.voxel_m`. The label is not part of a key, so adding a value adds copies and leaves the others cached.
"""

from __future__ import annotations

import itertools
import json
import math
import re
from collections.abc import Iterator, Mapping

from dextera_build.errors import Place, RecipeError, did_you_mean, listing
from dextera_build.recipe.strict_yaml import Node

PREFIX = "$matrix."
_MOST = 10_000
_TEXT = re.compile(r"[^\[\]/\\,=:\s\x00-\x1f]+")

Values = Mapping[str, Node]
"""Name -> its value in one copy."""


def copies(lists: Mapping[str, Node], place: Place) -> dict[str, dict[str, Node]]:
    """Label -> the values of that copy; the last list varies fastest.

    Args:
        lists: Name -> the list of its values, as written.
        place: Place of the matrix.

    Raises:
        RecipeError: A list is empty, has a duplicate value or one not allowed in a label; or there are too many copies.
    """
    if not lists:
        raise RecipeError("a matrix has at least one list of values", code="DXB-R505", where=place)
    choices = [[(name, *choice) for choice in _values(name, node)] for name, node in lists.items()]
    counts = dict(zip(lists, (len(values) for values in choices), strict=True))
    refuse_many(math.prod(counts.values()), place, {name: f"{count} values" for name, count in counts.items()})
    return {
        ",".join(f"{name}={text}" for name, text, _ in combination): {name: node for name, _, node in combination}
        for combination in itertools.product(*choices)
    }


def refuse_many(number: int, place: Place, facts: Mapping[str, object]) -> None:
    """Refuse a matrix with too many copies, including those of enclosing matrices.

    Args:
        number: Number of copies.
        place: Place of the matrix.
        facts: Factors of this number, for the message.

    Raises:
        RecipeError: There are too many.
    """
    if number > _MOST:
        shown = f"{number:,}" if number < 10**15 else "more than 10^15"
        raise RecipeError(
            f"the matrix has {shown} copies, {_MOST:,} are allowed",
            code="DXB-R506",
            where=place,
            facts=dict(itertools.islice(facts.items(), 12)),
        )


def _values(name: str, node: Node) -> list[tuple[str, Node]]:
    if not isinstance(node.value, list) or not node.value:
        raise RecipeError(
            f"`{name}` of a matrix is a list of values, this is {node.kind}",
            code="DXB-R505",
            where=node.place,
            hint=f"`{name}: [1, 2]`",
        )
    found: dict[str, Node] = {}
    for item in node.value:
        text = item.value if isinstance(item.value, str) else json.dumps(item.plain())
        if isinstance(item.value, dict | list) or not _TEXT.fullmatch(text):
            raise RecipeError(
                f"`{text}` is not allowed in the label of a copy",
                code="DXB-R507",
                where=item.place,
                facts={"values": "numbers, true, false, null, and text without spaces and [ ] / \\ , = :"},
            )
        if text in found:
            raise RecipeError(f"`{text}` is listed twice", code="DXB-R508", where=item.place)
        found[text] = item
    return list(found.items())


def filled(arguments: Mapping[str, Node], values: Values) -> dict[str, Node]:
    """The arguments that refer to the matrix, with `$matrix.name` replaced by the values of one copy.

    Raises:
        RecipeError: The matrix has no such name.
    """

    def fill(node: Node) -> Node:
        if not _speaks(node):
            return node
        name = node.value.removeprefix(PREFIX)
        if name not in values:
            raise RecipeError(
                f"the matrix has no `{name}`",
                code="DXB-R509",
                where=node.place,
                facts={"it has": listing(values)},
                hint=did_you_mean(name, values, form=f"`{PREFIX}{{}}`"),
            )
        return values[name]

    return {name: node.map(fill) for name, node in arguments.items() if any(references(node))}


def refuse_outside(arguments: Mapping[str, Node]) -> None:
    """Refuse references to matrix values in calls that are not directly inside the matrix.

    Raises:
        RecipeError: An argument refers to one.
    """
    for node in arguments.values():
        for place, text in references(node):
            raise RecipeError(
                f"`{text}` names nothing: this node is not directly inside a matrix",
                code="DXB-R510",
                where=place,
                hint="values of a matrix are for options and backends of its own nodes",
            )


def references(node: Node) -> Iterator[tuple[Place, str]]:
    """Place and text of every `$matrix.name` within a value."""
    stack = [node]
    while stack:
        here = stack.pop()
        if isinstance(here.value, dict):
            stack += here.value.values()
        elif isinstance(here.value, list):
            stack += here.value
        elif _speaks(here):
            yield here.place, here.value


def _speaks(node: Node) -> bool:
    return isinstance(node.value, str) and node.value.startswith(PREFIX)
