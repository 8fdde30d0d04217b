"""How errors look: every form, as text."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import patch

import pytest

from dextera_build.cli.errors import read_lines, render, render_node
from dextera_build.errors import DxbError, MachineError, Place, RecipeError, RuleError, smallest_extra
from dextera_build.runs.events import NodeFinished

LINE = "  objects: {rule: segment.instances, frames: $frames, cameras: $camera, backend: sam2,"


def quoting(lines: list[str] | None, error: DxbError, *, colour: bool = False) -> str:
    """The text of an error about a file with these lines."""
    with patch("dextera_build.cli.errors.read_lines", lambda file: lines):
        return render(error, colour=colour)


def failed(error: DxbError | None, backend: str | None = "primitives") -> NodeFinished:
    return NodeFinished(
        time=1.0,
        node="body[laptop].shape",
        rule="factorize.mesh",
        backend=backend,
        status="failed",
        key=None,
        output=None,
        seconds=3.0,
        error=error,
    )


def test_recipe_error_quotes_the_line_and_underlines_the_literal() -> None:
    error = RecipeError(
        "`$camera` names nothing",
        code="DXB-R104",
        where=Place("recipes/twin/laptop_scene.yaml", 11, 64),
        facts={"known here": "video, robot, frames, cameras"},
        hint="did you mean `$cameras`?",
    )
    assert quoting([""] * 10 + [LINE], error) == (
        "error[DXB-R104]: `$camera` names nothing\n"
        "  --> recipes/twin/laptop_scene.yaml:11:64\n"
        "   |\n"
        f"11 | {LINE}\n"
        "   |                                                                ^^^^^^^\n"
        "   = known here: video, robot, frames, cameras\n"
        "\n"
        "hint: did you mean `$cameras`?"
    )


@pytest.mark.parametrize(
    ("text", "column", "marks"),
    [
        ("mesh: {voxel_m: fine}", 17, "^^^^"),
        ("voxel_m: 2", 1, "^^^^^^^"),
        ("a: 'two words', b: 1", 4, "^^^^^^^^^^^"),
        ("a: }", 4, "^"),
        ("a:", 3, "^"),
    ],
)
def test_a_word_is_underlined_where_no_literal_stands(text: str, column: int, marks: str) -> None:
    shown = quoting([text], RecipeError("wrong", where=Place("r.yaml", 1, column)))
    assert shown.splitlines()[-1] == f"   | {' ' * (column - 1)}{marks}"


def test_a_tab_before_the_word_keeps_the_marks_under_it() -> None:
    shown = quoting(["\tbad"], RecipeError("wrong", where=Place("r.yaml", 1, 2)))
    assert shown.splitlines()[-2:] == [" 1 | \tbad", "   | \t^^^"]


@pytest.mark.parametrize("lines", [None, [], ["one line only"]])
def test_a_line_that_cannot_be_read_is_only_named(lines: list[str] | None) -> None:
    error = RecipeError(
        "the key `a` is a duplicate", code="DXB-R102", where=Place("r.yaml", 3, 1), facts={"first": "2"}
    )
    assert quoting(lines, error) == ("error[DXB-R102]: the key `a` is a duplicate\n  --> r.yaml:3:1\n   = first: 2")


def test_a_place_that_is_a_whole_file() -> None:
    shown = render(RecipeError("the file is empty", code="DXB-R101", where=Place("r.yaml")))
    assert shown == "error[DXB-R101]: the file is empty\n  --> r.yaml"


def test_facts_without_a_place_line_up() -> None:
    error = MachineError(
        "backend `sam2` of segment.instances is not installed",
        code="DXB-E301",
        facts={"needs": "extra `sam2`, a GPU with 8 GiB", "here": "no GPU\nno weights"},
        hint="`pip install -e '.[models]'`",
    )
    assert render(error) == (
        "error[DXB-E301]: backend `sam2` of segment.instances is not installed\n"
        "   needs   extra `sam2`, a GPU with 8 GiB\n"
        "   here    no GPU\n"
        "           no weights\n"
        "\n"
        "hint: `pip install -e '.[models]'`"
    )


def test_a_bare_error_is_one_line() -> None:
    assert render(DxbError("it broke")) == "error[DXB-X000]: it broke"


def test_colour_changes_no_character() -> None:
    import re

    error = RecipeError("`$x` names nothing", where=Place("r.yaml", 1, 4), facts={"known": "y"}, hint="h")
    painted = quoting(["a: $x"], error, colour=True)
    assert "\x1b[31;1m" in painted
    assert re.sub(r"\x1b\[[\d;]*m", "", painted) == quoting(["a: $x"], error)


def test_node_failure() -> None:
    error = RuleError("214 open edges, 0 allowed", code="DXB-B201", facts={"input": "18,402 points"}, hint="raise it")
    assert render_node(failed(error), ["scene", "mjcf", "usd"], "0143") == (
        "error[DXB-B201]: body[laptop].shape failed its check: 214 open edges, 0 allowed\n"
        "   rule    factorize.mesh, backend primitives\n"
        "   input   18,402 points\n"
        "   waits   scene, mjcf, usd\n"
        "   log     dxb log 0143 'body[laptop].shape'\n"
        "\n"
        "hint: raise it"
    )


def test_node_failure_that_is_no_check_and_stops_nothing() -> None:
    error = RuleError("the depth holds no object", code="DXB-B202", where=Place("scene.yaml", 4, 2))
    assert render_node(failed(error, None), [], "0143") == (
        "error[DXB-B202]: body[laptop].shape failed: the depth holds no object\n"
        "   rule   factorize.mesh\n"
        "   at     scene.yaml:4:2\n"
        "   log    dxb log 0143 'body[laptop].shape'"
    )


def test_node_failure_without_an_error_and_with_many_that_wait() -> None:
    shown = render_node(failed(None), [f"n{i}" for i in range(20)], "0143")
    assert "failed: it ended without a result" in shown
    assert "waits   n0, n1, n2, n3, n4, n5 and 14 more" in shown


def test_read_lines(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text("x: 1\ny: 2\n")
    (tmp_path / "b.yaml").write_bytes(b"\xff\xfe\x00")
    assert read_lines(str(tmp_path / "a.yaml")) == ["x: 1", "y: 2"]
    assert read_lines(str(tmp_path / "b.yaml")) is None
    assert read_lines(str(tmp_path / "none.yaml")) is None
    assert read_lines("nul\0byte") is None


STEERING = "a\x1b[2Jb\x07\x9b1m\u202edcba\u2066\ufeff\ud800\x00"


def test_what_others_wrote_cannot_steer_the_terminal() -> None:
    error = RecipeError(
        f"`{STEERING}` names nothing",
        where=Place(f"{STEERING}.yaml", 1, 4),
        facts={STEERING: STEERING},
        hint=f"`{STEERING}`",
    )
    shown = quoting([f"a: ${STEERING}"], error)
    assert all(c.isprintable() or c == "\n" for c in shown)
    assert "a\\x1b[2Jb\\x07\\x9b1m\\u202edcba" in shown
    bare = render(RecipeError(STEERING, facts={"b": STEERING}))
    assert all(c.isprintable() or c == "\n" for c in bare)


def test_a_message_of_megabytes_is_shortened_and_the_marks_stay_under_the_word() -> None:
    error = RecipeError("x" * 1_000_000, where=Place("r.yaml", 1, 500_001), facts={"f": "y" * 1_000_000})
    shown = quoting([" " * 500_000 + "word" + " " * 500_000], error)
    assert len(shown) < 12_000
    line, marks = shown.splitlines()[3:5]
    assert line.index("word") == marks.index("^^^^")


@pytest.mark.parametrize(
    ("missing", "extra"),
    [(["opencv-python-headless", "trimesh"], "twin"), (["mujoco"], "env"), (["av"], "learn"), (["no-such"], "all")],
)
def test_a_hint_names_the_smallest_extra(missing, extra):
    assert smallest_extra(missing) == extra
