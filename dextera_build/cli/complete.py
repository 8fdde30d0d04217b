"""What may stand at the end of a command line: from the grammar, the project's files, and what builds noted.

No rule is imported, no recipe is read and next to nothing is loaded, so that an answer is there before a person
notices.
"""

import os
import sys

from dextera_build.cli import names, quick
from dextera_build.cli.verbs import VERBS
from dextera_build.recipe.addresses import addresses

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

Candidate = tuple[str, str]
"""A word and what it is."""

_FINISHED = rb'^\{.*?"event": "node_finished".*?"node": ("(?:[^"\\]|\\.)*")'
_LOOK = 200
"""How many runs are looked at."""
_RUNS = 3
"""How many of a recipe are read."""
_SPECIAL = str.maketrans({letter: f"\\{letter}" for letter in "[]*?()&;|<>$`\\\"'! "})

_TARGETS = {"build", "plan", "get", "why", "show", "view", "check", "graph", "watch", "push", "pull"}
_PAST = {"log", "report", "trace"}
_WORDS = {"new": ("recipe", "rule", "backend"), "completion": ("bash", "zsh", "fish"), "cache": ("size", "sweep")}
_VALUES = {"--profile": ("stub", "cpu", "gpu", "cloud"), "--console": ("live", "plain", "jsonl", "none")}


def say(words: list[str]) -> bool:
    """Answer a command line (without `dxb`) of a shell's script; False for every other one, and where that fails."""
    if len(words) != 4 or words[0] != "completion" or words[1] not in _WORDS["completion"] or words[2] != "--line":
        return False
    try:
        lines = answer(words[1], words[3])
    except Exception:  # a broken recipe or setting must not write into the line that a person types
        return False
    sys.stdout.write("".join(line + "\n" for line in lines))
    return True


def answer(shell: str, line: str) -> list[str]:
    """Lines for a shell's script: words that end `line`, in bash without what stands before the last colon."""
    words, current, quoted = split(line)
    found = [(word, text) for word, text in candidates(words, current) if word.startswith(current)]
    if shell == "bash":
        # Readline takes a colon and `=` for the end of a word, unless it stands between quotes.
        start = 0 if quoted else max(current.rfind(":"), current.rfind("=")) + 1
        return [word[start:] if quoted else word[start:].translate(_SPECIAL) for word, _ in found]
    return [f"{word}\t{text}" if text else word for word, text in found]


def split(line: str) -> tuple[list[str], str, bool]:
    """(words before the one at the end, that one, whether a quote is open in it), as `shlex` has them."""
    words: list[str] = []
    word, quote, escapes, begun = "", "", False, False
    for letter in line:
        if escapes:
            word += letter if letter in (quote or letter, "\\") else f"\\{letter}"
            escapes = False
        elif letter == "\\" and quote != "'":
            escapes = begun = True
        elif quote:
            word, quote = (word, "") if letter == quote else (word + letter, quote)
        elif letter in ("'", '"'):
            quote, begun = letter, True
        elif letter not in " \t\r\n":
            word, begun = word + letter, True
        elif begun:
            words.append(word)
            word, begun = "", False
    return words, word, bool(quote)


def candidates(words: list[str], current: str) -> "Iterator[Candidate]":
    """Everything that may stand after `words`; `current` says what kind is wanted, not yet which."""
    verb = next((word for word in words[1:] if not word.startswith("-")), "")
    if not verb:
        yield from VERBS.items()
    elif verb not in VERBS:
        return
    elif words[-1] in _VALUES:
        yield from ((value, "") for value in _VALUES[words[-1]])
    elif current.startswith("-"):
        yield from _flags(verb)
    else:
        given = [word for word in words[words.index(verb) + 1 :] if not word.startswith("-")]
        yield from _positional(verb, given, current)


def _flags(verb: str) -> "Iterator[Candidate]":
    import argparse

    from dextera_build.cli.grammar import alone

    for action in alone(verb)._actions:
        for name in action.option_strings:
            if action.help != argparse.SUPPRESS:
                yield name, (action.help or "") % {"default": action.default}


def _positional(verb: str, given: list[str], current: str) -> "Iterator[Candidate]":
    if verb in _WORDS and not given:
        yield from ((word, "") for word in _WORDS[verb])
        return
    place = _Place()
    if verb in _TARGETS or (verb == "ls" and ":" in current):
        recipe, colon, _ = current.partition(":")
        yield from ((f"{recipe}:{node}", "") for node in place.nodes(recipe)) if colon else place.recipes()
    elif verb == "ls":
        yield from ((word, "") for word in ("recipes", "rules", "backends", "runs"))
        yield from place.recipes()
    elif verb in _PAST and not given:
        yield from ((run, recipe) for run, recipe in place.runs())
        yield from place.recipes()
    elif verb == "log" and len(given) == 1:
        run = [given[0]] if given[0].isdigit() else [run for run, recipe in place.runs() if recipe == given[0]][:1]
        yield from ((node, "") for node in place.in_runs(run))


class _Place:
    """The project that the shell stands in."""

    def __init__(self) -> None:
        note = quick.read(quick.PLACE)
        noted = note["answers"][0] if note is not None and quick.holds(note) else _look()
        self._project, self._store, *self._folders = noted

    def recipes(self) -> "Iterator[Candidate]":
        return ((address, "") for address, _ in addresses(self._folders))

    def runs(self) -> "Iterator[tuple[str, str]]":
        """(id, recipe), the newest first."""
        import json

        folder = f"{self._store}/runs"
        found = sorted((n for n in os.listdir(folder) if n.isdecimal()), key=int) if os.path.isdir(folder) else []
        for name in found[: -_LOOK - 1 : -1]:
            try:
                with open(f"{folder}/{name}/events.jsonl", "rb") as lines:
                    yield name, json.loads(lines.readline())["recipe"]
            except (OSError, ValueError, KeyError, TypeError, RecursionError):
                continue

    def nodes(self, recipe: str) -> list[str]:
        noted = names.read(self._store, self._project, recipe)
        return self.in_runs([run for run, of in self.runs() if of == recipe][:_RUNS]) if noted is None else noted

    def in_runs(self, runs: "Iterable[str]") -> list[str]:
        """Nodes of several runs; the copies of a call are those of the newest that has it."""
        import json
        import re

        found: dict[str, None] = {}
        calls: set[str] = set()
        for run in runs:
            with open(f"{self._store}/runs/{run}/events.jsonl", "rb") as file:
                said = re.findall(_FINISHED, file.read(), re.MULTILINE)
            fresh = {name for name in map(str, map(json.loads, said)) if names.plain(name) not in calls}
            found |= dict.fromkeys(sorted(fresh))
            calls |= {names.plain(name) for name in fresh}
        return list(found)


def _look() -> list[str]:
    """What the note of a place says, found out and noted."""
    from dextera_build.cli.notes import Notes
    from dextera_build.project import find

    return Notes(quick.PLACE).write_place(find())
