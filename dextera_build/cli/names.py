"""Names of a recipe's nodes as builds saw them, one a line, in a file that completion reads and loads nothing for."""

import os

from dextera_build.cli import quick

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable

    from dextera_build.cli.session import Session
    from dextera_build.engine.graph import Graph


def read(store: str, project: str, recipe: str) -> list[str] | None:
    """Names of all nodes of a recipe, or None where none were noted."""
    try:
        whose, *names = quick.opened(_place(store, project, recipe)).decode(errors="surrogateescape").split("\n")
    except (OSError, ValueError):
        return None
    return names if whose == _whose(project, recipe) else None


def note(session: "Session", graph: "Graph", built: "Iterable[str]") -> None:
    """Note what a build saw.

    Args:
        session: The recipe.
        graph: What it declares now.
        built: Nodes of the build. Of those that it did not come to, the copies of before stay.
    """
    from contextlib import suppress

    from dextera_build.errors import StoreError
    from dextera_build.store import files

    store, project = str(session.project.cache), str(session.project.root)
    old = read(store, project, session.recipe)
    names = sorted(built)
    if old:
        calls = {plain(name) for name in names}
        others = {".".join(call) for call, _ in graph.calls()} - calls
        names += [name for name in old if plain(name) in others]
    if names != old:
        # A store that may only be read, or has no room, keeps what it has.
        with suppress(StoreError):
            text = "\n".join([_whose(project, session.recipe), *names]).encode(errors="surrogateescape")
            files.write(_place(store, project, session.recipe), quick.sealed(text), 0o644)


def plain(name: str) -> str:
    """The call that a node is a copy of: `body.mesh` for `body[mug].mesh`."""
    head, *parts = name.split("[")
    return head + "".join(part.partition("]")[2] for part in parts)


def _place(store: str, project: str, recipe: str) -> str:
    import zlib

    return f"{store}/local/names/{zlib.crc32(os.fsencode(_whose(project, recipe))):08x}"


def _whose(project: str, recipe: str) -> str:
    return f"{recipe} {project}"
