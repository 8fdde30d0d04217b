"""Plans: what a recipe turns into, and every way to get one wrong."""

from __future__ import annotations

import pytest

from dextera_build.engine.graph import Gather, Group, Item, Leaf, Output
from dextera_build.errors import DxbError, RecipeError, UsageError
from dextera_build.recipe import settings
from dextera_build.recipe.plan import Request, plan

PAIR = '''
"""toy.pair: two files, one of them optional."""
from dextera_build.artifacts.base import Artifact, File
from dextera_build.rule import Context, rule

class Pair(Artifact):
    """Two files."""
    first: File
    """Always there."""
    second: File | None = None
    """Perhaps."""

@rule(version=1)
def pair(ctx: Context) -> Pair:
    """Return the first alone."""
    return Pair(first=File(data=b"one"))
'''


def planned(space, address="say/words", **request):
    project = space.project()
    return plan(address, project.recipe, project.library, project.root, Request(**request)).graph


def refused(space, text, kind=RecipeError, **request) -> DxbError:
    space.write("recipes/say/wrong.yaml", text)
    with pytest.raises(kind) as caught:
        planned(space, "say/wrong", **request)
    return caught.value


def test_references_become_inputs(space):
    calls = dict(planned(space).calls())
    assert calls["words",].inputs == {"text": Output(("start",))}
    assert calls["word", "loud"].inputs == {"text": Item(("word",))}
    assert calls["word", "louder"].inputs == {"text": Output(("word", "loud"))}
    assert calls["all",].inputs == {"texts": Gather(("word", "louder"))}


def test_an_optional_input_may_be_a_field_that_is_not_set(space):
    space.write("rules/toy/pair.py", PAIR)
    nodes = "{p: {rule: toy.pair}, s: {rule: toy.shout, text: $p.first, more: $p.second}}"
    space.write("recipes/say/a.yaml", f"summary: A pair.\nnodes: {nodes}\ntargets: {{default: [s]}}\n")
    calls = dict(planned(space, "say/a").calls())
    assert calls["s",].inputs["text"] == Output(("p",), ("first",))
    assert calls["s",].inputs["more"] == Output(("p",), ("second",), optional=True)
    assert space.dxb("build", "say/a").code == 0


def test_options_are_complete_and_typed(space):
    calls = dict(planned(space).calls())
    assert calls["start",].options == {"text": "one two", "sizes_m": [1.0]}
    assert calls["word", "louder"].options == {"times": 2}
    assert str(calls["word", "louder"].option_places["times"]).endswith("words.yaml:10:53")


def test_an_integer_for_a_float_is_that_float(space):
    space.write("recipes/say/a.yaml", "nodes: {s: {rule: toy.start, sizes_m: [1, 2]}}")
    assert dict(planned(space, "say/a").calls())["s",].options["sizes_m"] == [1.0, 2.0]
    assert isinstance(dict(planned(space, "say/a").calls())["s",].options["sizes_m"][0], float)


def test_an_override_changes_one_copy(space):
    text = (space.root / "recipes/say/words.yaml").read_text()
    space.write(
        "recipes/say/words.yaml",
        text.replace("    as: word\n", "    as: word\n    overrides: {one: {loud: {times: 5}}}\n"),
    )
    group = planned(space).members["word"]
    assert isinstance(group, Group)
    assert group.overrides["one"]["loud"].options == {"times": 5}
    assert set(group.overrides) == {"one"}
    assert group.members["loud"].options == {"times": 1}


def test_a_setting_reaches_one_copy_or_all(space):
    one = planned(space, settings=(settings.parse("word[two].loud.times=7"),)).members["word"]
    assert one.overrides["two"]["loud"].options == {"times": 7}
    assert one.members["loud"].options == {"times": 1}
    every = planned(space, settings=(settings.parse("word.loud.times=7"),)).members["word"]
    assert every.members["loud"].options == {"times": 7}


def test_a_setting_takes_a_list(space):
    space.write("recipes/say/a.yaml", "nodes: {s: {rule: toy.start}}")
    changed = planned(space, "say/a", settings=(settings.parse("s.sizes_m=[1, 2.5]"),))
    assert dict(changed.calls())["s",].options["sizes_m"] == [1.0, 2.5]
    with pytest.raises(RecipeError, match=r"sizes_m\.1"):
        planned(space, "say/a", settings=(settings.parse("s.sizes_m=[1, {a: 2}]"),))


