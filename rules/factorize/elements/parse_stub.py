"""Unnamed elements: connected pixels above the support."""

from __future__ import annotations

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.rule import Backend, Context, Options

from ..measured import Measurements, Workspace
from ..regions.blobs import blobs

BACKEND = Backend(
    summary="connected pixels above the support, named `object`, `object_2` and so on", profiles=("stub",)
)


def propose(ctx: Context, photograph: Photograph, measured: Measurements[Workspace], options: Options) -> Elements:
    """One element per connected region above the support, in scan order."""
    found = []
    for number, blob in enumerate(blobs(measured.needed()), start=1):
        name = "object" if number == 1 else f"object_{number}"
        found.append(Element(name=name, category="object", phrase="object", interactive=not blob.cut, box=blob.box))
    return Elements(elements=tuple(found))
