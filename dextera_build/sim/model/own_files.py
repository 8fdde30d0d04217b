"""Check that a model refers only to files of its own folder, because MuJoCo searches all others on the disk."""

from __future__ import annotations

import posixpath
from collections.abc import Mapping

from dextera_build.errors import RuleError
from dextera_build.formats import xml_text


def check(main: str, files: Mapping[str, bytes]) -> None:
    """Raise if the MJCF `main` includes or attaches models, or names a file that is not in `files`.

    Raises:
        RuleError: It does so, or is not XML.
    """
    try:
        root = xml_text.parsed(files[main])
    except ValueError as error:
        raise RuleError(f"`{main}` does not load", code="DXB-B211", facts={"parser": error}) from None
    settings: dict[str, str] = {}
    for compiler in root.iter("compiler"):
        settings |= compiler.attrib
    folders = {kind: settings.get(f"{kind}dir", settings.get("assetdir", "")) for kind in ("mesh", "texture")}
    for element in root.iter():
        names = [name for key, name in element.items() if key.startswith("file") and name]
        for name in names:
            below = folders["texture" if element.tag == "texture" else "mesh"]
            bare = posixpath.basename(name) if settings.get("strippath") == "true" else name
            place = posixpath.normpath(posixpath.join(posixpath.dirname(main), below, bare))
            if element.tag in ("include", "model") or place not in files:
                raise RuleError(
                    f"`{name}`, which `{main}` names, is not in its folder",
                    code="DXB-B218",
                    facts={"element": f"<{element.tag}>", "place": place},
                    hint="put the file into the folder; includes and attached models are written out",
                )
