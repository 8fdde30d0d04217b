"""What verbs that read give: the recipe as the project has it, whatever else was built or has failed."""

from __future__ import annotations

import time

import pytest

from dextera_build import Project
from dextera_build.cli.main import main
from tests.e2e.space import Space


class Here:
    """Commands in this process, in a project whose rule can be told to fail."""

    def __init__(self, counts: Space, capsys: pytest.CaptureFixture[str]) -> None:
        self._space, self._capsys = counts, capsys

    def __call__(self, *words: str) -> tuple[int, str, str]:
        code = main(list(words))
        said = self._capsys.readouterr()
        return code, said.out, said.err

    def got(self, *words: str, node: str = "g:a0") -> bytes:
        code, out, err = self("get", node, "-o", "got", *words)
        assert code == 0, err
        return (self._space.root / out.strip()).read_bytes()

    def report(self) -> str:
        code, out, err = self("report", "g")
        assert code == 0, err
        return (self._space.root / out.strip()).read_text()


@pytest.fixture
def here(counts: Space, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Here:
    monkeypatch.chdir(counts.root)
    monkeypatch.setenv("DXB_DURABLE", "0")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(counts.root / ".config"))
    return Here(counts, capsys)


FIVE = ("--set", "a0.add=5")


@pytest.mark.medium
def test_get_show_and_report_answer_for_the_recipe_as_it_is(here: Here, counts: Space) -> None:
    assert here("build", "g:a0")[0] == 0
    assert here("build", "g:a0", *FIVE)[0] == 0
    assert (here.got(), here.got(*FIVE), here.got("--profile", "cpu")) == (b"3", b"8", b"3")
    assert "option add\t0" in here("show", "g:a0")[1]
    assert "option add\t5" in here("show", "g:a0", *FIVE)[1]
    assert here("report", "g")[1] == "cache/out/g/report.html\n"
    assert here("report", "g", *FIVE)[1].startswith("cache/out/g@a0.add=5-")
    assert here("get", "g:a0", "-o", "got")[2] == ""
    assert Project.find().get("g:a0").data == b"3"
    code, _, err = here("get", "g:a0", "--set", "a0.add=7")
    assert (code, "was never built" in err, "request   a0.add=7-" in err) == (2, True, True)


@pytest.mark.medium
def test_what_was_never_built_as_it_is_is_given_as_it_was_built_last(here: Here) -> None:
    assert here("build", "g:a0", *FIVE)[0] == 0
    told = "`g` as built with a0.add=5; `dxb build g` builds it without\n"
    for words in (("get", "g:a0", "-o", "got"), ("show", "g:a0"), ("show", "g"), ("report", "g")):
        code, _, err = here(*words)
        assert (code, err) == (0, told), words
    assert here.got() == b"8"
    assert Project.find().get("g:a0").data == b"8"


def test_what_needs_an_input_is_not_said_to_be_built_without(here: Here, counts: Space) -> None:
    counts.edit("recipes/g.yaml", "{l: data}", "{l: {help: a number}}")
    assert here("build", "g:a0", "--input", "l=data")[0] == 0
    assert here("show", "g:a0")[2] == "`g` as built with l=data\n"
    assert "hint: `dxb build 'g:a1' --input l=PATH`\n" in here("get", "g:a1")[2]


def test_a_report_of_a_run_says_nothing_of_another(here: Here) -> None:
    assert here("build", "g:a0", "--set", "a0.add=7")[0] == 0
    assert here("build", "g:a0", *FIVE)[0] == 0
    for run in ("0001", "0002"):
        assert here("report", run)[::2] == (0, "")


@pytest.mark.slow
def test_a_failed_build_changes_nothing_that_is_given(here: Here, counts: Space) -> None:
    counts.edit("rules/toy/mul.py", "    return", '    ctx.check(options.add < 9, "too much")\n    return')
    counts.write("recipes/g.yaml", CHAIN)
    assert here("build", "g")[0] == 0
    before = here.got(), here.got(node="g:a1"), here("show", "g:a0")[1], here("show", "g")[1]
    page = here.report()
    assert here("build", "g", "--set", "a1.add=9")[0] == 1
    counts.write("data", "2")
    counts.edit("recipes/g.yaml", "add: 1", "add: 9")
    assert here("build", "g")[0] == 1
    after = here.got(), here.got(node="g:a1"), here("show", "g:a0")[1], here("show", "g")[1]
    assert after == before
    assert here.report() == page
    assert "run 0003 of `g` failed or was stopped; `dxb report 0003` shows it" in here("report", "g")[2]
    counts.edit("recipes/g.yaml", "add: 9", "add: 2")
    assert here("build", "g")[0] == 0
    assert (here.got(), here.got(node="g:a1")) == (b"6", b"20")


@pytest.mark.medium
def test_a_stub_build_changes_nothing_that_is_given_and_is_marked(here: Here, counts: Space) -> None:
    for name, text in SAID.items():
        counts.write(f"rules/toy/{name}.py", text.lstrip())
    counts.write(
        "recipes/g.yaml",
        "inputs: {l: data}\nnodes: {a0: {rule: toy.said, text: $l}, a1: {rule: toy.mul, text: $a0}}\n"
        "targets: {default: [a1]}\n",
    )
    stub, mark = ("--profile", "stub"), "stub backends made 1 of 2 results\n"
    for _ in range(3):  # the last one repeats a snapshot
        assert mark in here("build", "g", *stub)[2]
        time.sleep(0.05)
    code, _, err = here("get", "g:a1", "-o", "got")
    assert (code, "as built with stub" in err, "`g:a1` was made with stub backends: a0" in err) == (0, True, True)
    assert mark not in here("build", "g")[2]
    assert here("build", "g", *stub)[0] == 0
    assert (here.got(node="g:a1"), here.got(*stub, node="g:a1")) == (b"21", b"0")
    assert here("get", "g:a1", "-o", "got")[2] == ""
    assert "a0\t" in (said := here("show", "g", *stub)[1])
    assert "(stub)" in said
    assert "(stub)" not in here("show", "g")[1]
    assert "stub\t" in here("show", "g:a1", *stub)[1]
    assert "stub backends made" not in here.report()


SAID = {
    "said": """
\"\"\"toy.said: a rule with a stub.\"\"\"
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def said(ctx: Context, text: File) -> File:
    \"\"\"Say a number.\"\"\"
    return File(data=ctx.backend.say())
""",
    **{
        f"said_{name}": f"""
\"\"\"Numbers.\"\"\"
from dextera_build.rule import Backend
BACKEND = Backend(summary="a number", profiles=("{profile}",))
def say():
    return b"{number}"
"""
        for name, profile, number in (("stub", "stub", 0), ("real", "cpu", 7))
    },
}
CHAIN = """
inputs: {l: data}
nodes:
  a0: {rule: toy.mul, text: $l}
  a1: {rule: toy.mul, text: $a0, add: 1}
targets: {default: [a1]}
"""
