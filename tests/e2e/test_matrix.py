"""Parameter sweeps through the real `dxb`."""

from __future__ import annotations

import pytest

SWEEP = """nodes:
  start: {rule: toy.start, text: a}
  sweep:
    matrix: {times: [1, 2]}
    nodes:
      loud: {rule: toy.shout, text: $start, times: $matrix.times}
      louder: {rule: toy.shout, text: $loud}
  all: {rule: toy.join, texts: $sweep.louder}
targets: {default: [all]}
"""


@pytest.fixture
def built(space):
    space.write("recipes/say/sweep.yaml", SWEEP)
    assert space.build("say/sweep").code == 0
    return space


def test_a_sweep_is_a_collection(built):
    assert (built.root / "cache/out/say/sweep/all/all").read_bytes() == b"A!! A!!!"


def test_another_value_builds_its_copy_alone(built):
    built.edit("recipes/say/sweep.yaml", "[1, 2]", "[3, 2]")
    answer = built.build("say/sweep")
    assert answer.nodes("ran") == {"sweep[times=3].loud", "sweep[times=3].louder", "all"}


@pytest.mark.slow
def test_copies_have_addresses_everywhere(built):
    assert built.build("say/sweep:sweep[times=2].loud").nodes("cached") == {"start", "sweep[times=2].loud"}
    (path,) = built.dxb("get", "say/sweep:sweep[times=2].loud", "-o", "there").out.split()
    assert (built.root / path).read_bytes() == b"A!!"
    assert built.dxb("why", "say/sweep:sweep[times=2].loud").out.startswith("up to date")
    rows = {row["node"] for row in built.dxb("plan", "--json", "say/sweep").rows}
    assert rows == {"start", "all", *(f"sweep[times={n}].{name}" for name in ("loud", "louder") for n in (1, 2))}
    assert built.build("say/sweep", "--force", "sweep[times=1].loud").nodes("ran") == {"sweep[times=1].loud"}
    answer = built.build("say/sweep", "--set", "sweep[times=2].louder.times=4")
    assert answer.nodes("ran") == {"sweep[times=2].louder", "all"}
    answer = built.dxb("build", "say/sweep:sweep[times=5].loud")
    assert answer.code == 2  # before anything ran
    assert "error[DXB-U203]: `sweep[times=5].loud`: there is no `times=5` in `sweep`" in answer.err
    assert "copies   times=1, times=2" in answer.err


def test_a_plan_knows_the_copies_before_anything_ran(space):
    space.write("recipes/say/sweep.yaml", SWEEP)
    rows = {row["node"]: row["status"] for row in space.dxb("plan", "--json", "say/sweep").rows}
    assert rows["sweep[times=1].loud"] == "unknown"
    assert rows["start"] == "stale"


def test_why_names_the_value_in_the_list(built):
    built.edit("recipes/say/sweep.yaml", "nodes:\n  start", "nodes:\n  more: {rule: toy.start}\n  start")
    built.edit("recipes/say/sweep.yaml", "times: $matrix.times}", "times: $matrix.times, salt: x}")
    answer = built.dxb("why", "say/sweep:sweep[times=2].loud")
    assert '  salt\tsalt\t"" -> x\t' in answer.out
    built.edit("recipes/say/sweep.yaml", "times: $matrix.times, salt: x", "times: 9")
    answer = built.dxb("why", "say/sweep:all")
    assert "waits for\tsweep[times=1].louder and 1 more copy" in answer.out
    assert "option\ttimes\t" in answer.out


def test_a_lock_pins_every_copy(built):
    assert built.dxb("build", "--lock", "say/sweep:sweep.loud").code == 0
    assert '[cpu."say/sweep:sweep[times=1].loud"]' in (built.root / "dxb.lock").read_text()
    assert built.dxb("build", "--locked", "say/sweep:sweep.loud").code == 0


def test_a_setting_for_a_copy_that_does_not_exist_is_no_build(space):
    wrong = ("say/words", "--set", "word[oen].loud.times=4")
    answer = space.build(*wrong)
    assert answer.code == 1
    assert answer.nodes("ran") == {"start", "words"}  # only now the copies are known
    answer = space.dxb("build", *wrong)
    assert (answer.code, answer.out) == (2, "")  # before anything ran
    assert "error[DXB-U203]: `word[oen].loud.times=4`: there is no `oen` in `word`" in answer.err
    assert "hint: did you mean `one`?" in answer.err
