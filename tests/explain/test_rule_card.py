"""The card of a rule, as a narrow terminal shows it."""

from __future__ import annotations

from pathlib import Path

from dextera_build.code.loader import Library
from dextera_build.explain import rule_card
from dextera_build.project.project import find


def card(library: Library, rule: str) -> dict[str, str]:
    rows = rule_card.rows(library, library.find(rule))
    return {row["name"]: row["value"] for row in rule_card.narrow(rows)}


def test_a_narrow_card_tells_which_inputs_are_required(tmp_path: Path) -> None:
    told = card(find(tmp_path).library, "factorize.mesh")
    assert told["input view"] == "ObjectView\nrequired"
    assert told["input support"] == "Support\noptional"


def test_bounds_are_those_of_the_option_and_of_its_unit(tmp_path: Path) -> None:
    told = card(find(tmp_path).library, "factorize.mesh")
    assert told["texture_px"] == "int\n= 1024 px\n> 0, <= 16384"
    assert told["hunyuan3d_2_1.seed"] == "int\n= 0\n>= 0"
    assert "e+" not in told["poisson.depth"] + told["least_points"]
