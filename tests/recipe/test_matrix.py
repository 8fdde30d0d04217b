"""Parameter sweeps in recipes: labels, values, and what is refused where."""

from __future__ import annotations

import json
import math

import hypothesis
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from dextera_build.engine.graph import Gather, Group, parse_address
from dextera_build.errors import DxbError, Place, RecipeError, UsageError
from dextera_build.recipe import matrix, settings
from dextera_build.recipe.plan import Request, plan
from dextera_build.recipe.strict_yaml import Node

SWEEP = """nodes:
  start: {rule: toy.start, text: a}
  sweep:
    matrix: {times: [1, 2], text: [x, y]}
    nodes:
      begin: {rule: toy.start, text: $matrix.text, sizes_m: [1.5, 2.5]}
      loud: {rule: toy.shout, text: $begin, times: $matrix.times}
      same: {rule: toy.shout, text: $start, times: 7}
  all: {rule: toy.join, texts: $sweep.loud}
targets: {default: [all]}
"""


@pytest.fixture
def planned(space):
    def make(text, **request):
        space.write("recipes/say/sweep.yaml", text)
        project = space.project()
        return plan("say/sweep", project.recipe, project.library, project.root, Request(**request)).graph

    return make


def test_there_is_a_copy_for_every_combination_with_its_values(planned):
    graph = planned(SWEEP)
    group = graph.members["sweep"]
    assert isinstance(group, Group)
    assert group.over.labels == ("times=1,text=x", "times=1,text=y", "times=2,text=x", "times=2,text=y")
    copy = group.overrides["times=2,text=y"]
    assert copy["begin"].options["text"] == "y"
    assert copy["loud"].options["times"] == 2
    assert "same" not in copy
    assert graph.members["all"].inputs["texts"] == Gather(("sweep", "loud"))


def test_an_option_points_at_its_value_in_the_list(planned):
    copy = planned(SWEEP).members["sweep"].overrides["times=2,text=y"]
    assert str(copy["loud"].option_places["times"]).endswith("recipes/say/sweep.yaml:4:25")


def test_a_backend_can_be_swept(planned):
    text = """nodes:
  start: {rule: toy.start}
  sweep:
    matrix: {backend: [quiet]}
    nodes: {spoken: {rule: toy.spoken, text: $start, backend: $matrix.backend}}
"""
    assert planned(text).members["sweep"].overrides["backend=quiet"]["spoken"].rule.backend == "quiet"
    with pytest.raises(RecipeError, match="has no backend `loud`"):
        planned(text.replace("quiet", "loud"))


def test_a_matrix_can_stand_in_a_group_and_a_group_in_a_matrix(planned):
    text = """nodes:
  start: {rule: toy.start, text: a b}
  words: {rule: toy.split, text: $start}
  word:
    each: $words
    as: word
    nodes:
      sweep:
        matrix: {times: [1, 2]}
        nodes: {loud: {rule: toy.shout, text: $word, times: $matrix.times}}
  other:
    matrix: {text: [p q, r]}
    nodes:
      begin: {rule: toy.start, text: $matrix.text}
      words: {rule: toy.split, text: $begin}
      word:
        each: $words
        as: word
        nodes: {loud: {rule: toy.shout, text: $word}}
"""
    graph = planned(text.replace("p q", "p"))
    assert graph.members["word"].members["sweep"].over.labels == ("times=1", "times=2")
    assert isinstance(graph.members["other"].members["word"], Group)
    with pytest.raises(RecipeError, match="this node is not directly inside a matrix") as caught:
        planned(
            text.replace("p q", "p").replace(
                "{loud: {rule: toy.shout, text: $word}}", "{loud: {rule: toy.shout, text: $word, times: $matrix.text}}"
            )
        )
    assert caught.value.where.line == 19


def test_settings_reach_all_copies_or_one(planned):
    def loud(*texts):
        graph = planned(SWEEP, settings=tuple(settings.parse(text) for text in texts))
        return {label: copy["loud"].options["times"] for label, copy in graph.members["sweep"].overrides.items()}

    assert set(loud("sweep.loud.times=9").values()) == {9}
    assert loud("sweep[times=1,text=x].loud.times=9") == {
        "times=1,text=x": 9,
        "times=1,text=y": 1,
        "times=2,text=x": 2,
        "times=2,text=y": 2,
    }
    with pytest.raises(UsageError, match="`sweep` has no copy `times=1,text=z`") as caught:
        loud("sweep[times=1,text=z].loud.times=9")
    assert caught.value.code == "DXB-U169"
    graph = planned(SWEEP, settings=(settings.parse("sweep[times=1,text=x].same.times=9"),))
    assert set(graph.members["sweep"].overrides["times=1,text=x"]) == {"begin", "loud", "same"}


