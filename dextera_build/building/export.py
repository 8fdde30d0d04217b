"""Exports the targets of a build to `<cache>/out/<recipe>/<node>/`; `places` has the exact rules."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build import digest as digests
from dextera_build.building import places
from dextera_build.building.places import name_of
from dextera_build.errors import DxbError
from dextera_build.session import Session
from dextera_build.store import failpoints, files, headers, permissions, signature
from dextera_build.store.signature import Signature

if TYPE_CHECKING:
    from dextera_build.engine.run import RunResult

TABLE = ".placed"
"""File next to the node folders that lists the files dxb wrote there."""
_FORM = 1
_OLD_S = 3600.0
"""Age [s] at which unfinished folders are removed even if locks do not work."""


@dataclass
class Placed:
    """The files that a build exported or found up to date."""

    paths: dict[str, str] = field(default_factory=dict)
    """Address of a target -> absolute path of its main file."""
    present: dict[str, Signature] = field(default_factory=dict)
    """Absolute path of each file of the targets -> its signature when written."""
    kept: dict[str, str] = field(default_factory=dict)
    """Address of a target whose files were edited -> folder that now holds the edited files."""
    removed: list[str] = field(default_factory=list)
    """Addresses of nodes whose outdated copies were removed."""


@dataclass(frozen=True)
class _Copy:
    """A node's files as dxb wrote them."""

    output: str
    rule: str
    main: str = ""
    files: Mapping[str, Signature] = field(default_factory=dict)

    def is_intact(self, folder: str) -> bool:
        """Whether every file is unchanged since it was written; added files do not count."""
        return all(signature.look(f"{folder}/{name}") == known for name, known in self.files.items())


