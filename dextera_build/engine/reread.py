"""Which nodes of the last build read which files by themselves: the next one looks again where these changed."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from dextera_build.engine.units import Node
from dextera_build.store.traces.look import Look
from dextera_build.store.traces.steps import Steps


class Reread:
    """Questions to the project's folder, what they were answered, and the numbers of the nodes that asked them."""

    def __init__(self) -> None:
        self._answers: dict[tuple[str, str], str] = {}
        self._asked: dict[int, list[tuple[str, str]]] = {}

    @classmethod
    def of(cls, nodes: Iterable[Node]) -> Reread:
        """What nodes read in this build, by their place in it."""
        found = cls()
        for number, node in enumerate(nodes):
            found.learn(number, node.reads)
        return found

    def learn(self, number: int, steps: Steps) -> None:
        """Take over what a node read."""
        self._asked.pop(number, None)
        if steps:
            self._answers |= {(kind, name): answer for kind, name, answer in steps}
            self._asked[number] = [(kind, name) for kind, name, _ in steps]

    def changed(self, paths: Iterable[str], look: Look) -> tuple[set[int], set[str]]:
        """Nodes that would be told other things now that `paths` changed; and paths that nobody asked for."""
        asked = {question for questions in self._asked.values() for question in questions}
        at: dict[str, list[tuple[str, str]]] = {}
        for question in asked:
            at.setdefault(look.place(*question), []).append(question)
        wanted: set[tuple[str, str]] = set()
        others: set[str] = set()
        for path in paths:
            met = [
                question
                for place in _above(path)
                for question in at.get(place, ())
                if place == path or question[0] == "names"
            ]
            wanted.update(met)
            if not met:
                others.add(path)
        other = {question for question in wanted if look.answer_or_unknown(*question) != self._answers[question]}
        return {number for number, questions in self._asked.items() if not other.isdisjoint(questions)}, others

    def plain(self) -> list[Any]:
        """As JSON data."""
        numbers = {question: number for number, question in enumerate(self._answers)}
        asked = {str(node): [numbers[question] for question in questions] for node, questions in self._asked.items()}
        return [[[*question, answer] for question, answer in self._answers.items()], asked]

    @classmethod
    def of_plain(cls, plain: Any) -> Reread:
        """What `plain` wrote down."""
        found, (rows, asked) = cls(), plain
        questions = [(kind, name) for kind, name, _ in rows]
        found._answers = dict(zip(questions, (answer for _, _, answer in rows), strict=True))
        found._asked = {int(node): [questions[number] for number in numbers] for node, numbers in asked.items()}
        return found


def _above(path: str) -> Iterable[str]:
    """A path and every folder that it lies in."""
    yield path
    while (folder := path.rpartition("/")[0]) not in ("", path):
        yield folder
        path = folder
