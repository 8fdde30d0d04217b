"""Keys: what enters them, what does not, and how two are compared."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import pytest

from dextera_build import digest
from dextera_build.code.order import ORDER
from dextera_build.engine.graph import Call, Leaf, Output
from dextera_build.engine.key import Change, Writer, compare
from dextera_build.errors import Place
from tests.engine.tiny import call, facts

INPUTS = {"seen": "1" * 64, "all": "2" * 64}

BASE = dataclasses.replace(
    call("mesh"),
    rule=facts(
        code={"rules/a.py": {"mesh": "1", "<module>": "2"}, "rules/b.py": {"helper": "3"}},
        packages={"numpy": "2.0", "trimesh": "4.5"},
        backend="poisson",
        weights=("sam@abc",),
        types={"return": "5", "seen": "6"},
    ),
    options={"voxel_m": 0.002, "hole": {"close": True, "sizes": [1, 2]}},
)


def manifest(call: Call, inputs: dict[str, str]) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(Writer().document(call, inputs))
    return document


def key_of(call: Call, inputs: dict[str, str]) -> str:
    return digest.of_bytes(Writer().document(call, inputs))


def rule(**changes: Any) -> Call:
    return dataclasses.replace(BASE, rule=dataclasses.replace(BASE.rule, **changes))


def option(**changes: Any) -> Call:
    return dataclasses.replace(BASE, options={**BASE.options, **changes})


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        (option(voxel_m=0.001), [Change("option", "voxel_m", 0.002, 0.001)]),
        (option(hole={"close": False, "sizes": [1, 2]}), [Change("option", "hole.close", True, False)]),
        (option(hole={"close": True, "sizes": [2, 1]}), [Change("option", "hole.sizes", [1, 2], [2, 1])]),
        (option(fast=None), [Change("option", "fast", None, None)]),
        (
            rule(code={"rules/a.py": {"mesh": "9", "<module>": "2"}, "rules/b.py": {"other": "3"}}),
            [
                Change("code", "rules/a.py: mesh", "1", "9"),
                Change("code", "rules/b.py: helper", "3", None),
                Change("code", "rules/b.py: other", None, "3"),
            ],
        ),
        (rule(version=2), [Change("version", "version", 1, 2)]),
        (rule(path="tiny.other"), [Change("version", "rule", "tiny.rule", "tiny.other")]),
        (rule(backend=None), [Change("backend", "backend", "poisson", None)]),
        (rule(weights=("sam@abd",)), [Change("weights", "sam", "abc", "abd")]),
        (
            rule(companions={"seen": ["learn.act/policy"]}),
            [Change("companion", "seen", None, "`policy.py` of learn.act")],
        ),
        (rule(packages={"numpy": "2.1", "trimesh": "4.5"}), [Change("package", "numpy", "2.0", "2.1")]),
        (rule(types={"return": "7", "seen": "6"}), [Change("type", "return", "5", "7")]),
        (dataclasses.replace(BASE, salt="again"), [Change("salt", "salt", "", "again")]),
    ],
)
def test_everything_that_matters_enters_the_key_and_is_explained(changed: Call, expected: list[Change]) -> None:
    assert key_of(changed, INPUTS) != key_of(BASE, INPUTS)
    assert compare(manifest(BASE, INPUTS), manifest(changed, INPUTS)) == expected


def test_inputs_enter_by_slot_and_digest() -> None:
    other = {**INPUTS, "seen": "3" * 64, "extra": "4" * 64}
    assert compare(manifest(BASE, INPUTS), manifest(BASE, other)) == [
        Change("input", "extra", None, "4" * 64),
        Change("input", "seen", "1" * 64, "3" * 64),
    ]
    swapped = {"seen": INPUTS["all"], "all": INPUTS["seen"]}
    assert key_of(BASE, swapped) != key_of(BASE, INPUTS)


@pytest.mark.parametrize(
    "changed",
    [
        dataclasses.replace(BASE, name="other"),
        dataclasses.replace(BASE, where=Place("elsewhere.yaml", 7, 1)),
        dataclasses.replace(BASE, option_places={"voxel_m": Place("cli", 1, 1)}),
        dataclasses.replace(BASE, inputs={"seen": Output(("renamed",)), "all": Leaf(Path("x"), Place("y"))}),
        rule(cpus=8),
        rule(memory_gb=64.0),
    ],
)
def test_names_places_and_resources_stay_out(changed: Call) -> None:
    assert key_of(changed, INPUTS) == key_of(BASE, INPUTS)
    assert compare(manifest(BASE, INPUTS), manifest(changed, INPUTS)) == []


def test_order_does_not_matter() -> None:
    turned = rule(packages=dict(reversed(list(BASE.rule.packages.items()))))
    assert key_of(turned, dict(reversed(list(INPUTS.items())))) == key_of(BASE, INPUTS)


def test_another_backend_is_told_before_the_code_that_it_brings() -> None:
    other = rule(backend="other", code={**BASE.rule.code, "other.py": {"f": "1"}})
    kinds = [change.kind for change in compare(manifest(BASE, INPUTS), manifest(other, INPUTS))]
    assert kinds == ["backend", "code"]


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ({ORDER: "<module>*2 F <module>"}, {ORDER: "<module>*3 F"}, [("F <module>", "<module> F")]),
        ({ORDER: "A B,C"}, {ORDER: "B,C A"}, [("A B C", "B C A")]),
        ({ORDER: "A B"}, {ORDER: "A B X", "X": "1"}, []),
        ({ORDER: "A B"}, {ORDER: "B A X", "X": "1"}, [("A B", "B A")]),
        ({ORDER: "A X B", "X": "1"}, {ORDER: "A B X", "X": "2"}, []),
        ({}, {ORDER: "A X", "X": "1"}, []),
    ],
    ids=["moved", "a set", "a new one", "a new one and moved", "changed and moved", "the first"],
)
def test_an_order_is_told_of_what_is_the_same(old: dict[str, str], new: dict[str, str], told: list[Any]) -> None:
    known = {"<module>": "2", "A": "1", "B": "1", "C": "1", "F": "1"}
    first, second = (manifest(rule(code={"a.py": known | each}), INPUTS) for each in (old, new))
    changes = [change for change in compare(first, second) if ORDER in change.name]
    assert changes == [Change("code", f"a.py: {ORDER}", *each) for each in told]


def test_numbers_are_typed() -> None:
    keys = {key_of(option(voxel_m=value), INPUTS) for value in (1, 1.0, "1", True)}
    assert len(keys) == 4
    assert compare(manifest(option(voxel_m=1), {}), manifest(option(voxel_m=1.0), {})) == [
        Change("option", "voxel_m", 1, 1.0)
    ]
    with pytest.raises(ValueError, match="not JSON compliant"):
        key_of(option(voxel_m=float("nan")), INPUTS)


def test_documents_are_canonical_whatever_was_written_before() -> None:
    writer = Writer()
    calls = [BASE, rule(backend=None), option(text='a"b\\ü'), call("plain"), BASE]
    for each in calls:
        for inputs in (INPUTS, {}, {"z": "0" * 64}):
            written = writer.document(each, inputs)
            document = manifest(each, inputs)
            assert written == digest.canonical(document)
            assert document["options"] == each.options
            assert document["code"] == each.rule.code
            assert document["inputs"] == [[slot, inputs[slot]] for slot in sorted(inputs)]
