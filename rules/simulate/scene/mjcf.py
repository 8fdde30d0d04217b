"""simulate.mjcf: an MJCF model of the project, with all its files."""

from __future__ import annotations

import posixpath
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Iterator

from dextera_build.artifacts.base import Folder
from dextera_build.rule import Context, Options, rule

_SIDES = ("file", "fileright", "fileleft", "fileup", "filedown", "filefront", "fileback")
_FOLDERS = {
    "mesh": "meshdir",
    "hfield": "meshdir",
    "skin": "meshdir",
    "flexcomp": "meshdir",
    "texture": "texturedir",
}
"""Element with file references -> attribute of `compiler` with the folder of these files."""


class MjcfOptions(Options):
    """Options of simulate.mjcf; every field is part of the key."""

    path: str
    """Path of the model's MJCF, relative to the project."""


@rule(version=1, discovers=True)
def mjcf(ctx: Context, *, options: MjcfOptions) -> Folder:
    """Return a model with its included files, meshes, height fields and textures.

    The rule discovers these files from the model: editing one of them makes the result stale, editing an unreferenced
    mesh does not. Their relative paths are kept, below the nearest common folder.
    """
    files: dict[str, bytes] = {}
    models = [posixpath.normpath(options.path)]
    for model in models:  # grows by attached models
        models += [other for other in _read(ctx, model, files) if other not in models]
    top = posixpath.commonpath([posixpath.dirname(name) for name in files])
    ctx.metric("files", len(files), "")
    ctx.say(f"{len(files)} files, {sum(map(len, files.values())) / 1e6:.1f} MB")
    return Folder(files={posixpath.relpath(name, top or "."): data for name, data in files.items()})


def _read(ctx: Context, model: str, files: dict[str, bytes]) -> list[str]:
    """Add a model's files and return the models that it attaches; paths are relative to its MJCF."""
    folder = posixpath.dirname(model)
    documents: dict[str, ET.Element] = {}
    waiting = [model]
    while waiting:
        path = waiting.pop()
        if path not in documents:
            files[path] = ctx.read(path)
            documents[path] = _parsed(ctx, path, files[path])
            waiting += [_included(ctx, folder, path, part.get("file", "")) for part in documents[path].iter("include")]
    if documents[model].tag != "mujoco":
        ctx.fail(
            f"`{model}` is not MJCF", element=f"<{documents[model].tag}>", hint="name a file that begins with <mujoco>"
        )
    settings = {
        name: value for root in documents.values() for part in root.iter("compiler") for name, value in part.items()
    }
    for name in _named(documents.values(), settings):
        files[_joined(folder, name)] = ctx.read(_joined(folder, name))
    attached = (part for root in documents.values() for part in root.iter("model"))
    return [_joined(folder, part.get("file", "")) for part in attached]


def _included(ctx: Context, folder: str, path: str, name: str) -> str:
    """MuJoCo searches the model's folder first, then that of the including file."""
    first, beside = _joined(folder, name), _joined(posixpath.dirname(path), name)
    return first if first == beside or ctx.exists(first) else beside


def _parsed(ctx: Context, path: str, data: bytes) -> ET.Element:
    try:
        return ET.fromstring(data)
    except (ET.ParseError, LookupError, ValueError) as error:  # the last two: unknown encoding
        ctx.fail(f"`{path}` is not valid XML", parser=str(error), hint=f"`xmllint --noout {path}` shows the place")


def _named(roots: Iterable[ET.Element], settings: dict[str, str]) -> Iterator[str]:
    """Files of meshes, height fields, skins and textures, relative to the model's folder, as MuJoCo resolves them."""
    for root in roots:
        for part in root.iter():
            if part.tag in _FOLDERS:
                below = settings.get(_FOLDERS[part.tag], settings.get("assetdir", ""))
                for name in filter(None, map(part.get, _SIDES)):
                    yield posixpath.join(
                        below, posixpath.basename(name) if settings.get("strippath") == "true" else name
                    )


def _joined(folder: str, name: str) -> str:
    return posixpath.normpath(posixpath.join(folder, name))
