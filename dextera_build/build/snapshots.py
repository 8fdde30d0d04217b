"""The no-op build: everything that a build depended on, by signature, so that nothing need be planned again."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build import digest
from dextera_build.engine import snapshot
from dextera_build.errors import DxbError, StoreError

_DEEPEST = 30
"""After so many builds that went on from one another comes one that looks at everything: its log stands alone."""

if TYPE_CHECKING:
    from dextera_build.engine.execute import RunResult
    from dextera_build.engine.known import Known
    from dextera_build.engine.snapshot import Head, Stale
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch
    from dextera_build.store.store import Store


@dataclass(frozen=True)
class Seen:
    """What a build looks at."""

    watch: Watch
    presence: Presence


@dataclass(frozen=True)
class Near:
    """A build to go on from."""

    stale: Stale
    known: Known

    @property
    def idle(self) -> bool:
        """Whether the files that changed hold what they held."""
        return not self.known.cone

    @property
    def placed(self) -> bool:
        """Whether all that was written is there."""
        return snapshot.is_placed(self.stale.head)


def load(project: Project, fingerprint: Mapping[str, object]) -> Stale | None:
    """What is remembered of the same request, if nothing that it saw has changed since but files.

    The `lines` of its head are the number of nodes and what it printed.
    """
    return snapshot.load_if_near(place(project, fingerprint), dict(fingerprint))


def save(
    project: Project, fingerprint: Mapping[str, object], seen: Seen, plan: Plan, result: RunResult, lines: list[str]
) -> Head | None:
    """Remember a build that went well; None where that cannot be.

    A file that was changed after `seen` was made keeps the snapshot from being written, so it may be noted here.
    """
    from dextera_build.engine import known
    from dextera_build.recipe.content import content

    outputs = _placed(lines)
    watch, path = seen.watch, place(project, fingerprint)
    fixed = note(project, watch, plan)
    watch.blobs(outputs)
    store = (str(project.cache), seen.presence)
    snapshot.forget(path)
    assert result.wiring is not None
    with suppress(StoreError):
        if not known.write(path, plan.graph, result.wiring, result.run, result.peak_gb):
            snapshot.forget(path.with_suffix(".plan"))
    contents = {str(file): content(file) for file in plan.recipes}
    contents |= {str(file): said for file, said in project.library.code.contents().items()}
    more = {"fixed": fixed, "contents": contents, "nodes": str(len(result.nodes))}
    return snapshot.save(path, dict(fingerprint), watch, [str(len(result.nodes)), *lines], store, more)


def note(project: Project, watch: Watch, plan: Plan) -> list[str]:
    """Note what planning read, and return it: recipes, code, configuration, and folders in which a new one would lie.

    Packages that are installed are noted, too.
    """
    from dextera_build.code.loader import bundled

    configuration = [project.root / name for name in ("dxb.toml", "dxb.local.toml", "pyproject.toml")]
    noted = [os.fspath(file) for file in (*plan.recipes, *project.library.code.files(), *configuration)]
    for file in noted:
        watch.file(file)
    # A new rule, backend or recipe: all change the names in a folder.
    for folder in (*project.library.folders(), project.root / "recipes", bundled("recipes")):
        if folder.is_dir():
            watch.folder(folder)
            noted.append(os.fspath(folder))
    note_packages(watch)
    return noted


def note_packages(watch: Watch) -> None:
    """Note what can be imported, and which packages are installed."""
    for entry in sys.path:
        watch.modules(entry or os.getcwd())


def near(project: Project, fingerprint: Mapping[str, object], stale: Stale, store: Store) -> Near | None:
    """What the last build of a request knew, if nothing changed since but files that nodes read, and comments."""
    try:
        return _known(project, place(project, fingerprint), stale, store)
    except (OSError, ValueError, KeyError, TypeError, IndexError, AttributeError):
        return None  # it was damaged, or another version wrote it
    except DxbError:
        return None  # a file cannot be read; planning says it better


def _known(project: Project, path: Path, stale: Stale, store: Store) -> Near | None:
    from dextera_build.engine import known
    from dextera_build.store.traces.look import Look

    leaves = store.leaves
    said = [name for name in stale.changed if name in stale.head["fixed"]]
    if not all(_says_the_same(name, stale.head, store) for name in said):
        return None
    found = known.read(path)
    if found.depth >= _DEEPEST or not (project.cache / "runs" / found.run).is_dir():
        return None
    files = [name for name in stale.changed if name not in said or name in found.leaves]
    nodes, others = found.reread.changed(stale.changed, Look(project.root, leaves, store.root))
    tops = {name: _leaf_of(name, found.head["leaves"]) for name in files}
    declared = {top for top in tops.values() if top is not None}
    if any(tops[name] is None for name in files if name in others) or not all(
        _is_whole(top, stale.head) for top in declared
    ):
        return None
    changed = [top for top in declared if leaves.digest_leaf(Path(top)) != found.leaves[top]]
    return Near(stale, found) if found.spread(changed, nodes) else None


def renew(project: Project, fingerprint: Mapping[str, object], seen: Seen, near: Near, lines: list[str]) -> Head | None:
    """Remember a build that went on from another; None where that cannot be."""
    path = place(project, fingerprint)
    seen.watch.blobs(file for file in _placed(lines) if file not in seen.watch.present)
    with suppress(StoreError, OSError, ValueError):
        near.known.write_state(path)
        near.stale.head["request"] = dict(fingerprint)
        return snapshot.renew(path, near.stale, seen.watch, [near.stale.head["nodes"], *lines], seen.presence)
    return None


def told(lines: Sequence[str]) -> str:
    """What a build prints of what it placed: paths below the current folder are relative to it."""
    here = f"{os.getcwd()}/"
    text = "".join([f"{line}\n" for line in lines])
    if text.count("\t") == len(lines):  # no path has one
        return text.replace(f"\t{here}", "\t")
    said = (line.partition("\t") for line in lines)
    return "".join(f"{node}\t{path.removeprefix(here)}\n" for node, _, path in said)


def _placed(lines: list[str]) -> list[str]:
    return [line.partition("\t")[2] for line in lines]


def _says_the_same(name: str, head: Mapping[str, Mapping[str, str | None]], store: Store) -> bool:
    """Whether only comments and layout of a recipe or of a rule's source changed."""
    if store.leaves.watch is not None:
        store.leaves.watch.file(name)
    if name.endswith(".yaml"):
        from dextera_build.recipe.content import content
    else:
        from dextera_build.code.code_digest import content
    known = head["contents"].get(name)
    return known is not None and content(Path(name)) == known


def _leaf_of(name: str, leaves: Mapping[str, object]) -> str | None:
    """The declared file or folder that a watched one is or lies in."""
    while name not in leaves:
        above = os.path.dirname(name)
        if above == name:
            return None
        name = above
    return name


def _is_whole(leaf: str, head: Mapping[str, Mapping[str, object]]) -> bool:
    """Whether a declared file is a file still, and a folder a folder: the plan depends on that."""
    return os.path.isdir(leaf) if leaf in head["folders"] else os.path.isfile(leaf)


def place(project: Project, fingerprint: Mapping[str, object]) -> Path:
    """Where a request is remembered."""
    # Pins change with what is built; the request is the same.
    locking = fingerprint.get("lock")
    asked = {**fingerprint, "lock": locking[:2] if isinstance(locking, list) else None}
    return project.cache / "local" / "snapshots" / digest.of_value(asked)[:32]