class Out:
    """The output folder of one recipe and request.

    Args:
        session: The recipe; its store holds the outputs.
    """

    def __init__(self, session: Session) -> None:
        self._session = session
        self._place = places.of(session.project, session.recipe, session.variant)
        self.base = self._place.folder
        self._scratch = ""
        self._placed = Placed()

    @contextmanager
    def held(self) -> Iterator[None]:
        """Lock the folder against other builds, from reading the table until it is saved."""
        with self._place.locks.hold(self._place.lock):
            yield

    def place(self, result: RunResult, gone: Iterable[str] = ()) -> Placed:
        """Write every target that was built; call it while the folder is `held`.

        Every folder is written under a temporary name and then renamed, so no reader sees a partial one, and the
        signatures are taken before any other process can change the files.

        Args:
            result: The result of the build.
            gone: Addresses from `nodes` whose copies are outdated; they are removed.

        Raises:
            StoreError: The disk is full, or the folder cannot be written.
        """
        self._placed = Placed()
        table = self._table()
        outputs = {node: output for node in result.targets if (output := result.nodes[node].output) is not None}
        stale = {node for node in outputs if not self._stands(table.get(node), outputs[node], node)}
        gone = [node for node in gone if node in table]
        if (stale or gone) and not self._may_be_written():
            # Copied stores and changed permissions leave other times: then only the content counts.
            table |= self._equal({node: outputs[node] for node in stale}, result)
            stale, gone = {node for node in stale if not self._stands(table.get(node), outputs[node], node)}, []
        try:
            if stale or gone:
                self._replace(table, {node: outputs[node] for node in outputs if node in stale}, gone, result)
                self._placed.removed = gone
            elif self._session.project.durable and any(node.status == "ran" for node in result.nodes.values()):
                files.settle(str(self._session.store.root))
        except OSError as error:
            raise files.store_error(error, error.filename or self.base) from None
        for node in outputs:
            folder, copy = self._folder(node), table[node]
            self._placed.paths[node] = folder if copy.main == "." else f"{folder}/{copy.main}"
            self._placed.present |= {f"{folder}/{name}": known for name, known in copy.files.items()}
        return self._placed

    def nodes(self) -> dict[str, str]:
        """Address -> output of every node in the folder."""
        return {node: copy.output for node, copy in self._table().items()}

    def _may_be_written(self) -> bool:
        there = next(folder for folder in (Path(self.base), *Path(self.base).parents) if folder.is_dir())
        return os.access(there, os.W_OK)

    def _equal(self, outputs: Mapping[str, str], result: RunResult) -> dict[str, _Copy]:
        """Node -> its files as they are, for the nodes whose folders hold the content of their outputs."""
        import filecmp
        import tempfile

        found = {}
        for node, output in outputs.items():
            copy, folder = _Copy(output, result.nodes[node].rule), self._folder(node)
            with tempfile.TemporaryDirectory() as scratch, suppress(OSError):
                main = self._restore(scratch, node, copy)
                known = {name: signature.of(os.stat(f"{folder}/{name}")) for name in _files(scratch)}
                if all(filecmp.cmp(f"{scratch}/{name}", f"{folder}/{name}", shallow=False) for name in known):
                    found[node] = replace(copy, main=main, files=known)
        return found

    def _stands(self, copy: _Copy | None, output: str, node: str) -> bool:
        return copy is not None and copy.output == output and copy.is_intact(self._folder(node))

    def _replace(
        self, table: dict[str, _Copy], stale: Mapping[str, str], gone: Iterable[str], result: RunResult
    ) -> None:
        permissions.make_folder(self.base)
        self._sweep()
        self._scratch = f"{self.base}/{files.TEMPORARY}-{files.unique()}"
        permissions.make_folder(self._scratch)
        try:
            made = {node: self._write(node, _Copy(stale[node], result.nodes[node].rule)) for node in stale}
            failpoints.reach("export.written")
            # The table claims complete files, so it is written after they are on disk.
            if self._session.project.durable:
                files.settle(str(self._session.store.root))
                if os.stat(self.base).st_dev != os.stat(self._session.store.root).st_dev:
                    files.settle(self.base)
            old = {node: table.pop(node) for node in (*stale, *gone) if node in table}
            if old:
                self._save(table)
            for node in (*stale, *gone):
                self._swap(node, old.get(node))
            table |= made
            failpoints.reach("export.stamp")
            self._save(table)
        finally:
            shutil.rmtree(self._scratch, ignore_errors=True)

    def _write(self, node: str, copy: _Copy) -> _Copy:
        folder = f"{self._scratch}/{name_of(node)}"
        os.mkdir(folder)
        main = self._restore(folder, node, copy)
        permissions.share_tree(folder)
        written = {name: signature.of(os.stat(f"{folder}/{name}")) for name in _files(folder)}
        return replace(copy, main=main, files=written)

    def _restore(self, folder: str, node: str, copy: _Copy) -> str:
        """Write the files of an output into a folder; returns the name of the main file."""
        from dextera_build.artifacts.core.forms import type_among  # slow to import

        with headers.reading(f"`{node}`"):
            returns, where = self._session.project.library.find(copy.rule).rule.returns, Path(folder)
            kind = type_among(returns, copy.output, self._session.store.reader)
            written = kind.restore(copy.output, self._session.store.reader, where, stem_of(node))
            return written[0].relative_to(where).as_posix() if written else "."

    def _swap(self, node: str, old: _Copy | None) -> None:
        """Move the new folder of a node into place; an edited old folder is kept under another name."""
        folder, new, aside = self._folder(node), f"{self._scratch}/{name_of(node)}", f"{self._scratch}/~{name_of(node)}"
        with suppress(FileNotFoundError):
            os.rename(folder, aside)
        failpoints.reach("export.cleared")
        if os.path.isdir(new):
            os.rename(new, folder)
        if os.path.isdir(aside) and (_holds_table(aside) if old is None else self._is_changed(aside, node, old)):
            self._placed.kept[node] = _free(folder)
            os.rename(aside, self._placed.kept[node])

    def _is_changed(self, folder: str, node: str, old: _Copy) -> bool:
        """Whether a folder holds content that dxb did not write; a changed timestamp alone does not count."""
        names = {*_files(folder)}
        if not names <= old.files.keys():
            return True
        touched = [name for name in names if signature.look(f"{folder}/{name}") != old.files[name]]
        if not touched:
            return False
        import filecmp  # rarely needed

        scratch = f"{self._scratch}/={name_of(node)}"
        with suppress(DxbError, OSError):
            os.mkdir(scratch)
            self._restore(scratch, node, old)
            return not all(filecmp.cmp(f"{scratch}/{name}", f"{folder}/{name}", shallow=False) for name in touched)
        return True

    def _folder(self, node: str) -> str:
        return f"{self.base}/{name_of(node)}"

    def _sweep(self) -> None:
        """Remove unfinished folders of killed builds; no other build writes here while the folder is held."""
        import time

        sure = self._place.locks.reliable()
        for entry in os.scandir(self.base):
            if entry.name.startswith(f"{files.TEMPORARY}-"):
                with suppress(OSError):
                    if sure or entry.stat().st_mtime < time.time() - _OLD_S:
                        shutil.rmtree(entry.path) if entry.is_dir() else os.unlink(entry.path)

    def _table(self) -> dict[str, _Copy]:
        """The files that dxb wrote; empty if unknown, so every target is written again."""
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            said = json.loads(files.read(f"{self.base}/{TABLE}"))
            if said["form"] == _FORM and said["check"] == digests.of_value(said["nodes"]):
                return {
                    node: _Copy(output, rule, main, {name: _signature(known) for name, known in written.items()})
                    for node, (output, rule, main, written) in said["nodes"].items()
                }
        return {}

    def _save(self, table: Mapping[str, _Copy]) -> None:
        nodes = {node: [copy.output, copy.rule, copy.main, copy.files] for node, copy in table.items()}
        text = json.dumps({"form": _FORM, "check": digests.of_value(nodes), "nodes": nodes})
        # A folder of this name is damage and moved aside, into the same folder as unfinished files.
        files.write(f"{self.base}/{TABLE}", text.encode(), 0o644, workshop=self.base)


def stem_of(node: str) -> str:
    """The file stem of a node: `mesh` for `body[mug].mesh`, `scene` for `twin/scene`."""
    return re.split("[./:]", node)[-1]


def _files(folder: str) -> Iterator[str]:
    """Paths of all files below a folder, relative to it."""
    for place, _, names in os.walk(folder):
        below = place[len(folder) + 1 :]
        yield from (f"{below}/{name}" if below else name for name in names)


def _holds_table(folder: str) -> bool:
    """Whether the files of a recipe lie in a folder: of `g/a` in that of `g:a`, from before there was a recipe `g`."""
    return any(TABLE in names for _, _, names in os.walk(folder))


def _free(folder: str) -> str:
    """An unused name next to a folder."""
    names = (f"{folder}~{number}" if number > 1 else f"{folder}~" for number in count(1))
    return next(name for name in names if not os.path.exists(name))


def _signature(known: list[int]) -> Signature:
    mtime, ctime, size, inode = known
    return mtime, ctime, size, inode
