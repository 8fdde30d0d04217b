"""Consent through the real `dxb`: refused without, asked for on a terminal, given by a command or a variable."""

from __future__ import annotations

import os
import pty
import subprocess
import sys
import time

import pytest

from tests.e2e.space import Space

RULE = '''
"""toy.look: shows a picture to a service that is part of this machine."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class LookOptions(Options):
    """Options."""
    service: str = "seer"
    """Who looks."""

@rule(version=1)
def look(ctx: Context, *, options: LookOptions) -> File:
    """Return what it says."""
    picture = b"\\x89PNG\\r\\n\\x1a\\n" + b"0" * 992
    return File(data=ctx.call(options.service, {"picture": picture}, lambda seconds: b"a mug"))
'''
RECIPE = """
nodes:
  one: {rule: toy.look}
  two: {rule: toy.look, service: oracle}
targets: {default: [one, two], one: [one]}
"""


@pytest.fixture
def looking(space: Space) -> Space:
    space.write("rules/toy/look.py", RULE.lstrip())
    space.write("recipes/say/look.yaml", RECIPE)
    return space


def on_terminal(space: Space, *words: str, answers: list[str]) -> tuple[int, str]:
    """Run `dxb` on a terminal, typing an answer whenever it asks; returns the exit code and all that was shown."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "dextera_build", *words]
    process = subprocess.Popen(
        command, cwd=space.root, env=space.environment(TERM="dumb"), stdin=theirs, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    shown, asked, deadline = "", 0, time.monotonic() + 120
    while time.monotonic() < deadline:
        try:
            data = os.read(ours, 4096)
        except OSError:  # the other end was closed
            break
        if not data:
            break
        shown += data.decode(errors="replace")
        if shown.count("[N]o: ") > asked:
            os.write(ours, answers[asked].encode() + b"\n")
            asked += 1
    os.close(ours)
    return process.wait(30), shown


def test_without_a_terminal_it_is_an_error_with_the_next_step(looking: Space) -> None:
    answer = looking.dxb("build", "say/look:one")
    assert answer.code == 1
    assert "error[DXB-E365]" in answer.err
    assert "`seer` would receive a photograph, without your consent" in answer.err
    assert "hint: `dxb consent give seer photograph`; in CI DXB_CONSENT=seer:photograph" in answer.err
    assert looking.dxb("consent", "give", "seer", "photograph").code == 0
    assert looking.dxb("build", "say/look:one").code == 0


@pytest.mark.medium
def test_a_yes_on_the_terminal_goes_on_and_is_remembered(looking: Space) -> None:
    code, shown = on_terminal(looking, "build", "-k", "say/look", answers=["y", "always"])
    assert code == 0, shown
    assert "Send a photograph of this project to `oracle`" in shown
    rows = {row["service"]: row for row in looking.dxb("consent", "ls", "--json").rows}
    assert rows["oracle"]["project"] == "*" or rows["seer"]["project"] == "*"
    assert {rows["oracle"]["project"], rows["seer"]["project"]} == {"*", str(looking.root)}
    assert looking.dxb("build", "say/look", "--calls", "refresh").code == 0


@pytest.mark.medium
@pytest.mark.parametrize("said", ["", "n", "maybe"])
def test_anything_but_yes_is_no(looking: Space, said: str) -> None:
    code, shown = on_terminal(looking, "build", "say/look:one", answers=[said])
    assert code == 1
    assert shown.count("[N]o: ") == 1
    assert looking.dxb("consent", "ls").out == ""


def test_the_variable_of_ci_allows_what_it_names(looking: Space) -> None:
    answer = looking.dxb("build", "-k", "say/look", env={"DXB_CONSENT": "seer:photograph"})
    assert answer.code == 1
    assert "`oracle` would receive" in answer.err
    assert "`seer` would receive" not in answer.err
    assert looking.dxb("build", "say/look", env={"DXB_CONSENT": "all"}).code == 0
    wrong = looking.dxb("build", "say/look", env={"DXB_CONSENT": "seer"})
    assert wrong.code == 2
    assert "error[DXB-U181]" in wrong.err


def test_a_kind_of_data_that_is_spelled_wrong_is_refused(looking: Space) -> None:
    answer = looking.dxb("consent", "give", "seer", "photographs")
    assert (answer.code, "hint: did you mean `photograph`?" in answer.err) == (2, True)
    assert looking.dxb("consent", "ls").out == ""
    assert looking.dxb("consent", "give", "seer", "thermal_picture").code == 0  # of a rule of the project


def test_consent_can_be_withdrawn(looking: Space) -> None:
    looking.dxb("consent", "give", "seer")
    assert looking.dxb("consent", "ls").out.split("\t")[:3] == ["seer", "photograph", str(looking.root)]
    assert looking.dxb("consent", "ls", env={"DXB_CONSENT": "x:mesh"}).out.startswith("x\tmesh\tDXB_CONSENT\t-\n")
    assert looking.dxb("consent", "withdraw", "seer").code == 0
    assert looking.dxb("build", "say/look:one").code == 1
    again = looking.dxb("consent", "withdraw", "seer")
    assert again.code == 2
    assert "error[DXB-U182]: there is no such consent for `seer`" in again.err
