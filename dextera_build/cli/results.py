"""Puts the targets of a build where people open them: `<cache>/out/<recipe>/<node>/`."""

from __future__ import annotations

import json
import os
import re
import shutil
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.cli.session import Session
from dextera_build.store import durable, files, sharing

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult

_STAMP = ".digest"


def place(session: Session, result: RunResult) -> list[str]:
    """Write every target that was built and return one line each: its address, a tab, its main file.

    Raises:
        StoreError: The disk is full, or the folder cannot be written.
    """
    lines = []
    stamps: dict[Path, str] = {}
    for node in result.targets:
        rule, output = result.made(node)
        if output is not None:
            try:
                main = _export(session, node, rule, output, stamps)
            except OSError as error:
                raise files.store_error(error, error.filename or str(folder_of(session, node))) from None
            lines.append(f"{node}\t{session.project.shown(main)}")
    # A stamp says that the files beside it are whole, so it comes when they are on the disk.
    if session.project.durable and (stamps or any(record.status == "ran" for record in result.own.values())):
        durable.settle(session.store.root)
    for folder, text in stamps.items():
        files.write(str(folder / _STAMP), text.encode(), 0o644)
        sharing.share_tree(str(folder))
    return lines


def folder_of(session: Session, node: str) -> Path:
    """Where a node's files lie."""
    return session.project.cache / "out" / session.recipe / node.replace("/", ".").replace(":", ".")


def stem_of(node: str) -> str:
    """What the files of a node are called: `mesh` for `body[mug].mesh`, `scene` for `twin/scene`."""
    return re.split("[./:]", node)[-1]


def _export(session: Session, node: str, rule: str, output: str, stamps: dict[Path, str]) -> Path:
    folder = folder_of(session, node)
    stamp = f"{folder}/{_STAMP}"
    with suppress(OSError):
        digest, _, name = files.read(stamp).decode().partition("\n")
        if digest == output and os.path.exists(f"{folder}/{name}"):
            return folder / name
    if os.path.exists(folder):
        shutil.rmtree(folder, ignore_errors=True)
    sharing.make_folder(str(folder))
    main = _export_file(session, folder, stem_of(node), output)
    if main is None:
        kind = session.project.library.find(rule).rule.returns
        written = kind.restore(output, session.store.reader, folder, stem_of(node))
        main = written[0] if written else folder
    stamps[folder] = f"{output}\n{main.relative_to(folder).as_posix()}"
    return main


def _export_file(session: Session, folder: Path, stem: str, output: str) -> Path | None:
    """What `File.export` does, without what takes longer to import than a thousand files to write."""
    header = json.loads(session.store.blobs.get(output))
    if header["artifact"] != "File":
        return None
    data = session.store.blobs.get(header["fields"]["data"]["$bytes"][0])
    os.makedirs(folder, exist_ok=True)
    with open(f"{folder}/{stem}", "wb", buffering=0) as file:
        file.write(data)
    return folder / stem