BOUNDED = "nodes:\n  photo: {rule: capture.imgviz, farthest_m: %s}"


@pytest.mark.parametrize("given", ["-3", "0"])
def test_a_value_out_of_bounds_is_refused_where_it_is_written_with_the_bound_and_its_unit(space, given):
    error = refused(space, BOUNDED % given)
    assert error.message == "`farthest_m` of `capture.imgviz` must be greater than 0 m"
    assert error.facts == {"given": given}
    assert str(error.where).endswith("recipes/say/wrong.yaml:2:45")
    assert error.hint
    assert error.hint.startswith("`farthest_m`: Greater depths are sensor noise")


def test_a_setting_out_of_bounds_is_refused_with_its_flag(space):
    space.write("recipes/say/a.yaml", BOUNDED % 2)
    with pytest.raises(RecipeError, match="must be greater than 0 m") as caught:
        planned(space, "say/a", settings=(settings.parse("photo.farthest_m=-3"),))
    assert str(caught.value.where) == "the command line: --set photo.farthest_m=-3"


def test_bounds_are_in_no_key(space):
    space.write("recipes/say/a.yaml", BOUNDED % 2)
    assert dict(planned(space, "say/a").calls())["photo",].options == {"farthest_m": 2.0}


def test_inputs_name_files_or_targets_of_recipes(space):
    space.write("notes.txt", "x")
    space.write(
        "recipes/say/two.yaml",
        "inputs: {note: notes.txt, words: 'say/words:words', all: say/words}\n"
        "nodes:\n  a: {rule: toy.split, text: $note}\n  b: {rule: toy.join, texts: $words}\n"
        "  c: {rule: toy.shout, text: $all}\n",
    )
    calls = dict(planned(space, "say/two").calls())
    assert isinstance(calls["a",].inputs["text"], Leaf)
    assert calls["b",].inputs["texts"] == Output(("say/words:words",))
    assert calls["c",].inputs["text"] == Output(("say/words:all",))
    assert ("say/words:word", "loud") in calls


def test_a_used_recipe_keeps_its_names_apart(space):
    space.write(
        "recipes/say/each.yaml",
        "inputs: {text: {help: what to say}}\nnodes:\n  words: {rule: toy.split, text: $text}\n",
    )
    space.write(
        "recipes/say/use.yaml",
        "nodes:\n  start: {rule: toy.start}\n  first: {recipe: say/each, text: $start}\n"
        "  all: {rule: toy.join, texts: $first.words}\n",
    )
    calls = dict(planned(space, "say/use").calls())
    assert calls["first/words",].inputs == {"text": Output(("start",))}
    assert calls["all",].inputs == {"texts": Output(("first/words",))}


def test_members_are_called_as_they_are_found(space):
    space.write(
        "recipes/say/each.yaml",
        "inputs: {text: {help: what to say}}\nnodes:\n  words: {rule: toy.split, text: $text}\n"
        "  word: {each: $words, as: word, nodes: {loud: {rule: toy.shout, text: $word}}}\n",
    )
    space.write(
        "recipes/say/use.yaml",
        "nodes:\n  start: {rule: toy.start}\n  first: {recipe: say/each, text: $start}\n"
        "  words: {rule: toy.split, text: $start}\n"
        "  own: {each: $words, as: word, nodes: {in: {recipe: say/loud, text: $word}}}\n",
    )
    space.write(
        "recipes/say/loud.yaml",
        "inputs: {text: {help: what to say}}\nnodes:\n  loud: {rule: toy.shout, text: $text}\n",
    )
    graph = planned(space, "say/use", settings=(settings.parse("own[one].in/loud.times=5"),))
    for name, member in graph.members.items():
        assert member.name == name
        assert graph.members[name] == member
    assert list(graph.members) == [name for name, _ in graph.members.items()]


