"""Backends: their own options, their place in the key, and backends that a project adds to rules of dxb."""

from __future__ import annotations

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe import settings
from dextera_build.recipe.plan import Request, plan

RULE = '''"""toy.tone: a rule with backends that have options."""

from __future__ import annotations

from typing import Any, Protocol

from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule


class ToneOptions(Options):
    """Options of toy.tone."""

    end: str = "."
    """What comes last."""


class ToneBackend(Protocol):
    """What a backend of toy.tone defines."""

    def say(self, ctx: Context, text: File, common: ToneOptions, options: Any) -> bytes:
        """The text in a tone."""
        ...


@rule(version=1)
def tone(ctx: Context[ToneBackend], text: File, *, options: ToneOptions) -> File:
    """Return the text in a tone."""
    return File(data=ctx.backend.say(ctx, text, options, ctx.backend_options))
'''
LOUD = '''"""Backend loud of toy.tone."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pydantic import PositiveInt

from dextera_build.artifacts.base import File
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from .tone import ToneOptions

BACKEND = Backend(summary="loudly", profiles=("cpu",))


class LoudOptions(Options):
    """Options of backend `loud`."""

    times: PositiveInt = 1
    """How many exclamation marks."""


def say(ctx: Context, text: File, common: ToneOptions, options: LoudOptions) -> bytes:
    """Upper case with exclamation marks."""
    return text.data.upper() + b"!" * options.times + common.end.encode()
'''
PLAIN = (
    LOUD.replace("loud", "plain").split("class LoudOptions")[0].replace('profiles=("cpu",)', "profiles=()")
    + '''
def say(ctx: Context, text: File, common: ToneOptions, options: Options) -> bytes:
    """The text itself."""
    return text.data + common.end.encode()
'''
)


@pytest.fixture
def toned(space):
    space.write("rules/toy/tone.py", RULE)
    space.write("rules/toy/tone_loud.py", LOUD)
    space.write("rules/toy/tone_plain.py", PLAIN)
    return space


def call(space, node, **request):
    space.write(
        "recipes/say/tone.yaml", f"nodes: {{s: {{rule: toy.start, text: a}}, t: {{rule: toy.tone, text: $s{node}}}}}"
    )
    project = space.project()
    graph = plan("say/tone", project.recipe, project.library, project.root, Request(**request)).graph
    return dict(graph.calls())["t",]


@pytest.mark.medium
def test_options_of_the_chosen_backend_are_complete_and_in_the_key(toned):
    assert call(toned, "").options == {"end": ".", "loud": {"times": 1}}
    assert call(toned, ", loud: {times: 3}").options == {"end": ".", "loud": {"times": 3}}
    assert toned.build("say/tone").code == 0
    assert toned.dxb("get", "say/tone:t", "--out", "made").code == 0
    assert b"A!!!." in b"".join(file.read_bytes() for file in (toned.root / "made").rglob("*") if file.is_file())
    call(toned, ", loud: {times: 4}")
    why = toned.dxb("why", "say/tone:t")
    assert "loud.times" in why.out + why.err


def test_options_of_other_backends_are_in_no_key_but_its_own(toned):
    one = call(toned, ", backend: plain, loud: {times: 3}")
    assert one.options == {"end": "."} == call(toned, ", backend: plain, loud: {times: 4}").options


def test_a_setting_reaches_into_the_group(toned):
    given = (settings.parse("t.loud.times=5"), settings.parse('t.end="?"'))
    assert call(toned, ", loud: {times: 3}", settings=given).options == {"end": "?", "loud": {"times": 5}}


@pytest.mark.parametrize(
    ("node", "message", "hint"),
    [
        (", loud: {times: 0}", "`loud.times` of `toy.tone` must be greater than 0", None),
        (", loud: {tmes: 1}", "`loud` of `toy.tone` has no option `tmes`", "did you mean `times`?"),
        (", loud: 3", "`loud` of `toy.tone` is a mapping of options, this is number", None),
        (", backend: plain, plain: {x: 1}", "backend `plain` of `toy.tone` has no options", None),
        (
            ", times: 3",
            "`toy.tone` has no input or option `times`",
            "it is an option of a backend: `loud: {times: ...}`",
        ),
        (", backend: []", "`backend` is empty", "name one, or leave it out"),
        (", backend: lowd", "`toy.tone` has no backend `lowd`", "did you mean `loud`?"),
    ],
)
def test_wrong_options_are_refused(toned, node, message, hint):
    with pytest.raises(RecipeError) as caught:
        call(toned, node)
    assert caught.value.message == message
    if hint:
        assert caught.value.hint == hint


def test_two_classes_of_options_in_one_backend_are_refused(toned):
    other = '\n\nclass Other(Options):\n    """More."""\n'
    more = other + '\n\ndef shout(ctx: Context, options: Other) -> None:\n    """Nothing."""\n'
    toned.write("rules/toy/tone_loud.py", LOUD + more)
    with pytest.raises(RecipeError, match="take no one class of options") as caught:
        call(toned, "")
    assert caught.value.code == "DXB-R212"


def test_a_project_adds_a_backend_to_a_rule_of_dxb(space):
    space.write(
        "rules/simulate/settle_hopeful.py",
        '"""Backend hopeful of simulate.settle."""\n\nfrom dextera_build.rule import Backend\n\n'
        'BACKEND = Backend(summary="hopes")\n',
    )
    assert "simulate.settle\thopeful\t" in space.dxb("ls", "backends").out
    found = space.project().library.find("simulate.settle")
    assert list(found.backends) == ["hopeful", "mujoco", "stub"]
    assert found.backends["hopeful"].module.BACKEND.summary == "hopes"
