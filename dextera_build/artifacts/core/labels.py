"""Labels of collections and folders: each must be usable as a file name."""

from __future__ import annotations

import re
from collections.abc import Iterable

from dextera_build.errors import ArtifactError

_LONGEST, _LONGEST_PATH = 255, 2000
"""Maximum length of a file name and of a path on all common file systems [bytes]."""
_ROOM = 55
"""Length reserved for the node's name and the suffix that exported files add to the label [bytes]."""
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069]")
"""Control characters, line separators and text direction overrides."""


def check_labels(kind: str, labels: Iterable[str]) -> None:
    """Raise for labels of a collection that cannot be part of a file name.

    Raises:
        ArtifactError: A label is invalid; the error names the label and the reason.
    """
    for label in labels:
        wrong = "it holds a `/`" if "/" in label else _fault(label, _LONGEST - _ROOM)
        if wrong:
            raise _refused(kind, label, wrong)


def check_paths(kind: str, paths: Iterable[str]) -> None:
    """Raise for paths of a folder's files that cannot be written below one folder.

    Raises:
        ArtifactError: A path is invalid; the error names the path and the reason.
    """
    known = set(paths)
    for path in known:
        wrong = path_fault(path)
        parts = path.split("/")
        above = next((above for n in range(1, len(parts)) if (above := "/".join(parts[:n])) in known), None)
        if not wrong and above is not None:
            wrong = f"`{above}` is a file of the folder, too"
        if wrong:
            raise _refused(kind, path, wrong)


def path_fault(path: str) -> str:
    """Reason why a relative path cannot be written below a folder, or ""."""
    found = next(filter(None, (_fault(part, _LONGEST) for part in path.split("/"))), "")
    return found or ("it is longer than 2,000 bytes" if len(path.encode()) > _LONGEST_PATH else "")


def _fault(part: str, longest: int) -> str:
    if part in ("", ".", ".."):
        return "a name is empty" if not part else f"`{part}` is not a name"
    try:
        size = len(part.encode())
    except UnicodeEncodeError:
        return "it is not valid Unicode"
    if size > longest:
        return f"a name has {size:,} bytes, {longest} are the most"
    return "it holds a control character" if _CONTROL.search(part) else ""


def _refused(kind: str, label: str, wrong: str) -> ArtifactError:
    return ArtifactError(
        f"{kind}: `{label}` cannot be the name of a file: {wrong}",
        code="DXB-A110",
        hint="labels become file names: rename it in the rule or input that sets it",
    )
