"""Options that contradict one another: the error names the option that is given, at its place."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe.plan import Request, plan

SPAN = '''"""toy.span: a length."""

from __future__ import annotations

from pydantic import model_validator

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule


class SpanOptions(Options):
    """Options of toy.span."""

    low_m: float = 0.0
    """Lower end [m]."""
    high_m: float = 1.0
    """Upper end [m]."""

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
