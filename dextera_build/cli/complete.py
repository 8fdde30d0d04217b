"""What may stand at the end of a command line: from the grammar, the project's files and the logs of past runs.

No rule is imported and no recipe is read, so that an answer is there before a person notices.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shlex
from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path

from dextera_build.cli.grammar import VERBS, parser

Candidate = tuple[str, str]
"""A word and what it is."""

_FINISHED = re.compile(rb'^\{.*?"event": "node_finished".*?"node": ("(?:[^"\\]|\\.)*")', re.MULTILINE)
_LABEL = re.compile(r"\[[^\]]*\]")
_LOOK = 200
"""How many runs are looked at."""
_RUNS = 3
"""How many of a recipe are read."""
_SPECIAL = re.compile(r"([\[\]*?()&;|<>$`\\\"'! ])")

_TARGETS = {"build", "plan", "get", "why", "show", "view", "check", "graph", "watch", "push", "pull"}
_PAST = {"log", "report", "trace"}
_WORDS = {"new": ("recipe", "rule", "backend"), "completion": ("bash", "zsh", "fish"), "cache": ("size", "sweep")}
_VALUES = {"--profile": ("stub", "cpu", "gpu", "cloud"), "--console": ("live", "plain", "jsonl", "none")}


def answer(shell: str, line: str) -> list[str]:
    """Lines for a shell's script: words that end `line`, in bash without what stands before the last colon."""
    words, current, quoted = split(line)
    found = [(word, text) for word, text in candidates(words, current) if word.startswith(current)]
    if shell == "bash":
        # Readline takes a colon and `=` for the end of a word, unless it stands between quotes.
        start = 0 if quoted else max(current.rfind(":"), current.rfind("=")) + 1
        return [word[start:] if quoted else _SPECIAL.sub(r"\\\1", word[start:]) for word, _ in found]
    return [f"{word}\t{text}" if text else word for word, text in found]


def split(line: str) -> tuple[list[str], str, bool]:
    """(words before the one at the end, that one, whether it began with a quote)."""
    lexer = shlex.shlex(line, posix=True, punctuation_chars=False)
    lexer.whitespace_split, lexer.commenters = True, ""
    words: list[str] = []
    try:
        words += lexer
    except ValueError:  # an open quote
        quote = max(line.rfind(" '"), line.rfind(' "'))
        return shlex.split(line[:quote]), line[quote + 2 :], True
    if not line or line[-1].isspace():
        return words, "", False
    return words[:-1], words[-1], False


def candidates(words: list[str], current: str) -> Iterator[Candidate]:
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


def _flags(verb: str) -> Iterator[Candidate]:
    (verbs,) = (action for action in parser(verb)._actions if isinstance(action, argparse._SubParsersAction))
    for action in verbs.choices[verb]._actions:
        for name in action.option_strings:
            if action.help != argparse.SUPPRESS:
                yield name, (action.help or "") % {"default": action.default}


def _positional(verb: str, given: list[str], current: str) -> Iterator[Candidate]:
    place = _Place()
    if verb in _WORDS and not given:
        yield from ((word, "") for word in _WORDS[verb])
    elif verb in _TARGETS or (verb == "ls" and ":" in current):
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
        from dextera_build.project import find

        self.project = find()

    def recipes(self) -> Iterator[Candidate]:
        for address, _ in self.project.recipes():
            yield address, ""

    def runs(self) -> Iterator[tuple[str, str]]:
        """(id, recipe), the newest first."""
        folder = self._folder
        names = sorted((n for n in os.listdir(folder) if n.isdecimal()), key=int) if folder.is_dir() else []
        for name in names[: -_LOOK - 1 : -1]:
            try:
                with (folder / name / "events.jsonl").open("rb") as lines:
                    yield name, json.loads(lines.readline())["recipe"]
            except (OSError, ValueError, KeyError, TypeError, RecursionError):
                continue

    def nodes(self, recipe: str) -> list[str]:
        return self.in_runs([run for run, of in self.runs() if of == recipe][:_RUNS])

    def in_runs(self, runs: Iterable[str]) -> list[str]:
        """Nodes of several runs; the copies of a call are those of the newest that has it."""
        found: dict[str, None] = {}
        calls: set[str] = set()
        for run in runs:
            data = (self._folder / run / "events.jsonl").read_bytes()
            names = {str(json.loads(name)) for name in _FINISHED.findall(data)}
            fresh = {name for name in names if _LABEL.sub("", name) not in calls}
            found |= dict.fromkeys(sorted(fresh))
            calls |= {_LABEL.sub("", name) for name in fresh}
        return list(found)

    @cached_property
    def _folder(self) -> Path:
        return self.project.cache / "runs"
