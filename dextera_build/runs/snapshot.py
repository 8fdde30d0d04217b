"""The fast path of a no-op build: repeats the previous answer if nothing that it depends on has changed.

A snapshot belongs to one command line in one folder. It holds the signature of every file that was read, including
missing files that were looked for; the names in searched folders; the signatures of the exported files; and the printed
output. Python takes longer to start than to stat a thousand files, so this module imports almost nothing. The request
is stored only as a digest, because it may contain passwords.
"""

import os
import sys
import time
from contextlib import suppress

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from dextera_build.store.signature import Watch
    from dextera_build.store.state import State

KIND = "snapshot"
LAST = "last"
"""Kind of state rows: a recipe of a project -> the variant built last."""
_MOST = 64
"""Maximum number of snapshots in a store."""
_BOOT = "/proc/sys/kernel/random/boot_id"
"""Changes with every boot; after a power cut, files may be truncated."""
_PLACES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
"""Variables other than `DXB_*` that locate files."""


class Recipe:
    """The part of a snapshot about one recipe of the command line."""

    __slots__ = ("entries", "last", "name", "nodes", "stubs", "variant")

    def __init__(self, name: str, nodes: int, stubs: str, last: str, variant: str, entries: "Iterable[str]") -> None:
        self.name, self.nodes, self.stubs = name, nodes, stubs
        self.last, self.variant = last, variant
        self.entries = list(entries)
        """Paths of the targets' entries in the store."""


def answer(words: "Sequence[str]", store: str | None = None) -> bool:
    """Print the previous answer to a command line (without `dxb`) if it is still valid; return whether it was.

    Args:
        words: The command line.
        store: The store's folder; None to try the usual places before the settings are read. A snapshot found there
            is valid wherever the store is, because it depends on the settings, too.
    """
    began = time.perf_counter()
    if list(words[:1]) != ["build"]:
        return False
    name = ""
    for folder in _stores() if store is None else [store]:
        path = f"{folder}/local/state.db"
        if os.path.exists(path):
            from dextera_build.store.state import State

            name, state = name or request(words), State(path)
            found = state.get(KIND, name)
            with suppress(ValueError, IndexError):  # a malformed row
                if found is not None and _give(state, found, began):
                    return True
    return False


def request(words: "Sequence[str]") -> str:
    """The name of a request: a digest of everything that the answer depends on except files."""
    import hashlib

    said = sorted((key, value) for key, value in os.environ.items() if key.startswith("DXB_") or key in _PLACES)
    text = repr((*here(), list(words), said))
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()


def here() -> "tuple[object, ...]":
    """The programs, the folder and the boot of this command."""
    from dextera_build.version import __version__

    return __version__, sys.version, sys.path, os.getcwd(), _boot()


def save(
    state: "State",
    words: "Sequence[str]",
    watch: "Watch",
    recipes: "Sequence[Recipe]",
    answers: str,
    *,
    told: bool,
) -> bool:
    """Save the snapshot of a successful command; False if a file is still changing or the store cannot be written.

    Args:
        state: The state of the store.
        words: The command line.
        watch: Signatures of all files that were read, taken before reading, and of exported files.
        recipes: The recipes of the command line.
        answers: Text printed to standard output.
        told: Whether the answer includes the "up to date" lines on standard error.
    """
    from dextera_build.store import failpoints, seen

    name, rows = request(words), seen.texts(watch, time.time_ns())
    if not watch.settled():
        return False
    texts = [answers, "told" if told else "", str(len(recipes))]
    for recipe in recipes:
        texts += [recipe.name, str(recipe.nodes), recipe.stubs, recipe.last, recipe.variant]
    texts += rows + [path for recipe in recipes for path in recipe.entries]
    if any(seen.MARK in text for text in texts):
        return False
    done = state.put_newest(KIND, name, seen.MARK.join(texts).encode(errors="surrogateescape"), most=_MOST)
    failpoints.reach("snapshot.saved")
    return done


def _give(state: "State", found: bytes, began: float) -> bool:
    from dextera_build.store import seen

    texts = found.decode(errors="surrogateescape").split(seen.MARK)
    recipes = [texts[place : place + 5] for place in range(3, 3 + 5 * int(texts[2]), 5)]
    place = 3 + 5 * len(recipes)
    if not (seen.still(texts, place) and all(map(os.path.exists, texts[seen.end(texts, place) :]))):
        return False
    last = {recipe[3]: recipe[4].encode() for recipe in recipes}
    if state.some(LAST, last) != last:
        state.put(LAST, last)
    for name, nodes, stubs, *_ in recipes:
        if texts[1]:
            many = "s" * (nodes != "1")
            sys.stderr.write(f"{name} is up to date   {nodes} node{many}   {time.perf_counter() - began:.2f} s\n")
            sys.stderr.write(f"{stubs}\n" if stubs else "")
    sys.stdout.write(texts[0])
    return True


def _stores() -> "Iterator[str]":
    """Possible store folders for the current folder."""
    if "DXB_CACHE" in os.environ:
        yield os.path.abspath(os.environ["DXB_CACHE"])
        return
    folder = os.getcwd()
    while True:
        yield f"{folder}/cache"
        above = os.path.dirname(folder)
        if above == folder:
            return
        folder = above


def _boot() -> str:
    try:
        with open(_BOOT) as file:
            return file.read()
    except OSError:
        return ""
