"""`dxb help`: verbs, error codes, rules, artifact types."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from dextera_build.cli.main import main
from dextera_build.explain import error_codes


def said(capsys: pytest.CaptureFixture[str], *words: str, code: int = 0) -> str:
    assert main(["help", *words]) == code
    told = capsys.readouterr()
    return told.err if code else told.out


def test_an_error_code_says_what_it_means_and_what_to_do(capsys: pytest.CaptureFixture[str]) -> None:
    told = said(capsys, "DXB-U195")
    assert told.startswith("DXB-U195: The command line is wrong (exit 2).\n\na build on a cluster needs a remote")
    assert "\n   what to do: in `dxb.toml`: [remotes] shared = " in told
    assert said(capsys, "u195") == told


@pytest.mark.medium
def test_a_rule_says_what_it_takes_and_gives(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [line.split("\t") for line in said(capsys, "factorize.mesh").splitlines()]
    assert [row[0] for row in rows[:6]] == ["rule", "input", "input", "input", "input", "output"]
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


COMMON = Path(error_codes.__file__).parent.parent / "docs" / "common_errors.md"


@pytest.mark.medium
def test_forty_codes_have_an_example_and_what_to_write_instead(capsys: pytest.CaptureFixture[str]) -> None:
    codes = re.findall(r"^## (.*)", COMMON.read_text(), re.MULTILINE)
    known = {site.code for site in error_codes.sites()}
    assert len(codes) == len(set(codes)) >= 40
    assert set(codes) <= known
    for code in codes:
        about, *examples = error_codes.section(code)
        assert about.endswith(".")
        assert any(part.startswith("```text\n") and part.endswith("\n```") for part in examples), code


@pytest.mark.medium
def test_a_common_code_is_explained_within_the_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    for code in re.findall(r"^## (.*)", COMMON.read_text(), re.MULTILINE):
        assert max(map(len, said(capsys, code).splitlines())) < 80
    told = said(capsys, "DXB-R109")
    assert "The value of an option has another type, or lies outside its bounds." in told
    assert "\n   primitives: {wall_m: 0.003}      # right: 3 mm\n" in told
    assert "```" not in told
