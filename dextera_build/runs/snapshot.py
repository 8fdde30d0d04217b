"""The build that does nothing: as long as everything that an answer rests on is as it was, the answer is given again.

A snapshot stands for one command line in one folder. It holds the signature of every file that was read, also of those
that were looked for and are not there; the names in folders that were searched; the signatures of the files that were
placed; and what was printed. Python takes longer to start than to look at a thousand files, so next to nothing is
loaded to compare them. What a request says is digested, never written: it may hold passwords.
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
_USED = "snapshot made"
LAST = "last"
"""Rows of the state: a recipe of a project -> the variant that was built last."""
_MOST = 64
"""Snapshots that a store keeps."""
_MARK = "\0"
"""Stands between texts; no path has it."""
_BOOT = "/proc/sys/kernel/random/boot_id"
"""Has other bytes after each start of the machine: a power cut may leave short files."""
_PLACES = ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")
"""Variables beside `DXB_*` that say where things are."""


class Recipe:
    """What a snapshot says of one recipe of the command line."""

    __slots__ = ("entries", "last", "name", "nodes", "variant")

    def __init__(self, name: str, nodes: int, last: str, variant: str, entries: "Iterable[str]") -> None:
        self.name, self.nodes = name, nodes
        self.last, self.variant = last, variant
        self.entries = list(entries)
        """Paths of the store's entries of the targets."""


def answer(words: "Sequence[str]", store: str | None = None) -> bool:
    """Give the answer of last time to a command line (without `dxb`) where it still holds; else do nothing.

    Args:
        words: The command line.
        store: The store's folder; None where the settings were not read, then it is where it mostly is. In another
            place there is no snapshot of this request, or it holds just as well: it rests on the settings, too.
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
            with suppress(ValueError, IndexError):  # a row of another form
                if found is not None and _give(state, found, began):
                    return True
    return False


def request(words: "Sequence[str]") -> str:
    """The name of a request: a digest of everything that an answer depends on but files."""
    import hashlib

    from dextera_build.version import __version__

    said = sorted((key, value) for key, value in os.environ.items() if key.startswith("DXB_") or key in _PLACES)
    text = repr((__version__, sys.version, sys.path, list(words), os.getcwd(), said, _boot()))
    return hashlib.sha256(text.encode(errors="surrogatepass")).hexdigest()


def save(
    state: "State",
    words: "Sequence[str]",
    watch: "Watch",
    recipes: "Sequence[Recipe]",
    answers: str,
    *,
    told: bool,
) -> bool:
    """Remember a command that went well; False where a file was not at rest, or the store cannot be written.

    Args:
        state: The store's.
        words: The command line.
        watch: Everything that was read, noted before it was read, and what was placed.
        recipes: Those of the command line.
        answers: What was printed on standard output.
        told: Whether the answer says on standard error that nothing ran.
    """
    from dextera_build.store import failpoints

    name, started = request(words), time.time_ns()
    folders = list(_folders(watch, started))
    if not watch.settled():
        return False
    texts = [answers, "told" if told else "", str(len(recipes))]
    for recipe in recipes:
        texts += [recipe.name, str(recipe.nodes), recipe.last, recipe.variant]
    files = [(path, _spelled(known)) for path, known in (*watch.files.items(), *watch.present.items())]
    entries = [path for recipe in recipes for path in recipe.entries]
    texts += [str(len(files)), str(len(folders)), *(text for row in (*files, *folders) for text in row), *entries]
    if any(_MARK in text for text in texts):
        return False
    done = state.put(KIND, {name: _MARK.join(texts).encode(errors="surrogateescape")})
    made = state.all(_USED)
    old = sorted(made, key=lambda one: made[one])[: max(0, len(made) + 1 - _MOST)]
    state.put(_USED, {name: b"%020d" % started}, without=old)
    state.put(KIND, {}, without=[one for one in old if one != name])
    failpoints.reach("snapshot.saved")
    return done


def _give(state: "State", found: bytes, began: float) -> bool:
    texts = found.decode(errors="surrogateescape").split(_MARK)
    recipes = [texts[place : place + 4] for place in range(3, 3 + 4 * int(texts[2]), 4)]
    place = 3 + 4 * len(recipes)
    files, folders = int(texts[place]), int(texts[place + 1])
    first = place + 2
    second = first + 2 * files
    third = second + 4 * folders
    if not (_are(texts, first, second) and _list(texts, second, third) and all(map(os.path.exists, texts[third:]))):
        return False
    last = {recipe[2]: recipe[3].encode() for recipe in recipes}
    if state.some(LAST, last) != last:
        state.put(LAST, last)
    for name, nodes, _, _ in recipes:
        if texts[1]:
            many = "s" * (nodes != "1")
            sys.stderr.write(f"{name} is up to date   {nodes} node{many}   {time.perf_counter() - began:.2f} s\n")
    sys.stdout.write(texts[0])
    return True


def _are(texts: list[str], first: int, end: int) -> bool:
    """Whether all files have the signatures that they had."""
    stat = os.stat
    for place in range(first, end, 2):
        try:
            state = stat(texts[place])
        except OSError:
            if texts[place + 1]:
                return False
        else:
            if texts[place + 1] != f"{state.st_mtime_ns} {state.st_ctime_ns} {state.st_size} {state.st_ino}":
                return False
    return True


def _list(texts: list[str], first: int, end: int) -> bool:
    """Whether all folders hold the names that they held; those whose time stamps moved are listed."""
    for place in range(first, end, 4):
        path, kind, stamp, check = texts[place : place + 4]
        try:
            state = os.stat(path)
        except OSError:
            if check:
                return False
            continue
        if stamp != f"{state.st_mtime_ns} {state.st_ino}" and _names(path, kind) != check:
            return False
    return True


def _folders(watch: "Watch", started: int) -> "Iterator[tuple[str, str, str, str]]":
    from dextera_build.store import signature

    for kind, folders in (("names", watch.folders), ("modules", watch.paths)):
        for path, known in folders.items():
            state = signature.look(path)
            stamp = f"{state[0]} {state[3]}" if state and not signature.is_racy(state, started) else ""
            yield path, kind, stamp, _check(known)


def _names(path: str, kind: str) -> str:
    from dextera_build.store import signature

    return _check(signature.names(path) if kind == "names" else signature.modules(path))


def _check(names: list[str] | None) -> str:
    import zlib

    return "" if names is None else str(zlib.crc32("/".join(names).encode(errors="surrogateescape")))


def _spelled(known: tuple[int, int, int, int] | None) -> str:
    return " ".join(map(str, known)) if known else ""


def _stores() -> "Iterator[str]":
    """Where the store of the current folder may be."""
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