@pytest.mark.parametrize(
    "text", ["sweep[voxel_m=0.001,seed=1].mesh.wall_m=0.5", " sweep[voxel_m=0.001,seed=1].mesh.wall_m =0.5"]
)
def test_a_setting_takes_labels_with_dots_and_equals_signs(text):
    found = settings.parse(text)
    assert (found.call, found.labels, found.option) == (("sweep", "mesh"), ("voxel_m=0.001,seed=1",), ("wall_m",))
    assert found.value.value == 0.5


@pytest.mark.parametrize("text", ["mesh", "mesh=1", "a.b", "a..b=1", "a[x.b=1", "a.b[=1", "", "a.b]=1"])
def test_what_is_no_setting_is_refused(text):
    with pytest.raises(UsageError, match="is not a setting"):
        settings.parse(text)


SCALARS = st.one_of(
    st.integers(),
    st.floats(allow_nan=False, allow_infinity=False),
    st.booleans(),
    st.from_regex(r"[a-z0-9_.-]+", fullmatch=True),
)


@pytest.mark.medium
@hypothesis.settings(deadline=None, suppress_health_check=[hypothesis.HealthCheck.too_slow])
@given(st.dictionaries(st.sampled_from("abc"), st.lists(SCALARS, min_size=1, max_size=3), min_size=1))
def test_labels_are_addresses_and_tell_copies_apart(lists):
    where = Place("x", 1, 1)
    nodes = {name: Node([Node(value, where) for value in values], where) for name, values in lists.items()}
    for values in lists.values():
        assume(len({value if isinstance(value, str) else json.dumps(value) for value in values}) == len(values))
    found = matrix.copies(nodes, where)
    assert len(found) == math.prod(map(len, lists.values()))
    for label, values in found.items():
        address = f"sweep[{label}].mesh"
        assert str(parse_address(address)) == address
        assert parse_address(address).labels == (label,)
        assert settings.parse(f"{address}.wall_m=1").labels == (label,)
        assert set(values) == set(lists)


@pytest.mark.parametrize(
    ("old", "new", "code", "column"),
    [
        ("{times: [1, 2], text: [x, y]}", "{}", "DXB-R505", 13),
        ("times: [1, 2]", "times: 1", "DXB-R505", 21),
        ("times: [1, 2]", "times: []", "DXB-R505", 21),
        ("[x, y]", "[x, 'a b']", "DXB-R507", 39),
        ("[x, y]", "[x, [y]]", "DXB-R507", 39),
        ("[x, y]", "[x, 'a=b']", "DXB-R507", 39),
        ("[1, 2]", "[1, 1]", "DXB-R508", 25),
        ("$matrix.times", "$matrix.tmes", "DXB-R509", 52),
        ("times: [1, 2]", f"times: {list(range(5001))}", "DXB-R506", 13),
    ],
)
def test_a_wrong_matrix_is_refused_with_its_place(planned, old, new, code, column):
    with pytest.raises(DxbError) as caught:
        planned(SWEEP.replace(old, new, 1))
    assert (caught.value.code, caught.value.where.column) == (code, column)


def test_values_are_for_the_nodes_of_the_matrix_only(planned):
    with pytest.raises(RecipeError, match=r"`\$matrix\.text` names nothing") as caught:
        planned(SWEEP.replace("start: {rule: toy.start, text: a}", "start: {rule: toy.start, text: $matrix.text}"))
    assert caught.value.code == "DXB-R510"
    assert str(caught.value.where).endswith("recipes/say/sweep.yaml:2:34")


def test_a_wrong_value_is_refused_where_it_stands(planned):
    with pytest.raises(RecipeError, match=r"`times` of `toy\.shout`") as caught:
        planned(SWEEP.replace("[1, 2]", "[1, two]"))
    assert str(caught.value.where).endswith("recipes/say/sweep.yaml:4:25")


def test_a_node_has_one_form(planned):
    with pytest.raises(RecipeError, match="exactly one of `rule`, `recipe`, `each`, `matrix`"):
        planned("nodes: {a: {rule: toy.start, matrix: {seed: [1]}}}\n")
