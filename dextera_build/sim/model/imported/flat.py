"""MJCF with its includes expanded, before MuJoCo reads it: from input files only, with bounded size.

MuJoCo reads includes, attached models and meshes from anywhere on the disk, and unrolls `replicate` and its like while
it parses.
"""

from __future__ import annotations

import math
import posixpath
import xml.etree.ElementTree as ET
from collections.abc import Mapping

from dextera_build.errors import listing
from dextera_build.formats import bounds, xml_text
from dextera_build.sim.model.imported.files import MOST_TEXELS, wrong

MOST_BODIES = 1_000
"""Maximum number of links of a robot; known robots have up to 200, and pairwise checks take quadratic time."""
MOST_ELEMENTS = 20_000
"""Maximum number of elements of a model, after `replicate`, `composite`, `flexcomp` and `attach`."""
_FINEST = 500
"""Maximum parameter of a mesh that MuJoCo generates."""
_DEEPEST = 200
_LEFT_OUT = ("size", "custom", "sensor")
"""Sections that no robot model needs, and that can reserve any amount of memory."""


def written(path: str, files: Mapping[str, bytes]) -> dict[str, bytes]:
    """The MJCF `path` and the models that it attaches: path -> text without includes.

    Raises:
        RuleError: A file is no XML, or names one that is missing or outside of `files`.
        ArtifactError: It expands to too much.
    """
    made = _Flat(files)
    made.model(path)
    bodies, elements = made.counts[path]
    bounds.check(path, "bodies", bodies, MOST_BODIES)
    bounds.check(path, "elements", elements, MOST_ELEMENTS)
    return {name: ET.tostring(each) for name, each in made.models.items() if each is not None}


class _Flat:
    """Joins the files of a model.

    Args:
        files: Path -> content.
    """

    def __init__(self, files: Mapping[str, bytes]) -> None:
        self._files = files
        self.models: dict[str, ET.Element | None] = {}
        """Path -> root element; None while it is being read."""
        self.counts: dict[str, tuple[int, int]] = {}
        """Path -> bodies and elements that MuJoCo creates from it."""

    def model(self, path: str) -> None:
        """Read a model with its includes, and the models that it attaches."""
        if path in self.models:
            if self.models[path] is None:
                raise wrong(f"`{path}` attaches itself in the end")
            return
        self.models[path] = None
        root = self._parsed(path)
        self._include(root, path, path, {path}, 0)
        for section in [each for each in root if each.tag in _LEFT_OUT]:
            root.remove(section)
        for element in root.iter():
            _check(path, element)
        for element in root.iter("model"):
            self.model(self._path(element, path))
        self.models[path], self.counts[path] = root, self._count(root)

    def _count(self, element: ET.Element) -> tuple[int, int]:
        """Bodies and elements that MuJoCo creates from an element."""
        counts = [self._count(each) for each in element]
        bodies = sum(each[0] for each in counts) + (element.tag == "body")
        elements = sum(each[1] for each in counts) + 1
        if element.tag == "attach":
            bodies += max((each[0] for each in self.counts.values()), default=0)
            elements += max((each[1] for each in self.counts.values()), default=0)
        if element.tag in ("composite", "flexcomp"):
            bodies += 1
        if element.tag in ("composite", "flexcomp", "replicate"):
            times = _product(element.get("count", ""))
            return bodies * times, elements * times
        return bodies, elements

    def _parsed(self, path: str) -> ET.Element:
        try:
            return xml_text.parsed(self._files[path])
        except ValueError as error:
            raise wrong(f"`{path}` does not load", parser=str(error)) from None

    def _include(self, element: ET.Element, path: str, main: str, known: set[str], depth: int) -> None:
        """Replace the includes in an element of the file `path`, which is part of the model `main`."""
        if depth > _DEEPEST:
            raise wrong(f"elements of `{path}` are nested more than {_DEEPEST} deep")
        for place in reversed(range(len(element))):
            if element[place].tag != "include":
                self._include(element[place], path, main, known, depth + 1)
                continue
            other = self._path(element[place], main, path)
            if other in known:
                raise wrong(f"`{other}` is included twice", named_in=path)
            known.add(other)
            inner = self._parsed(other)
            self._include(inner, other, main, known, depth + 1)
            element[place : place + 1] = list(inner)

    def _path(self, element: ET.Element, *beside: str) -> str:
        """The file that an element names, relative to one of some files."""
        name = element.get("file", "").replace("\\", "/")
        for other in beside:
            path = posixpath.normpath(posixpath.join(posixpath.dirname(other), name))
            if path in self._files:
                return path
        raise wrong(
            f"`{name}`, which `{beside[-1]}` names, is missing in the input",
            element=f"<{element.tag}>",
            here=listing(path for path in self._files if path.endswith((".xml", ".mjcf"))),
            hint="put it into the folder, and name it by a relative path",
        )


def _check(path: str, element: ET.Element) -> None:
    """Raise for an element that reads a file while it is parsed, or that has too many numbers."""
    tag = element.tag
    if tag in ("flexcomp", "hfield") and element.get("file"):
        raise wrong(f"`{path}` has a <{tag}> made of a file", hint="leave it out: it is no part of a robot")
    if tag == "hfield":
        cells = _product(f"{element.get('nrow', '0')} {element.get('ncol', '0')}")
        bounds.check(path, "cells of a height field", cells, MOST_TEXELS)
    if tag == "texture":
        width, height = (_product(element.get(side, "1")) for side in ("width", "height"))
        bounds.check(path, "texels of a texture", width * max(height, width), MOST_TEXELS)
    if tag == "mesh" and element.get("builtin"):
        for number in element.get("params", "").split():
            bounds.check(path, "parts of a built-in mesh", _product(number), _FINEST)


def _product(text: str) -> int:
    """The product of the numbers in an attribute; other words count as 1, and MuJoCo rejects them."""
    found = []
    for word in text.split():
        try:
            number = float(word)
        except ValueError:
            continue
        found.append(int(max(number, 1)) if math.isfinite(number) else MOST_TEXELS + 1)
    return math.prod(found)
