"""Strict YAML: core scalars, positions, refusals."""

from __future__ import annotations

import json

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from dextera_build.errors import RecipeError
from dextera_build.recipe import strict_yaml
from dextera_build.recipe.strict_yaml import parse


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("no", "no"),
        ("on", "on"),
        ("true", True),
        ("~", None),
        ("0x10", 16),
        ("0o10", 8),
        ("010", 10),
        ("1e3", 1000.0),
        (".5", 0.5),
        ("1_000", "1_000"),
        ("12:30", "12:30"),
        ("2026-01-01", "2026-01-01"),
        ("'1'", "1"),
    ],
)
def test_scalars_follow_the_core_schema(text, value):
    parsed = parse(f"a: {text}", "f").plain()["a"]
    assert parsed == value
    assert type(parsed) is type(value)


# JSON spells what lies beyond as two escapes, which YAML does not join.
words = st.text(st.characters(max_codepoint=0xFFFF, exclude_categories=("Cs",)), max_size=12)
plain_data = st.recursive(
    st.none() | st.booleans() | st.integers() | words,
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(words.filter(lambda key: key != "<<"), inner, max_size=4)
    ),
    max_leaves=12,
)


@settings(deadline=None)
@given(plain_data)
def test_json_is_yaml(value):
    assert parse(json.dumps({"x": value}), "f").plain() == {"x": value}


def test_every_value_knows_its_place():
    root = parse("a:\n  b: [1, {c: 2}]\n", "f.yaml")
    assert str(root.at(("a", "b", 1, "c"))) == "f.yaml:2:14"
    assert str(root.at(("a", "gone"))) == "f.yaml:2:3"


@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        ("a: 1\nb: 2\na: 3\n", "`a` is a duplicate key", "f:3:1"),
        ("a: [1\n", "not valid YAML: expected ',' or ']', but got '<stream end>'", "f:2:1"),
        ("", "the file is empty", "f"),
        ("<<: {a: 1}", "recipes have no merge keys, `<<`", "f:1:1"),
        ("1: a", "a key must be text, this one is 1", "f:1:1"),
        (
            "a: !!python/name:os.system ''",
            "the tag `tag:yaml.org,2002:python/name:os.system` is not known here",
            "f:1:4",
        ),
        ("a: !!str 1", "the tag `tag:yaml.org,2002:str` is not known here", "f:1:4"),
        ("a: 1\n---\nb: 2\n", "not valid YAML: but found another document", "f:2:1"),
        ("a: 1\nb: \x1b[31m", "not valid YAML: the character U+001B is not allowed", "f:2:4"),
    ],
)
def test_refusals_name_the_place(text, message, place):
    with pytest.raises(RecipeError) as caught:
        parse(text, "f")
    assert caught.value.message == message
    assert str(caught.value.where) == place


def test_an_alias_stands_for_its_anchor():
    assert parse("a: &x {b: [1, 2]}\nc: *x\nd: [*x, 3]\n", "f").plain() == {
        "a": {"b": [1, 2]},
        "c": {"b": [1, 2]},
        "d": [{"b": [1, 2]}, 3],
    }


@pytest.mark.parametrize(
    ("text", "message", "place"),
    [
        ("a: *gone", "not valid YAML: found undefined alias 'gone'", "f:1:4"),
        ("a: &x [*x]", "not valid YAML: found undefined alias 'x'", "f:1:8"),
        ("[" * 5000 + "]" * 5000, "values are nested more than 100 deep", "f:1:101"),
        (
            "a0: &a0 [x]\n" + "".join(f"a{n}: &a{n} [*a{n - 1}]\n" for n in range(1, 500)),
            "values are nested more than 100 deep",
            "f:100:12",
        ),
        ("? [1]\n: 2", "a key must be text, this one is none", "f:1:3"),
        (
            "a0: &a0 [x, x]\n" + "".join(f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]\n" for n in range(1, 12)),
            "aliases expand to more than 100000 values",
            "f:6:25",
        ),
    ],
)
def test_what_would_fill_memory_or_stack_is_refused(text, message, place):
    with pytest.raises(RecipeError) as caught:
        parse(text, "f")
    assert caught.value.message == message
    assert str(caught.value.where) == place


@pytest.mark.medium
@settings(deadline=None)
@given(plain_data)
def test_both_parsers_read_the_same(value):
    # PyYAML leaves `0E0` unquoted, which is a number here; such a key is refused.
    text = yaml.safe_dump({"x": value}, allow_unicode=True)
    fast = read(text)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(strict_yaml, "PARSER", yaml.SafeLoader)
        assert read(text) == fast


def read(text):
    """The values and a place, or the error."""
    try:
        root = strict_yaml.parse(text, "f")
    except RecipeError as error:
        return str(error)
    return root.plain(), root.at(("x",))


@pytest.mark.parametrize("parser", [strict_yaml.PARSER, yaml.SafeLoader])
def test_both_parsers_refuse_the_same_key(parser, monkeypatch):
    monkeypatch.setattr(strict_yaml, "PARSER", parser)
    with pytest.raises(RecipeError, match=r"a key must be text, this one is 0\.0"):
        strict_yaml.parse("x:\n  0E0: null\n", "f")


def test_a_call_knows_its_places_over_many_lines():
    text = "summary: x\nnodes:\n  a: &a\n    rule: x.y\n    b:\n      - 1\n      - {c: 2}\n  d: *a\n"
    root = parse(text, "f")
    for name in ("a", "d"):
        assert str(root.at(("nodes", name, "b", 1, "c"))) == "f:7:13"
        assert {key: str(place) for key, place in root.value["nodes"].value[name].keys.items()} == {
            "rule": "f:4:5",
            "b": "f:5:5",
        }
