"""Completion in real shells: the scripts are loaded and their functions driven as a person would, with a tab."""

from __future__ import annotations

import os
import pty
import select
import shlex
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.e2e.space import Space

BASH = r"""
eval "$(dxb completion bash)"
COMP_LINE="$1" COMP_POINT=${#1} COMP_TYPE=9 COMP_WORDBREAKS=$' \t\n"\'><=;|&(:'
_python_argcomplete dxb
printf '%s\n' "${COMPREPLY[@]}"
"""


def shell_environment(space: Space) -> dict[str, str]:
    """`dxb` on the path is the one of this checkout."""
    folder = space.root / ".bin"
    if not folder.exists():
        folder.mkdir()
        (folder / "dxb").write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m dextera_build "$@"\n')
        (folder / "dxb").chmod(0o755)
    path = os.pathsep.join([str(Path(__file__).parents[2]), os.environ.get("PYTHONPATH", "")])
    return space.environment(PATH=f"{folder}:{os.environ['PATH']}", PYTHONPATH=path, TERM="dumb", HISTFILE="/dev/null")


def by_bash(space: Space, line: str) -> list[str]:
    done = subprocess.run(
        ["bash", "--norc", "-c", BASH, "bash", line],
        cwd=space.root, env=shell_environment(space), capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout.split()


@pytest.fixture
def built(space: Space) -> Space:
    assert space.build("say/words").code == 0
    return space


@pytest.mark.medium
def test_verbs_flags_and_values(space: Space) -> None:
    assert by_bash(space, "dxb bui") == ["build"]
    assert "--keep-going" in by_bash(space, "dxb build --k")
    assert by_bash(space, "dxb build --profile c") == ["cpu", "cloud"]
    assert by_bash(space, "dxb completion ") == ["bash", "zsh", "fish"]
    assert by_bash(space, "dxb build --console=j") == ["jsonl"]
    assert by_bash(space, "dxb build --executor r") == ["ray"]
    assert by_bash(space, "dxb cache ver") == ["verify"]


@pytest.mark.medium
def test_rules_and_backends(space: Space) -> None:
    assert by_bash(space, "dxb help toy.sh") == ["toy.shout"]
    assert "DXB-R105" in by_bash(space, "dxb help DXB-R1")
    assert by_bash(space, "dxb build say/words --set word.loude") == ["word.louder.times="]
    assert by_bash(space, "dxb build --backend factorize.mes") == ["factorize.mesh="]
    assert by_bash(space, "dxb build --backend factorize.mesh=st") == ["stub"]


@pytest.mark.medium
def test_recipes_nodes_and_runs(asked: Space) -> None:
    assert by_bash(asked, "dxb build say/") == ["say/words"]
    # Bash takes what stands before the last colon as a word of its own.
    assert by_bash(asked, "dxb build say/words:st") == ["start"]
    assert by_bash(asked, "dxb why say/words:word[one].loude") == ["word\\[one\\].louder"]
    assert by_bash(asked, "dxb why 'say/words:word[one].loude") == ["say/words:word[one].louder"]
    assert by_bash(asked, "dxb log 0") == ["0001"]
    assert by_bash(asked, "dxb log 0001 al") == ["all"]
    assert by_bash(asked, "dxb ls say/words:al") == ["all"]


def test_a_broken_project_completes_to_nothing(space: Space) -> None:
    space.write("dxb.toml", "no = toml = at all")
    assert by_bash(space, "dxb build say/words:") == []
    assert by_bash(space, "dxb bui") == ["build"]


def copies(space: Space) -> set[str]:
    """The copies that are offered to a verb that reads."""
    return {name.split(".")[0] for name in by_bash(space, "dxb why say/words:word[")}


@pytest.mark.medium
def test_copies_are_those_that_a_verb_which_reads_knows(built: Space) -> None:
    assert built.build("say/words", "--set", "start.text=one three").code == 0
    assert copies(built) == {"word\\[one\\]", "word\\[two\\]"}


@pytest.mark.medium
def test_copies_of_the_last_request_are_offered_if_the_recipe_as_it_is_was_never_built(space: Space) -> None:
    assert space.build("say/words", "--set", "start.text=one three").code == 0
    assert copies(space) == {"word\\[one\\]", "word\\[three\\]"}


def test_a_recipe_that_was_never_built_completes_what_it_declares(space: Space) -> None:
    assert by_bash(space, "dxb build say/words:") == ["default", "start", "words", "word", "all"]


@pytest.mark.medium
def test_a_node_to_force_is_one_of_the_recipe_that_is_built(asked: Space) -> None:
    assert by_bash(asked, "dxb build say/words --force st") == ["start"]


@pytest.mark.medium
def test_a_node_that_went_is_no_longer_offered(built: Space) -> None:
    assert by_bash(built, "dxb build say/words:al") == ["all"]
    for old, new in (("  all:", "  every:"), ("[all]", "[every]")):
        built.edit("recipes/say/words.yaml", old, new)
    assert by_bash(built, "dxb build say/words:al") == []


@pytest.mark.medium
def test_settings_say_which_store_is_asked(built: Space) -> None:
    assert by_bash(built, "dxb why 'say/words:word[one].loude") == ["say/words:word[one].louder"]
    built.write("dxb.local.toml", 'cache = "other"\n')
    assert by_bash(built, "dxb why 'say/words:word[one].loude") == []
    (built.root / "dxb.local.toml").unlink()
    assert by_bash(built, "dxb why 'say/words:word[one].loude") == ["say/words:word[one].louder"]
    built.write("recipes/say/more.yaml", "nodes: {}\n")
    assert by_bash(built, "dxb build say/") == ["say/more", "say/words"]


@pytest.mark.medium
def test_no_rule_is_imported(built: Space) -> None:
    built.write("rules/toy/shout.py", "raise SystemExit('imported')")
    assert by_bash(built, "dxb build say/words:al") == ["all"]


def test_an_unknown_shell_is_named(space: Space) -> None:
    answer = space.dxb("completion", "tcsh")
    assert answer.code == 2
    # Python 3.12 writes the choices without quotation marks.
    assert "argument shell: invalid choice: tcsh (choose from bash, zsh, fish)" in answer.err.replace("'", "")


def typed(space: Space, shell: list[str], setup: str, line: str, enough: str) -> str:
    """What an interactive shell has on its screen after `line` and a tab, Home, `echo` and Enter."""
    child, screen = pty.fork()
    if child == 0:
        os.chdir(space.root)
        os.execvpe(shell[0], shell, shell_environment(space))
    seen = ""
    try:
        for text, until in (
            (f"{setup}; echo rea''dy\n", "ready"),
            (f"{line}\t", ""),
            ("\x01printf '<%s>' \x05\n", enough),
        ):
            time.sleep(1.0)
            os.write(screen, text.encode())
            deadline = time.monotonic() + 20
            while (until and until not in seen and time.monotonic() < deadline) or select.select([screen], [], [], 2)[
                0
            ]:
                if select.select([screen], [], [], 0.2)[0]:
                    seen += os.read(screen, 4096).decode(errors="replace")
    finally:
        os.kill(child, 9)
        os.waitpid(child, 0)
        os.close(screen)
    return seen


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "setup"),
    [
        (["bash", "--norc", "-i"], 'eval "$(dxb completion bash)"'),
        (["zsh", "-f", "-i"], 'autoload -Uz compinit; compinit -D -u; eval "$(dxb completion zsh)"'),
    ],
    ids=["bash", "zsh"],
)
def test_a_tab_completes_as_a_person_sees_it(built: Space, shell: list[str], setup: str) -> None:
    if shutil.which(shell[0]) is None:
        pytest.skip(f"`{shell[0]}` is not installed")
    for line, whole in (
        ("dxb build say/w", "<dxb><build><say/words"),
        ("dxb why say/words:word[one].loude", "<dxb><why><say/words:word[one].louder>"),
        ("dxb why 'say/words:word[one].loude", "<dxb><why><say/words:word[one].louder>"),
    ):
        if "'" in line and shell[0] == "zsh":
            continue
        seen = typed(built, shell, setup, line, whole)
        assert whole in seen, seen


@pytest.mark.slow
def test_fish_completes_with_what_a_word_is(built: Space) -> None:
    if shutil.which("fish") is None:
        pytest.skip("`fish` is not installed")
    for line, words in (
        ("dxb bui", ["build\tbuild targets; only what is stale runs"]),
        ("dxb build say/", ["say/words"]),
        ("dxb why 'say/words:word[one].loude", ["say/words:word[one].louder"]),
        ("dxb why say/words:al", ["say/words:all"]),
    ):
        done = subprocess.run(
            ["fish", "--no-config", "-c", f"dxb completion fish | source; complete -C {shlex.quote(line)}"],
            cwd=built.root, env=shell_environment(built), capture_output=True, text=True,
        )  # fmt: skip
        assert done.stdout.splitlines() == words, done.stderr
