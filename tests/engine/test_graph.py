"""Addresses are read as they are written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build.engine.graph import Address, Leaf, node_address, parse_address
from dextera_build.errors import Place, UsageError
from tests.engine.tiny import HERE, call, every, graph, group, item, out


@pytest.mark.parametrize(
    ("text", "address"),
    [
        ("scene", Address(("scene",))),
        ("body.mesh", Address(("body", "mesh"))),
        ("body[mug].mesh", Address(("body", "mesh"), ("mug",))),
        ("body[blue mug.2].mesh", Address(("body", "mesh"), ("blue mug.2",))),
        ("body[mug].part.mesh", Address(("body", "part", "mesh"), ("mug",))),
        ("body[mug].part[lid].mesh", Address(("body", "part", "mesh"), ("mug", "lid"))),
    ],
)
def test_an_address_is_read_as_it_is_written(text: str, address: Address) -> None:
    assert parse_address(text) == address
    assert str(address) == text


@pytest.mark.parametrize(
    "text", ["", ".", "a.", ".a", "a..b", "a[x]", "a[].b", "a[x", "a]x[.b", "a[x]b", "a.b[x].c", "a[x][y].b"]
)
def test_what_is_not_an_address_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="is not the address of a node") as caught:
        parse_address(text)
    assert "body[mug].mesh" in caught.value.facts["form"]


def test_an_address_names_copies() -> None:
    labels = ("mug", "lid")
    assert Address(("b", "p", "m")).matches(labels)
    assert Address(("b", "p", "m"), ("mug",)).matches(labels)
    assert Address(("b", "p", "m"), labels).matches(labels)
    assert not Address(("b", "p", "m"), ("box",)).matches(labels)
    assert str(Address(("b", "p", "m"), labels)) == node_address(("b", "p", "m"), labels)


def test_reach_is_what_the_graph_alone_tells() -> None:
    plan = graph(
        call("a"),
        call("b"),
        call("seg", x=out("a")),
        group(
            "body",
            out("seg"),
            call("mesh", i=item("body")),
            call("pose", m=out("body.mesh")),
            mug=call("mesh", i=item("body"), b=out("b")),
        ),
        call("scene", all=every("body.pose")),
    )
    assert set(plan.walk([Address(("scene",))])) == {
        ("scene",),
        ("body", "pose"),
        ("body", "mesh"),
        ("seg",),
        ("a",),
        ("b",),
    }
    assert set(plan.walk([Address(("seg",))])) == {("seg",), ("a",)}


def test_the_place_of_an_error_in_an_input_gets_the_path_of_its_file() -> None:
    read = replace(call("a"), inputs={"scene": Leaf(Path("/p/lists/things.yaml"), HERE), "all": out("b")})
    assert str(read.placed(Place("$scene", 2, 10), "/p")) == "lists/things.yaml:2:10"
    assert str(read.placed(Place("$scene", 2, 10), "/elsewhere")) == "/p/lists/things.yaml:2:10"
    for other in (Place("$all", 1), Place("scene", 1), Place("rules/a.py", 3)):
        assert read.placed(other, "/p") == other
    assert read.placed(None, "/p") is None