def test_an_override_reaches_a_call_of_a_recipe_that_a_group_uses(space):
    space.write(
        "recipes/say/loud.yaml",
        "inputs: {text: {help: what to say}}\nnodes:\n  loud: {rule: toy.shout, text: $text}\n",
    )
    space.write(
        "recipes/say/use.yaml",
        "nodes:\n  start: {rule: toy.start}\n  words: {rule: toy.split, text: $start}\n"
        "  own: {each: $words, as: word, nodes: {in: {recipe: say/loud, text: $word}}}\n",
    )
    graph = planned(space, "say/use", settings=(settings.parse("own[one].in/loud.times=5"),))
    assert graph.copy(("own", "in/loud"), ("one",)).options["times"] == 5
    assert graph.copy(("own", "in/loud"), ("two",)).options["times"] == 1


def test_extending_takes_over_and_replaces(space):
    space.write(
        "recipes/say/more.yaml",
        "extends: say/words\nnodes:\n  start: {rule: toy.start, text: three}\ntargets: {default: [words]}",
    )
    graph = planned(space, "say/more")
    assert dict(graph.calls())["start",].options["text"] == "three"
    assert graph.targets["default"] == (("words",),)


def test_the_profile_chooses_the_backend(space):
    space.write("recipes/say/b.yaml", "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s}}")
    assert dict(planned(space, "say/b").calls())["t",].rule.backend == "quiet"


LISTED = """
nodes:
  one: {rule: toy.start, text: a b}
  two: {rule: toy.start, text: c}
  words: {rule: toy.split, text: $one}
  loud: {each: $words, as: word, nodes: {heard: {rule: toy.shout, text: $word}}}
  all: {rule: toy.join, texts: {z: $two, a: $one}}
  nested: {each: $words, as: word, nodes: {pair: {rule: toy.join, texts: {word: $word, two: $two}}}}
targets: {default: [all, nested.pair]}
"""


def test_a_collection_can_be_listed_and_is_built(space):
    space.write("recipes/say/listed.yaml", LISTED)
    answer = space.build("say/listed")
    assert answer.code == 0, answer.err
    parts = {name: (space.root / path).read_text() for name, path in map(str.split, answer.out.splitlines())}
    # A collection is a mapping: what it joins comes in the order of the labels.
    assert parts == {"all": "a b c", "nested[a].pair": "c a", "nested[b].pair": "c b"}
    assert space.build("say/listed").nodes("ran") == set()
    changed = space.build("say/listed", "--set", "two.text=d")
    assert changed.nodes("ran") == {"two", "all", "nested[a].pair", "nested[b].pair"}


def test_a_listed_cycle_is_found(space):
    space.write("recipes/say/c.yaml", "nodes: {a: {rule: toy.join, texts: {x: $b}}, b: {rule: toy.split, text: $a}}")
    with pytest.raises(RecipeError):
        planned(space, "say/c")


