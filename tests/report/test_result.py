"""What stands at the top of a report: what represents a result, what is an object, and another run beside it."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from dextera_build.report import build as report
from dextera_build.report import objects, result
from dextera_build.report.compared import compared
from dextera_build.report.pictures import LADDER, Pictures
from dextera_build.report.run import Node, Run
from tests.report.fabricate import FakeStore, fabricate


def plain_node(number: int, address: str, artifact: str = "", **more: Any) -> Node:
    node = Node(number, address, "a.b", None, "ran", None, more.pop("output", f"digest {number}"), 0.0, 1.0)
    node.artifact = artifact
    for name, value in more.items():
        setattr(node, name, value)
    return node


def test_a_failed_attempt_represents_a_node_only_if_nothing_else_does() -> None:
    good, bad = ("a demonstration", "1"), ("failed: dropped", "2")
    assert objects.foremost(plain_node(0, "sources", previews=[good, bad])) == good
    assert objects.foremost(plain_node(0, "sources", previews=[bad])) == bad
    assert objects.foremost(plain_node(0, "mesh", previews=[("crop", "1"), ("mesh", "2")])) == ("mesh", "2")


def test_shards_of_a_data_set_are_no_objects() -> None:
    parts = [plain_node(i, f"part[{i}].made", "Episodes") for i in range(3)]
    bodies = [plain_node(3 + i, f"body[{name}].mesh", "Shape") for i, name in enumerate(("mug", "box"))]
    run = Run(nodes=[*parts, *bodies], groups={"part": ["0", "1", "2"], "body": ["mug", "box"]})
    pictures = Pictures(FakeStore(), LADDER[0])  # type: ignore[arg-type]
    told = {kind: "".join(objects.cards(run, pictures, objects=kind)) for kind in (True, False)}
    assert [label in told[True] for label in ("mug", "box", "part")] == [True, True, False]
    assert [label in told[False] for label in ("mug", "box", "part")] == [False, False, True]


def test_no_line_of_the_result_is_lost_and_none_is_cut() -> None:
    run = Run(nodes=[plain_node(i, f"step_{i}", line=f"line {i}") for i in range(20)])
    told = result.outcome(run)
    assert [i for i in range(20) if f"<p>line {i}</p>" not in told] == []
    assert told.index("<summary>14 earlier steps</summary>") > told.index("step_19")
    style = (resources.files("dextera_build.report") / "assets/report.css").read_text()
    assert "line-clamp" not in style
    assert "text-overflow" not in style
    assert not re.search(r"\.outcome[^{]*\{[^}]*max-height", style)


def test_two_runs_stand_side_by_side(tmp_path: Path) -> None:
    pictures = Pictures(FakeStore(), LADDER[0])  # type: ignore[arg-type]

    def run(name: str, output: str, psnr: float, *more: Node) -> Run:
        return Run(
            name=name,
            nodes=[
                plain_node(0, "same", output="equal", metrics={"a": (1.0, "m")}),
                plain_node(1, "overlay", output=output, metrics={"PSNR": (psnr, "dB"), "views": (4.0, "")}),
                *more,
            ],
        )

    told = "".join(compared(run("0002", "x", 31.5, plain_node(2, "new")), run("0001", "y", 28.25), pictures))
    assert "1 of 2 nodes gave another result; new: only now" in told
    assert "same" not in told
    assert re.search(r"<b>PSNR</b></th><td class=\"number\">28.25 dB</td><td class=\"number\">31.5 dB</td>", told)
    assert re.search(r"<th scope=\"row\">views</th><td class=\"number\">4</td><td class=\"number\">4</td>", told)
    assert told.index("run 0001") < told.index("run 0002")


@pytest.mark.medium
def test_a_page_beside_another_run_has_both_pictures(tmp_path: Path) -> None:
    events, store = fabricate("cold")
    alone = report.build(events, store, tmp_path / "a.html").read_text()
    text = report.build(events, store, tmp_path / "b.html", against=events).read_text()
    assert text.count("<img") == alone.count("<img") + 2
    assert "0 of " in text
    assert 'id="compared"' in text
    assert 'id="compared"' not in alone
