"""Puts the targets of a build where people open them: `<cache>/out/<recipe>/<node>/`."""

from __future__ import annotations

import re
import shutil
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
        record = result.nodes[node]
        if record.output is not None:
            try:
                main = _export(session, node, record.rule, record.output, stamps)
            except OSError as error:
                raise files.store_error(error, error.filename or str(folder_of(session, node))) from None
            lines.append(f"{node}\t{session.project.shown(main)}")
    # A stamp says that the files beside it are whole, so it comes when they are on the disk.
    if session.project.durable and (stamps or any(record.status == "ran" for record in result.nodes.values())):
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
    stamp = folder / _STAMP
    if stamp.is_file():
        digest, _, name = stamp.read_text().partition("\n")
        if digest == output and (folder / name).exists():
            return folder / name
    shutil.rmtree(folder, ignore_errors=True)
    sharing.make_folder(str(folder))
    kind = session.project.library.find(rule).rule.returns
    written = kind.restore(output, session.store.reader, folder, stem_of(node))
    main: Path = written[0] if written else folder
    stamps[folder] = f"{output}\n{main.relative_to(folder).as_posix()}"
    return main
