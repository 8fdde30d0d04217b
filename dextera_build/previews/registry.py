"""The lines of text and pictures of each type: which module makes them."""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module
from typing import Any

from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.core.schema import array_specs
from dextera_build.previews import text

MODULES = {
    "clouds": ("PointCloud", "Room", "Splats"),
    "hands": ("HandStream",),
    "images": ("DepthImage", "Image", "InstanceMap", "LabelImage", "ObjectView", "Panorama"),
    "lenses": ("BrownConrady", "Equirectangular", "KannalaBrandt"),
    "plain": ("Collection", "File", "Folder", "Matches"),
    "poses": ("AlignedScene", "Pose", "SceneFit", "Similarity", "Track", "Tracking", "Trajectory"),
    "recordings": ("MaskTrack", "RgbdVideo", "Stream", "Video"),
    "rigs": ("Calibration", "Rig", "RobotViews", "Views"),
    "surfaces": ("Body", "Mesh", "SceneDescription"),
}
"""Module of `previews` -> the types in its `FACTS` and `PICTURES`; others show their fields and their first picture."""
_MODULE_OF = {kind: module for module, kinds in MODULES.items() for kind in kinds}


def facts(value: Artifact) -> Iterator[str]:
    """The main facts about a value; see `Artifact.facts`."""
    made = _maker(value, "FACTS")
    if made is not None:
        found: Iterator[str] = made(value)
        return found
    kind = type(value)
    return text.facts({name: getattr(value, name) for name in kind.model_fields}, array_specs(kind))


def line(value: Artifact) -> str:
    """A value as one line of text."""
    return text.line(value.name(), value.facts())


def picture(value: Artifact) -> bytes | None:
    """The picture of a value; see `Artifact.picture`."""
    made = _maker(value, "PICTURES")
    if made is not None:
        drawn: bytes = made(value)
        return drawn
    parts = (getattr(value, name) for name in type(value).model_fields)
    pictures = (part.picture() for part in parts if isinstance(part, Artifact))
    return next((found for found in pictures if found is not None), None)


def html(value: Artifact) -> str:
    """A value as HTML, for notebooks."""
    from dextera_build.artifacts.table import Table
    from dextera_build.previews import html as pages

    if isinstance(value, Table):
        return pages.of_table(value, repr(value))
    return pages.page(repr(value), value.picture())


def _maker(value: Artifact, table: str) -> Any:
    """The function of a table of a module for the type of a value, or one that it derives from; None: none."""
    for kind in type(value).__mro__:
        module = _MODULE_OF.get(kind.__name__)
        if module is not None and kind.__module__.startswith("dextera_build."):
            return getattr(import_module(f"dextera_build.previews.{module}"), table).get(kind)
    return None
