"""`dxb help`: verbs, error codes, rules, artifact types."""

from __future__ import annotations

import pytest

from dextera_build.cli.main import main


def said(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    assert main(["help", *words]) == code
    told = capsys.readouterr()
    return told.err if code else told.out


def test_an_error_code_says_what_it_means_and_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    told = said(capsys, "DXB-U195")
    assert told.startswith("DXB-U195: The command line is wrong (exit 2).\n\na build on a cluster needs a remote")
    assert "\n   what to do: in `dxb.toml`: [remotes] shared = " in told
    assert said(capsys, "u195") == told


def test_a_rule_says_what_it_takes_and_gives(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [line.split("\t") for line in said(capsys, "factorize.mesh").splitlines()]
    assert [row[0] for row in rows[:5]] == ["rule", "input", "input", "input", "output"]
    (wall,) = (row for row in rows if row[1] == "primitives.wall_m")
    assert wall[:5] == ["option", "primitives.wall_m", "float", "0.003", "> 0, <= 0.3"]
    assert wall[5].endswith("[m].")
    assert main(["show", "factorize.mesh"]) == 0
    assert [line.split("\t") for line in capsys.readouterr().out.splitlines()] == rows


def test_a_type_says_where_it_is_and_what_its_fields_hold(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [line.split("\t") for line in said(capsys, "Support").splitlines()]
    assert rows[0][:3] == ["type", "Support", "dextera_build.artifacts.objects.object"]
    fields = {row[1]: row[2:] for row in rows[1:]}
    assert fields["camera_pose"][0] == "Pose T_world_camera"
    assert "(P, 2)" in fields["polygon"][0]
    assert fields["residual_m"][0] == "float | None"
    assert fields["residual_m"][1].startswith("Root mean square distance of the inliers to the plane [m]")
    assert said(capsys, "Element").splitlines()[1].startswith("field\tname\tstr\t")


def test_a_former_address_of_a_rule_gives_the_current_one(capsys: pytest.CaptureFixture[str]) -> None:
    told = said(capsys, "capture.mesh", code=2)
    assert "the rule `capture.mesh` is now `capture.file`" in told
    assert "write `rule: capture.file, type: Mesh`" in told
    assert main(["show", "capture.mesh"]) == 2
    assert capsys.readouterr().err == told


@pytest.mark.parametrize(("word", "usage"), [("why", "usage: dxb why "), ("push", "usage: dxb cache push ")])
def test_a_verb_has_its_own_help(word: str, usage: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(["help", word])
    assert capsys.readouterr().out.startswith(usage)


def test_without_a_word_it_is_the_overview(capsys: pytest.CaptureFixture[str]) -> None:
    assert "\nproject:\n" in said(capsys)


def test_what_is_nothing_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert "there is no error `DXB-Z999`" in said(capsys, "DXB-Z999", code=2)
    assert "did you mean `dxb help factorize.mesh`?" in said(capsys, "factorize.mesch", code=2)
    assert "did you mean `dxb help Elements`?" in said(capsys, "Elemnts", code=2)
