"""The no-op build: everything that a build depended on, by signature, so that nothing need be planned again."""

from __future__ import annotations

import os
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from dextera_build import __version__, digest
from dextera_build.engine import snapshot
from dextera_build.store.signature import Signature

if TYPE_CHECKING:
    from dextera_build.build.build import Built, Order
    from dextera_build.build.lock import Locking
    from dextera_build.engine.snapshot import Head
    from dextera_build.project import Project
    from dextera_build.recipe.plan import Plan
    from dextera_build.session import Session
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch


Signatures: TypeAlias = dict[str, Signature]
"""Path -> signature of the file."""


@dataclass
class Placed:
    """What a build placed or found in place."""

    paths: dict[str, str] = field(default_factory=dict)
    """Address of a target -> whole path of its main file."""
    present: Signatures = field(default_factory=dict)
    """Whole path -> signature of every file of the targets, as it was written."""
    kept: dict[str, str] = field(default_factory=dict)
    """Address of a target whose files somebody changed -> folder in which these are now."""
    removed: list[str] = field(default_factory=list)
    """Addresses of nodes whose copies were out of date."""


@dataclass(frozen=True)
class Seen:
    """What a build looks at."""

    watch: Watch
    presence: Presence


def seen(session: Session, watch: Watch | None = None) -> Seen:
    """Nothing yet, or what `watch` has noted of other recipes."""
    from dextera_build.store.presence import Presence
    from dextera_build.store.signature import Watch

    return Seen(watch or Watch(), Presence(str(session.store.root)))


def load(session: Session, order: Order, locking: Locking) -> Head | None:
    """The snapshot of the same request, if nothing that it rests on has changed since.

    Its `lines` are the number of nodes and what was placed.
    """
    return snapshot.load_if_fresh(place(session, order, locking), _request(session, order, locking))


def save(session: Session, order: Order, locking: Locking, seen: Seen, built: Built) -> Head | None:
    """Remember a build that went well; None where that cannot be."""
    seen.watch.present = built.placed.present
    lines = [str(built.nodes), *(f"{node}\t{path}" for node, path in built.placed.paths.items())]
    store = (str(session.project.cache), seen.presence)
    return snapshot.save(place(session, order, locking), _request(session, order, locking), seen.watch, lines, store)


def place(session: Session, order: Order, locking: Locking) -> Path:
    """Where the snapshot of a request lies."""
    asked = _request(session, order, locking)
    # Pins change with what is built; the request is the same.
    pins = asked["lock"]
    asked["lock"] = pins[:2] if isinstance(pins, list) else None
    return session.project.cache / "local" / "snapshots" / digest.of_value(asked)[:32]


def note(project: Project, watch: Watch, plan: Plan) -> None:
    """Note what planning read: recipes, code, configuration, and folders in which a new one would lie.

    Packages that are installed are noted, too.
    """
    for path in (*map(str, plan.recipes), *project.looked_at()):
        if os.path.isdir(path):
            watch.folder(path)
        else:
            watch.file(path)
    note_packages(watch)


def note_packages(watch: Watch) -> None:
    """Note what can be imported, and which packages are installed."""
    for entry in sys.path:
        watch.modules(entry or os.getcwd())


def _request(session: Session, order: Order, locking: Locking) -> dict[str, object]:
    """Everything but files that the answer depends on."""
    added = session.added
    return {
        "dxb": __version__,
        "python": sys.version,
        "path": sys.path,
        "root": str(session.project.root),
        "recipe": session.recipe,
        "targets": list(order.targets),
        "profile": session.project.profile,
        "variant": session.variant,
        "input": {name: os.path.abspath(path) for name, path in added.inputs.items()},
        "settings": list(added.settings),
        "backends": dict(added.backends),
        "whole": order.whole,
        "lock": locking.state(session.recipe),
    }
