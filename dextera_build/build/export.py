"""Puts the targets of a build where people open them: `<cache>/out/<recipe>/<node>/`."""

from __future__ import annotations

import itertools
import json
import os
import re
import sys
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.errors import DxbError
from dextera_build.session import Session
from dextera_build.store import durable, failpoints, files, header, sharing

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult

_STAMP = ".digest"
_SMALL = 1 << 20
"""Files up to this size [bytes] are written at once; larger ones never lie whole in memory."""


def place(session: Session, result: RunResult) -> list[str]:
    """Write every target that was built and return one line each: its address, a tab, the whole path of its main file.

    Args:
        session: Whose store has the outputs.
        result: What was built.

    Raises:
        StoreError: The disk is full, or the folder cannot be written.
    """
    lines = []
    stamps: dict[str, str] = {}
    # Texts, because a thousand outputs are placed in the time that some ten thousand `Path` objects take.
    base = os.path.abspath(session.project.cache / "out" / session.recipe)
    for node in result.targets:
        output = result.nodes[node].output
        if output is not None:
            folder = f"{base}/{node.replace('/', '.').replace(':', '.')}"
            try:
                with header.reading(f"`{node}`"):
                    main = _export(session, folder, node, result.nodes[node].rule, output, stamps)
            except OSError as error:
                raise files.store_error(error, error.filename or folder) from None
            lines.append(f"{node}\t{main}")
    # A stamp says that the files beside it are whole, so it comes when they are on the disk.
    if session.project.durable and (stamps or any(node.status == "ran" for node in result.nodes.values())):
        durable.settle(session.store.root)
    for folder, text in stamps.items():
        failpoints.reach("export.stamp")
        files.write(f"{folder}/{_STAMP}", text.encode(), 0o644)
        sharing.share_tree(folder)
    return lines


def stem_of(node: str) -> str:
    """What the files of a node are called: `mesh` for `body[mug].mesh`, `scene` for `twin/scene`."""
    return re.split("[./:]", node)[-1]


def _export(session: Session, folder: str, node: str, rule: str, output: str, stamps: dict[str, str]) -> str:
    digest, name, changed = _standing_in(folder)
    if digest == output and name and not changed:
        return _joined(folder, name)
    aside = _set_aside(folder) if changed else ""
    _clear(folder)
    main = _restored(session, folder, node, rule, output)
    failpoints.reach("export.written")
    stamps[folder] = f"{output}\n{main}\n{_written(folder, main)}"
    if aside and _is_as_written(session, f"{aside}/{name}", node, rule, digest):
        _remove(aside)
    elif aside:
        kept = aside.removeprefix(f"{os.getcwd()}/")
        print(f"`{node}` was changed where it lay and is written anew; what it held is in {kept}", file=sys.stderr)
    return _joined(folder, main)


def _restored(session: Session, folder: str, node: str, rule: str, output: str) -> str:
    """Write the files of an output into a folder; the name of the main one."""
    main = _export_file(session, folder, stem_of(node), output)
    if main is None:
        kind, where = session.project.library.find(rule).rule.returns, Path(folder)
        written = kind.restore(output, session.store.reader, where, stem_of(node))
        main = written[0].relative_to(where).as_posix() if written else "."
    return main


def _standing_in(folder: str) -> tuple[str, str, bool]:
    """(digest, name of the main file, whether that was changed since it was written) of what lies in a folder.

    Two empty texts where nothing does that is whole.
    """
    try:
        digest, _, rest = files.read(f"{folder}/{_STAMP}").decode().partition("\n")
        name, _, written = rest.partition("\n")
        return digest, name, _written(folder, name) != written != ""
    except (OSError, UnicodeDecodeError):
        return "", "", False


def _written(folder: str, name: str) -> str:
    """What changes when a file is written to; a folder's own times say nothing of what was done to its files."""
    if name == ".":
        return ""
    state = os.stat(f"{folder}/{name}")
    return f"{state.st_size} {state.st_mtime_ns}"


def _set_aside(folder: str) -> str:
    """Keep what somebody else wrote into a folder: nobody else has it."""
    aside = f"{folder}~"
    for number in itertools.count(2):
        if not os.path.exists(aside):
            break
        aside = f"{folder}~{number}"
    os.rename(folder, aside)
    return aside


def _is_as_written(session: Session, file: str, node: str, rule: str, output: str) -> bool:
    """Whether a file with a new time holds what was written of `output` all the same: nothing is lost with it."""
    import filecmp  # seldom needed
    import tempfile

    with suppress(DxbError, OSError), header.reading(f"`{node}`"), tempfile.TemporaryDirectory() as scratch:
        return filecmp.cmp(f"{scratch}/{_restored(session, scratch, node, rule, output)}", file, shallow=False)
    return False


def _remove(folder: str) -> None:
    import shutil  # slow to import

    shutil.rmtree(folder, ignore_errors=True)


def _clear(folder: str) -> None:
    """Leave an empty folder."""
    try:
        left = os.listdir(folder)
    except FileNotFoundError:
        sharing.make_folder(folder)
        return
    except OSError:
        left = []
    if left == [_STAMP]:
        os.unlink(f"{folder}/{_STAMP}")
    else:
        _remove(folder)
        sharing.make_folder(folder)
    failpoints.reach("export.cleared")


def _joined(folder: str, name: str) -> str:
    return folder if name == "." else f"{folder}/{name}"


def _export_file(session: Session, folder: str, stem: str, output: str) -> str | None:
    """What `File.restore` does, without what takes longer to import than a thousand files to write; the file's name."""
    stored = json.loads(session.store.blobs.get(output))
    if stored["artifact"] != "File":
        return None
    digest, size = stored["fields"]["data"]["$bytes"]
    if size > _SMALL:
        session.store.reader.place(digest, Path(folder) / stem)
        return stem
    data = session.store.blobs.get(digest)
    with open(f"{folder}/{stem}", "wb", buffering=0) as file:
        file.write(data)
    return stem