@pytest.mark.parametrize(
    ("text", "code", "message", "line"),
    [
        (
            "nodes: {a: {rule: toy.start}, b: {rule: toy.split, text: {x: $a}}}",
            "R107",
            "the input `text` takes File, this is a mapping",
            "1:58",
        ),
        (
            "nodes: {a: {rule: toy.split, text: $b}, b: {rule: toy.start}, c: {rule: toy.join, texts: {x: $a}}}",
            "R107",
            "`texts.x` takes File, but `$a` is Collection[File]",
            "1:94",
        ),
        ("nodes: {a: {rule: toy.nothing}}", "R201", "no rule is called `toy.nothing`", "1:19"),
        ("nodes: {a: {rule: toy.start, txt: x}}", "R105", "`toy.start` has no input or option `txt`", "1:30"),
        ("nodes: {a: {rule: toy.split}}", "R106", "`toy.split` needs the input `text`", "1:19"),
        ("nodes: {a: {rule: toy.split, text: $b}}", "R104", "`$b` names nothing", "1:36"),
        ("nodes: {a: {rule: toy.split, text: b}}", "R107", "the input `text` takes a reference, this is text", "1:36"),
        (
            "nodes: {a: {rule: toy.start}, b: {rule: toy.join, texts: $a}}",
            "R107",
            "`texts` takes Collection[File], but `$a` is File",
            "1:58",
        ),
        (
            "nodes: {a: {rule: toy.start}, b: {rule: toy.split, text: $a.data}}",
            "R107",
            "`data` is bytes, not an artifact, and only artifacts can be inputs",
            "1:58",
        ),
        ("nodes: {a: {rule: toy.start}, b: {rule: toy.split, text: $a.dat}}", "R107", "File has no `dat`", "1:58"),
        (
            "nodes: {a: {rule: toy.start, text: 5}}",
            "R109",
            "`text` of `toy.start` must be a valid string",
            "1:36",
        ),
        (
            "nodes: {a: {rule: toy.start, sizes_m: [1, x]}}",
            "R109",
            "`sizes_m.1` of `toy.start` must be a valid number",
            "1:43",
        ),
        (
            "nodes:\n  a: {rule: toy.shout, text: $b}\n  b: {rule: toy.shout, text: $a}",
            "R108",
            "the recipe feeds into itself",
            "2:13",
        ),
        (
            "nodes:\n  s: {rule: toy.start}\n  w: {rule: toy.split, text: $s}\n"
            "  g:\n    each: $w\n    nodes:\n      a: {rule: toy.shout, text: $item}\n"
            "      b: {rule: toy.shout, text: $a}\n    overrides: {hello: {a: {text: $b}}}",
            "R108",
            "the recipe feeds into itself",
            "7:17",
        ),
        (
            "nodes: {a: {text: b}}",
            "R112",
            "the node `a` needs exactly one of `rule`, `recipe`, `each`, `matrix`",
            "1:9",
        ),
        (
            "nodes: {s: {rule: toy.start}, g: {each: $s, on_failure: skip, nodes: {a: {rule: toy.start}}}}",
            "R131",
            "`on_failure` is `stop` or `go_on` or `leave_out`, not `skip`",
            "1:57",
        ),
        ("nodes: {}", "R112", "no nodes are declared", "1:8"),
        ("node: {}", "R112", "a recipe has no `node`", "1:1"),
        ("nodes: {A: {rule: toy.start}}", "R112", "`A` is not a name", "1:9"),
        ("nodes: [1]", "R112", "`nodes` is a mapping, this is list", "1:8"),
        ("nodes: {a: {rule: toy.start}}\ntargets: {default: [b]}", "R104", "`$b` names nothing", "2:21"),
        ("nodes: {a: {recipe: say/nothing}}", "R110", "no recipe is called `say/nothing`", "1:21"),
        ("nodes: {a: {recipe: say/wrong}}", "R108", "the recipe uses itself", ""),
        ("extends: say/wrong", "R110", "the recipe extends itself", "1:10"),
        (
            "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s, backend: loud}}",
            "R202",
            "`toy.spoken` has no backend `loud`",
            "1:72",
        ),
        (
            "nodes: {w: {each: $x, nodes: {a: {rule: toy.start}}}}",
            "R104",
            "`$x` names nothing",
            "1:19",
        ),
    ],
)
def test_wrong_recipes_are_refused_at_the_place(space, text, code, message, line):
    error = refused(space, text)
    assert error.message == message
    assert error.code == f"DXB-{code}"
    assert error.exit_code == 2
    assert str(error.where).endswith(f"wrong.yaml:{line}" if line else "wrong.yaml")


def test_a_near_name_is_offered(space):
    assert (
        refused(space, "nodes: {camera: {rule: toy.start}, a: {rule: toy.split, text: $camra}}").hint
        == "did you mean `$camera`?"
    )
    assert refused(space, "nodes: {a: {rule: toy.star}}").hint == "did you mean `toy.start`?"


def test_a_cycle_is_shown(space):
    error = refused(space, "nodes:\n  a: {rule: toy.shout, text: $b}\n  b: {rule: toy.shout, text: $a}")
    assert error.facts["cycle"] == "`a` -> `b` -> `a`"


def test_a_missing_input_says_how_to_give_it(space):
    error = refused(space, "inputs: {x: {help: a file}}\nnodes: {a: {rule: toy.split, text: $x}}", UsageError)
    assert error.message == "the input `x` of `say/wrong` is not given"
    assert error.hint == "add `--input x=PATH`"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("times=3", "`times=3` is not a setting"),
        ("word.loud.times", "`word.loud.times` is not a setting"),
        ("word.quiet.times=3", "`word.quiet.times=3`: no node is called `word.quiet`"),
    ],
)
def test_wrong_settings_are_refused(space, text, message):
    with pytest.raises(UsageError) as caught:
        planned(space, settings=(settings.parse(text),))
    assert caught.value.message == message
