"""Nodes that exist only with an input, and backends that are for one."""

from __future__ import annotations

import pytest

from dextera_build.engine.graph import Graph
from dextera_build.errors import RecipeError
from dextera_build.recipe.plan import Request, plan
from dextera_build.recipe.profiles import Profile
from tests.recipe.conftest import Space

ECHO = '''
"""toy.echo: says a text, as a recording does if there is one."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def echo(ctx: Context, text: File, recording: File | None = None) -> File:
    """Return what was said."""
    return ctx.backend.speak(ctx, text, recording)
'''
BACKEND = '''
"""Speaks."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="speaks", {facts})
def speak(ctx, text, recording):
    return recording or text
'''
RECIPE = """inputs: {{voice: {{help: a recording, optional: true}}}}
nodes:
  start: {{rule: toy.start}}
  cleaned: {{rule: toy.shout, text: $voice, given: $voice}}
  again: {{rule: toy.shout, text: $cleaned, given: $cleaned}}
  said: {{rule: toy.echo, text: $start, recording: $again{more}}}
targets: {{default: [said]}}
"""


def planned(space: Space, **inputs: str) -> Graph:
    project = space.project()
    given = {name: str(space.root / path) for name, path in inputs.items()}
    return plan("say/it", project.recipe, project.library, project.root, Request(inputs=given)).graph


@pytest.fixture
def echoing(space: Space) -> Space:
    space.write("rules/toy/echo.py", ECHO.lstrip())
    space.write("rules/toy/echo_voice.py", BACKEND.lstrip().format(facts='profiles=("cpu",)'))
    space.write("rules/toy/echo_tape.py", BACKEND.lstrip().format(facts='takes=("recording",)'))
    space.write("recipes/say/it.yaml", RECIPE.format(more=""))
    space.write("voice.txt", "hello")
    return space


def test_a_node_without_its_input_does_not_exist(echoing: Space) -> None:
    graph = planned(echoing)
    assert set(graph.members) == {"start", "said"}
    said = graph.members["said"]
    assert (set(said.inputs), said.rule.backend) == ({"text"}, "voice")


def test_with_the_input_it_does_and_its_reader_has_the_backend_for_it(echoing: Space) -> None:
    graph = planned(echoing, voice="voice.txt")
    said = graph.members["said"]
    assert set(graph.members) == {"start", "cleaned", "again", "said"}
    assert (said.rule.backend, said.rule.chosen) == ("tape", "given `recording`")


def test_a_profile_of_stand_ins_keeps_its_own(echoing: Space) -> None:
    echoing.write("rules/toy/echo_stub.py", BACKEND.lstrip().format(facts='profiles=("stub",)'))
    project = echoing.project()
    request = Request(profile=Profile("stub"), inputs={"voice": str(echoing.root / "voice.txt")})
    graph = plan("say/it", project.recipe, project.library, project.root, request).graph
    assert graph.members["said"].rule.backend == "stub"


def test_a_backend_that_is_named_counts_more(echoing: Space) -> None:
    echoing.write("recipes/say/it.yaml", RECIPE.format(more=", backend: voice"))
    assert planned(echoing, voice="voice.txt").members["said"].rule.backend == "voice"


def test_a_reader_that_needs_the_node_tells_what_is_not_given(echoing: Space) -> None:
    echoing.edit("recipes/say/it.yaml", "text: $start, recording", "text: $again, recording")
    with pytest.raises(RecipeError, match=r"needs the input `text`, but `\$again` is not given"):
        planned(echoing)
