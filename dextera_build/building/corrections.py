"""Corrections of objects that were split or joined wrongly, as the viewer writes them into a `scene.yaml`.

A correction is tried in a build of the objects, so a file that was written finds them; otherwise it is as before.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dextera_build.building import build as building
from dextera_build.building import scene_edit, scene_file
from dextera_build.building.lock import Locking
from dextera_build.building.photographed import Found, Photographed
from dextera_build.building.values import raise_errors
from dextera_build.errors import DxbError, UsageError, listing
from dextera_build.geometry import pictures
from dextera_build.geometry.regions import box_of
from dextera_build.runs.events import Event, NodeFinished
from dextera_build.session import Session
from dextera_build.store import files

if TYPE_CHECKING:
    from dextera_build.project.planning import Added
    from dextera_build.runs.events import Listener

SCENE = "scene.yaml"
"""The file if the request has none, in the current folder."""
Point = tuple[int, int]
"""Column and row of a pixel of the photograph [px]."""


@dataclass(frozen=True)
class Corrected:
    """A correction that was written."""

    file: str
    """The path, as typed."""
    lines: tuple[str, ...]
    """The changes, each with its line in the file."""
    objects: tuple[str, ...]
    """The objects that are found with the file."""
    added: Added
    """The request with the file as an input."""


class Corrections:
    """Corrects the objects of a photograph in the `scene.yaml` of a request.

    Args:
        session: The recipe with the additions of the request.
        photograph: Digest of the photograph in which the objects were chosen.

    Raises:
        UsageError: The recipe segments no photograph, or several.
    """

    def __init__(self, session: Session, photograph: str) -> None:
        self._session, self._photograph = session, photograph
        self._input = self._file = ""

    def merge(self, name: str, other: str) -> Corrected:
        """Make two objects one, under the first one's name.

        Args:
            name: An object.
            other: The object that becomes a part of it.

        Raises:
            UsageError: There is no such object, the recipe lists its objects itself, or the file cannot be changed.
            DxbError: The objects cannot be found with the correction.
        """
        found, text, elements = self._read()
        points = [pictures.innermost(_mask(found, each)) for each in (name, other)]
        box = box_of(_mask(found, name) | _mask(found, other))
        kept, gone = (elements[each] for each in (name, other))
        text = scene_edit.changed(text, kept, _fields(found, points, box))
        text = scene_edit.removed(text, gone)
        return self._write(text, [kept], f"`{gone}` is removed")

    def split(self, name: str, points: Sequence[Point]) -> Corrected:
        """Make an object two; the first part keeps the name.

        Args:
            name: The object.
            points: A pixel of each part [px].

        Raises:
            UsageError: A point is beside the object; see also `merge`.
            DxbError: The objects cannot be found with the correction.
        """
        found, text, elements = self._read()
        mask = _mask(found, name)
        for column, row in points:
            if not (0 <= row < mask.shape[0] and 0 <= column < mask.shape[1] and mask[row, column]):
                raise UsageError(
                    f"the point {[column, row]} is not on `{name}`",
                    code="DXB-U223",
                    hint="click a pixel of each part, away from its border",
                )
        if len(set(points)) < len(points):
            raise UsageError(
                f"both points on `{name}` are the same", code="DXB-U223", hint="click a pixel of each part"
            )
        kept, known = elements[name], scene_edit.names(text)
        fresh = next(each for n in range(2, len(known) + 3) if (each := f"{kept}_{n}") not in known)
        first, second = (
            _fields(found, [point], box_of(part)) for point, part in zip(points, _halves(mask, points), strict=True)
        )
        text = scene_edit.changed(text, kept, first)
        text = scene_edit.added(text, kept, {"name": fresh, **{k: v for k, v in second.items() if v is not None}})
        return self._write(text, [kept, fresh])

    def _read(self) -> tuple[Found, str, Mapping[str, str]]:
        """What was found, the text of the file, and object -> its element."""
        seen = Photographed(self._session)
        self._input = seen.input_of(seen.parse, "scene")
        if not self._input:
            raise UsageError(
                f"`{self._session.recipe}` lists its objects itself",
                code="DXB-U224",
                hint=f"change the elements that `{seen.parse}` takes in the recipe; docs/recipes.md, scene.yaml",
            )
        found = self._find(self._session)
        if pictures.digest_of(found.photograph.rgb.pixels) != self._photograph:
            raise UsageError(
                f"`{self._session.recipe}` has another photograph than the view",
                code="DXB-U210",
                hint=f"`dxb build {self._session.recipe}`, and open the view again",
            )
        self._file = self._session.added.inputs.get(self._input, "")
        if self._file:
            return found, _text(self._file), dict(zip(found.objects.names, found.parsed, strict=True))
        self._file = SCENE
        if os.path.lexists(SCENE):
            raise UsageError(
                f"`{SCENE}` exists already, and the view does not show what it describes",
                code="DXB-U191",
                hint=f"build and view with `--input {self._input}={SCENE}`, or move the file",
            )
        from dextera_build.explain import library

        again = shlex.join(["dxb", *words(self._session, self._added())])
        text = scene_file.text(found, self._session.recipe, again, library.notes(self._session))
        names = (scene_file.name_of(each) for each in found.objects.names)
        return found, text, dict(zip(found.objects.names, names, strict=True))

    def _added(self) -> Added:
        """The request with the file as an input."""
        return replace(self._session.added, inputs={**self._session.added.inputs, self._input: self._file})

    def _find(self, session: Session) -> Found:
        errors: list[DxbError] = []

        def hear(event: Event) -> None:
            if isinstance(event, NodeFinished) and event.error is not None:
                errors.append(event.error)

        found = Photographed(session).find(hear)
        if found is None:
            raise errors[0]
        return found

    def _write(self, text: str, changed: Sequence[str], *more: str) -> Corrected:
        """Write the file, and find the objects with it."""
        added = self._added()
        places = [text.splitlines()[scene_edit.line_of(text, each, "at_px") - 1].strip() for each in changed]
        with _restored(Path(self._file)):
            files.write(os.path.abspath(self._file), text.encode(), 0o644)
            found = self._find(Session(self._session.project, self._session.recipe, added, makes=True))
            if lost := [each for each in changed if each not in found.parsed]:
                raise UsageError(
                    f"nothing is found of {listing(lost)} with the correction",
                    code="DXB-U226",
                    facts={"objects": listing(found.objects.names, most=30), **dict(zip(changed, places, strict=True))},
                    hint=f"`dxb new mask {self._session.recipe} OBJECT` writes a mask to paint, if the object is there",
                )
        lines = [
            f"line {scene_edit.line_of(text, each, 'at_px')}, `{each}`: `{place}`"
            for each, place in zip(changed, places, strict=True)
        ]
        return Corrected(self._file, (*lines, *more), found.objects.names, added)


def words(session: Session, added: Added) -> list[str]:
    """The command-line words of a build of the session's recipe with these additions."""
    inputs = [f"{name}={path}" for name, path in added.inputs.items()]
    backends = [f"{rule}={name}" for rule, name in added.backends.items()]
    told = (("--input", inputs), ("--set", added.settings), ("--backend", backends))
    project = session.project
    profile = ["--profile", project.profile] if project.config["profile"].origin == "command line" else []
    return [
        "build",
        session.recipe,
        *(word for flag, texts in told for text in texts for word in (flag, text)),
        *profile,
    ]


