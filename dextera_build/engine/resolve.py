"""What an input is worth once its sources are known: a digest."""

from __future__ import annotations

from dextera_build.engine.expand import Wiring
from dextera_build.engine.graph import Call, Gather, Input, Leaf, Pack
from dextera_build.engine.units import Gathering, Node, Opening, Unit
from dextera_build.store import headers
from dextera_build.store.blobs import Blobs


def inputs_of(call: Call, reader: Unit, wiring: Wiring, blobs: Blobs) -> dict[str, str]:
    """Slot -> digest of the inputs of `reader`, a copy of `call`.

    Raises:
        DxbError: See `value`.
    """
    return {slot: value(source, reader, wiring, blobs) for slot, source in call.inputs.items()}


def value(source: Input, reader: Unit, wiring: Wiring, blobs: Blobs) -> str:
    """The digest of an input of `reader`; the collection of what it lists by label is stored.

    Raises:
        DxbError: A field does not exist, a file cannot be read, or the store cannot take the collection.
    """
    if isinstance(source, Pack):
        parts = {label: value(part, reader, wiring, blobs) for label, part in source.parts.items()}
        return blobs.put(headers.collection_header(parts))
    if isinstance(source, Leaf):
        return wiring.leaf(source)
    unit = wiring.source(source, reader)
    start: str | None = None
    if isinstance(unit, Node | Gathering):
        start = unit.output
    elif isinstance(unit, Opening):
        start = unit.items[reader.labels[len(unit.labels)]]
    assert start is not None, f"{reader.address} is not ready"
    # A gathering has followed the fields already.
    fields = () if isinstance(source, Gather) else source.fields
    return headers.project(blobs.get, start, fields) if fields else start
