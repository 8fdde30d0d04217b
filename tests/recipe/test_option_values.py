"""Options that contradict one another: the error names the option that is given, at its place."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe.plan import Request, plan

SPAN = '''"""toy.span: a length."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule


class Mark(Options):
    """A mark."""

    kind: Literal["mark"] = "mark"
    """What it is."""
    place_m: float = 0.0
    """Where it is [m]."""


class SpanOptions(Options):
    """Options of toy.span."""

    low_m: float = 0.0
    """Lower end [m]."""
    high_m: float = 1.0
    """Upper end [m]."""
    marks: dict[str, Mark] = {}
    """Marks by name."""

    @model_validator(mode="after")
    def _ordered(self) -> SpanOptions:
        if self.low_m == self.high_m:
            raise ValueError("both ends are alike")
        if self.low_m > self.high_m:
            raise ValueError("`high_m` lies below `low_m`; exchange them")
        return self


@rule(version=1)
def span(ctx: Context, *, options: SpanOptions) -> File:
    """Return it."""
    return File(data=b"")
'''


def refused(space, options: str) -> RecipeError:
    space.write("rules/toy/span.py", SPAN)
    space.write("recipes/say/span.yaml", f"nodes:\n  s:\n    rule: toy.span\n{options}")
    project = space.project()
    with pytest.raises(RecipeError) as caught:
        plan("say/span", project.recipe, project.library, project.root, Request())
    return caught.value


@pytest.mark.parametrize(
    ("options", "name", "line", "given"),
    [
        ("    low_m: 3\n", "low_m", 4, "3"),
        ("    low_m: 3\n    high_m: 2\n", "high_m", 5, "2"),
    ],
)
def test_a_contradiction_is_shown_at_the_first_given_option_that_it_names(space, options, name, line, given):
    error = refused(space, options)
    assert error.message == f"`{name}` of `toy.span` is refused: `high_m` lies below `low_m`; exchange them"
    assert error.code == "DXB-R109"
    assert error.where is not None
    assert error.where.line == line
    assert error.facts == {"given": given}


def test_one_that_names_no_option_is_shown_at_the_rule(space):
    error = refused(space, "    low_m: 1\n")
    assert error.message == "`toy.span` is refused: both ends are alike"
    assert error.where is not None
    assert error.where.line == 3


@pytest.mark.parametrize(
    ("options", "message", "column", "hint"),
    [
        ("    low: 3\n", "`toy.span` has no input or option `low`", 5, "did you mean `low_m`?"),
        (
            "    marks: {a: {place: 1}}\n",
            "`marks.a` of `toy.span` has no option `place`",
            17,
            "did you mean `place_m`?",
        ),
    ],
)
def test_a_name_within_an_option_is_refused_with_the_near_one(space, options, message, column, hint):
    error = refused(space, options)
    assert (error.code, error.message, error.hint) == ("DXB-R105", message, hint)
    assert error.where is not None
    assert (error.where.line, error.where.column) == (4, column)


QUIET = (
    '"""Quiet."""\nfrom dextera_build.rule import Backend, Options\n\nclass QuietOptions(Options):\n'
    '    """Options."""\n    volume: float = 0.5\n    """How loud."""\n\n'
    'BACKEND = Backend(summary="quietly", profiles=("cpu",))\n'
    "def speak(ctx, text, options: QuietOptions):\n    return text\n"
)
Q = "nodes:\n  s: {rule: toy.start}\n  t:\n    rule: toy.spoken\n    text: $s\n"


def test_an_option_of_a_backend_is_refused_with_the_near_one(space):
    space.write("rules/toy/spoken_quiet.py", QUIET)
    space.write("recipes/say/q.yaml", Q + "    quiet: {volum: 1}\n")
    project = space.project()
    with pytest.raises(RecipeError) as caught:
        plan("say/q", project.recipe, project.library, project.root, Request())
    error = caught.value
    assert error.message == "`quiet` of `toy.spoken` has no option `volum`"
    assert (error.hint, error.facts) == ("did you mean `volume`?", {"options": "volume"})
    assert error.where is not None
    assert (error.where.line, error.where.column) == (6, 13)


def test_an_option_of_a_backend_that_is_not_chosen_is_checked_too(space):
    space.write("rules/toy/spoken_quiet.py", QUIET)
    space.write("rules/toy/spoken_calm.py", QUIET.replace('("cpu",)', "()"))
    for group, message in (
        ("{volum: 1}", "`calm` of `toy.spoken` has no option `volum`"),
        ("{volume: x}", "`calm.volume` of `toy.spoken` must be a valid number"),
    ):
        space.write("recipes/say/q.yaml", f"{Q}    calm: {group}\n    cloud: {{anything: 1}}\n")  # cannot be imported
        project = space.project()
        with pytest.raises(RecipeError) as caught:
            plan("say/q", project.recipe, project.library, project.root, Request())
        assert caught.value.message == message


def test_a_setting_of_a_backend_that_no_call_runs_is_told(space):
    space.write("rules/toy/spoken_quiet.py", QUIET)
    space.write("rules/toy/spoken_calm.py", QUIET.replace('("cpu",)', "()"))
    space.write("recipes/say/q.yaml", Q)
    told = "warning: nothing reads `--set t.calm.volume=1`: toy.spoken runs `quiet`\n"
    for _ in range(2):  # the second time, the plan is that of the first
        assert told in space.dxb("plan", "say/q", "--set", "t.calm.volume=1").err
    assert "nothing reads" not in space.dxb("plan", "say/q", "--set", "t.quiet.volume=1").err
    assert (
        "nothing reads"
        not in space.dxb("plan", "say/q", "--set", "t.calm.volume=1", "--backend", "toy.spoken=calm").err
    )


def test_an_option_of_a_backend_on_the_command_line_is_spelled_for_it(space):
    space.write("rules/toy/spoken_quiet.py", QUIET)
    space.write("recipes/say/q.yaml", Q)
    for text, hint in (
        ("t.volume=1", "it is an option of a backend: `--set 't.quiet.volume=VALUE'`"),
        ("t.quite.volume=1", "did you mean `quiet`?"),
    ):
        assert f"hint: {hint}\n" in space.dxb("plan", "say/q", "--set", text).err
