"""`ctx.backend` tells a backend that does not do what the `Protocol` of its rule says."""

from __future__ import annotations

from types import ModuleType
from typing import Any, Protocol

import pytest

from dextera_build.artifacts.base import File
from dextera_build.errors import RuleError
from dextera_build.rule.chosen import Chosen


class SayBackend(Protocol):
    """A voice."""

    def say(self, ctx: Any, word: File, options: Any) -> File:
        """The word as said."""
        ...

    def loudness(self, ctx: Any, options: Any) -> dict[str, float]:
        """Of each word."""
        ...


class Louder(File):
    """A file of a kind of its own."""


def backend(**functions: Any) -> Any:
    module = ModuleType("say_mine")
    module.__file__ = "rules/toy/say_mine.py"
    vars(module).update(functions)
    return Chosen(module, SayBackend, "backend `mine` of toy.say")


def say(ctx: Any, word: File, options: Any) -> File:
    """The word."""
    return word


@pytest.mark.parametrize("word", [File(data=b"a"), Louder(data=b"a")])
def test_what_the_protocol_says_passes(word):
    assert backend(say=say).say(None, word, None) is word


def test_what_the_protocol_does_not_name_or_no_artifact_is_the_modules_own():
    made = backend(PITCH=3, helper=say, loudness=lambda ctx, options: 5)
    assert (made.PITCH, made.helper, made.loudness(None, None)) == (3, say, 5)
    with pytest.raises(AttributeError):
        made.pitch()


@pytest.mark.parametrize(
    ("functions", "hint"), [({"sya": say}, "did you mean `sya`"), ({}, "`def say(ctx, word, options)`")]
)
def test_a_missing_function_is_told(functions, hint):
    with pytest.raises(RuleError, match=r"backend `mine` of toy.say has no function `say`") as caught:
        backend(**functions).say(None, File(data=b""), None)
    assert caught.value.code == "DXB-B308"
    assert caught.value.facts["file"] == "rules/toy/say_mine.py"
    assert hint in str(caught.value.hint)


@pytest.mark.parametrize(("answer", "shown"), [(None, "nothing"), (b"a", "`bytes`"), ([File(data=b"")], "`list`")])
def test_another_type_is_told(answer, shown):
    with pytest.raises(
        RuleError, match=f"`<lambda>` of backend `mine` of toy.say returned {shown}.*, not File"
    ) as caught:
        backend(say=lambda *words: answer).say(None, File(data=b""), None)
    assert caught.value.code == "DXB-B309"
    assert "-> File" in str(caught.value.hint)
