"""The command line: its overview, old names, and what is said of words that it does not know."""

from __future__ import annotations

import pytest

from dextera_build.cli import grammar, options
from dextera_build.cli.main import main
from dextera_build.cli.verbs import GROUPS, MOVED, VERBS
from dextera_build.errors import UsageError


@pytest.mark.parametrize("words", [[], ["--help"]])
def test_the_overview_has_every_verb_in_its_group(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="0"):
        main(words)
    said = capsys.readouterr().out
    places = [said.index(f"\n{group}:") for group in GROUPS]
    assert places == sorted(places)
    assert all(f"\n  {verb} " in said for verb in VERBS)


@pytest.mark.parametrize(("old", "new"), MOVED.items())
def test_old_names_answer_with_the_new_one(old: str, new: str) -> None:
    with pytest.raises(UsageError, match=f"^`dxb {old}` is now `dxb {new}`$"):
        grammar.parse([old, "twin/laptop_scene"])
    for verb in new.split()[:1]:
        assert verb in VERBS


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["buidl"], "`buidl` is not a verb", "did you mean `dxb build`?"),
        (["build", "x", "--forec=y"], "`dxb build` has no flag `--forec`", "did you mean `--force`?"),
        (["cache", "gc", "--max-sze", "1"], "`dxb cache` has no flag `--max-sze`", "did you mean `--max-size`?"),
        (["plan", "x", "--qqqqq"], "`dxb plan` has no flag `--qqqqq`", "`dxb plan --help` lists its arguments"),
        (["plan", "x", "y"], "`y` is an unexpected argument", "`dxb plan --help`"),
    ],
)
def test_unknown_words_have_a_suggestion(words: list[str], message: str, hint: str) -> None:
    with pytest.raises(UsageError) as caught:
        grammar.parse(words)
    assert (caught.value.message, caught.value.hint) == (message, hint)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("run t --policy p --speed 0", "`--speed 0` is no number above 0 to 1"),
        ("run t --policy p --speed nan", "`--speed nan` is no number above 0 to 1"),
        ("run t --policy p --ramp nan", "`--ramp nan` is no number from 0 to 60"),
        ("run t --policy p --ramp -1", "`--ramp -1` is no number from 0 to 60"),
        ("run t --policy p --limit nan", "`--limit nan` is no number above 0 to 86400"),
        ("run t --policy p --limit inf", "`--limit inf` is no number above 0 to 86400"),
        ("robot record t --limit nan", "`--limit nan` is no number above 0 to 86400"),
        ("robot doctor t --listen inf", "`--listen inf` is no number above 0 to 600"),
        ("robot track t --seconds nan", "`--seconds nan` is no number from 0"),
        ("robot simulate t --loss 2", "`--loss 2` is no number from 0 to 1"),
        ("robot simulate t --delay soon", "`--delay soon` is no number from 0 to 60"),
    ],
)
def test_numbers_that_no_robot_has_are_refused(words: str, message: str) -> None:
    with pytest.raises(UsageError) as caught:
        grammar.parse(words.split())
    assert (caught.value.message, caught.value.code) == (message, "DXB-U347")


@pytest.mark.parametrize("text", ["-1", "65536", "99999999", "80.5", "http"])
def test_a_port_is_a_number_that_a_system_has(text: str) -> None:
    assert (options.port("0"), options.port("65535")) == (0, 65535)
    with pytest.raises(UsageError, match=f"`--port {text}` is no port from 0 to 65535"):
        options.port(text)
    for verb in ("view", "serve", "teleop"):
        with pytest.raises(UsageError, match="is no port"):
            grammar.parse([verb, "say/words", f"--port={text}"])
