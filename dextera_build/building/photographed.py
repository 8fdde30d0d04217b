"""The photograph of a recipe and the objects in it, under their final names: for `dxb new scene` and `dxb new mask`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Elements
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.building.values import output_of, run, value
from dextera_build.engine.graph import Call, Output
from dextera_build.errors import UsageError, listing
from dextera_build.recipe.schema import CallDecl
from dextera_build.session import Session

if TYPE_CHECKING:
    from dextera_build.runs.events import Listener

Calls = dict[tuple[str, ...], Call]
"""Calls outside groups, by address."""
SEGMENT = "factorize.segment"
AFTER = ("factorize.name", "factorize.correct")
"""Rules that give the objects of SEGMENT their final names and masks."""


class Found(NamedTuple):
    """Objects that a build found in a photograph."""

    photograph: Photograph
    elements: Elements
    objects: Segmentation
    """Under their final names; the order of the elements stays, and those without a mask are missing."""
    parsed: tuple[str, ...]
    """Name that parsing proposed for each of `objects`."""


class Photographed:
    """The nodes of a recipe that find objects in its photograph.

    Args:
        session: The recipe with the additions of the request.

    Raises:
        UsageError: The recipe segments no photograph, or several.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        graph = session.plan().graph
        calls: Calls = {path: call for path, call in graph.calls() if len(path) == 1}
        found = [path for path, call in calls.items() if call.rule.path == SEGMENT]
        if len(found) != 1:
            raise UsageError(
                f"`{session.recipe}` finds objects in {len(found) or 'no'} photograph{'s' * (len(found) > 1)}",
                code="DXB-U214",
                facts={f"nodes of {SEGMENT}": listing(".".join(path) for path in found)},
                hint="take the recipe of one photograph: `twin/tabletop`",
            )
        self._segment = found[0]
        self.objects = _last(calls, self._segment)
        self._call = calls[self._segment]

    def input_of(self, node: str, slot: str) -> str:
        """Name of the recipe's input that a slot of a node takes: `description` of `scene`; "" if it takes none."""
        recipe = self._session.project.recipe(self._session.recipe)
        decl = recipe.nodes.get(node) if recipe is not None else None
        given = decl.arguments.get(slot) if isinstance(decl, CallDecl) else None
        name = str(given.value).removeprefix("$") if given is not None else ""
        return name if recipe is not None and name in recipe.inputs else ""

    @property
    def parse(self) -> str:
        """The node that finds the elements."""
        return ".".join(output_of(self._call, "elements").call)

    def find(self, listen: Listener) -> Found | None:
        """Build the objects as far as they are stale; None if a node failed, which `listen` has received."""
        slots = {slot: output_of(self._call, slot) for slot in ("photograph", "elements")}
        nodes = {slot: ".".join(source.call) for slot, source in slots.items()}
        parsed = ".".join(self._segment)
        result = run(self._session, tuple({*nodes.values(), parsed, self.objects}), listen)
        if not result.ok:
            return None
        values: dict[str, Any] = {
            slot: value(self._session, result, nodes[slot], source.fields) for slot, source in slots.items()
        }
        segmented: Segmentation = value(self._session, result, parsed)
        return Found(
            values["photograph"], values["elements"], value(self._session, result, self.objects), segmented.names
        )


def _last(calls: Calls, node: tuple[str, ...]) -> str:
    """The node that gives the objects of `node` their final names and masks."""
    readers = [
        path for path, call in calls.items() if call.rule.path in AFTER and call.inputs.get("objects") == Output(node)
    ]
    return _last(calls, readers[0]) if readers else ".".join(node)