def rebuild(session: Session, listen: Listener) -> None:
    """Build the default targets of a request, as `dxb build` does.

    Args:
        session: The recipe with the additions of the request, which builds.
        listen: Takes every event.

    Raises:
        DxbError: It cannot be built.
    """
    locking = Locking(session.project, lock=False, locked=False, added=session.added)
    built = building.build(session, building.Order(argv=words(session, session.added)), locking, listen)
    if not built.ok:
        raise_errors(built.result)


@contextmanager
def _restored(path: Path) -> Iterator[None]:
    """Restore a file, or its absence, if the block fails."""
    before = path.read_bytes() if path.exists() else None
    try:
        yield
    except DxbError:
        if before is None:
            path.unlink(missing_ok=True)
        else:
            files.write(os.path.abspath(path), before, 0o644)
        raise


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(
            f"`{path}` cannot be read as a `scene.yaml`",
            code="DXB-U221",
            facts={"system": getattr(error, "strerror", "") or str(error)},
            hint="`dxb new scene RECIPE -o FILE` writes one",
        ) from None


def _mask(found: Found, name: str) -> np.ndarray:
    if name not in found.objects.names:
        raise UsageError(
            f"no object is called `{name}`",
            code="DXB-U216",
            facts={"objects": listing(found.objects.names, most=30)},
            hint="build again to see what the corrections of before made",
        )
    return found.objects.mask(name)


def _fields(found: Found, points: Sequence[Point], box: tuple[int, ...]) -> dict[str, Any]:
    """The place of an element: points choose regions; where there are none, the box is the place, too."""
    chosen = [[int(column), int(row)] for column, row in points]
    at: Any = chosen[0] if len(chosen) == 1 else chosen
    return {"at_px": at, "box": list(box) if found.elements.regions is None else None}


def _halves(mask: np.ndarray, points: Sequence[Point]) -> list[np.ndarray]:
    """The pixels of a mask (H, W) bool that are nearest to each point."""
    rows, columns = np.indices(mask.shape)
    nearest = np.argmin([np.square(columns - column) + np.square(rows - row) for column, row in points], axis=0)
    return [mask & (nearest == part) for part in range(len(points))]
