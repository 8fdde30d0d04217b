"""A key that gives another output when it runs again: what `dxb check` allows, what stays, and where it is written."""

from __future__ import annotations

from pathlib import Path

import pytest

DICE = '''
"""toy.dice: numbers that shake by as much as a file beside the project says."""
from pathlib import Path
from typing import Annotated
import math
import numpy as np
from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.rule import Context, Tolerance, rule

SHAKE = Path(__file__).parents[2] / "shake.txt"

class Numbers(Artifact):
    """Numbers."""
    numbers: Annotated[np.ndarray, Array("N", "float64", unit="m")]
    word: str = "x"
    pose: Pose

@rule(version=1, TOLERANCE)
def dice(ctx: Context) -> Numbers:
    """Return numbers."""
    shake = float(SHAKE.read_text())
    ctx.metric("mean", 1.0 + shake)
    turned, sine, cosine = np.eye(4), math.sin(TURN * shake), math.cos(TURN * shake)
    turned[:2, :2] = [[cosine, -sine], [sine, cosine]]
    numbers = np.array([1.0, 2.0 + (1 - TURN) * shake] + [0.0] * (shake > 5))
    return Numbers(numbers=numbers, word="y" if shake > 1 else "x", pose=Pose(parent="a", child="b", matrix=turned))
'''


@pytest.fixture
def dice(space):
    def make(tolerance="", *, turns=0):
        text = DICE.lstrip().replace(", TOLERANCE", tolerance).replace("TURN", str(turns))
        space.write("rules/toy/dice.py", text)
        space.write("recipes/say/dice.yaml", "nodes: {d: {rule: toy.dice}}")
        space.write("shake.txt", "0")
        assert space.build("say/dice").code == 0
        return space

    return make


def divergent(space):
    return space.dxb("ls", "--json", "divergent").rows


@pytest.mark.medium
def test_an_exact_rule_allows_nothing(dice):
    space = dice()
    assert "same output again" in space.dxb("check", "say/dice:d").out
    assert divergent(space) == []
    space.write("shake.txt", "1e-9")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 1
    assert "error[DXB-B402]: `say/dice:d` is not deterministic: rebuilding it gave another output" in answer.err
    assert "numbers   1e-09 apart, 0 allowed" in answer.err
    (row,) = divergent(space)
    assert row["node"] == "say/dice:d"
    why = space.dxb("why", "say/dice:d").out
    assert f"a later run gave another output, {row['again'][0][:12]} for {row['first'][:12]}" in why


def test_a_tolerance_is_by_field_and_metric(dice):
    space = dice(', tolerance=Tolerance({"numbers": 1e-6}, metrics={"mean": 1e-7})')
    space.write("shake.txt", "1e-8")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 0
    assert "same within the tolerance of its rule: numbers 1e-08 apart, 1e-06 allowed; metric mean " in answer.out
    assert len(divergent(space)) == 1  # other bytes all the same
    space.write("shake.txt", "5e-7")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 1
    assert "numbers       5e-07 apart, 1e-06 allowed" in answer.err
    assert "metric mean   5e-07 apart, 1e-07 allowed" in answer.err
    assert len(divergent(space)[0]["again"]) == 2


def test_what_is_no_number_is_exact_whatever_the_tolerance(dice):
    space = dice(', tolerance=Tolerance({"numbers": 10.0, "word": 10.0})')
    space.write("shake.txt", "2")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 1
    assert "word      another form or value, 10 allowed" in answer.err


@pytest.mark.medium
def test_a_tolerance_holds_for_all_fields_inside_and_an_infinite_one_compares_nothing(dice):
    space = dice(', tolerance=Tolerance({"": 0.5, "numbers": math.inf, "word": math.inf})')
    space.write("shake.txt", "6")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 0
    assert "numbers another form or value, not compared; word another form or value, not compared" in answer.out
    space = dice(', tolerance=Tolerance({"": 0.5})', turns=1)
    space.write("shake.txt", "0.4")
    assert "pose.matrix 0.389 apart, 0.5 allowed" in space.dxb("check", "say/dice:d").out


def test_a_pose_that_only_turned_is_another_one(dice):
    space = dice(turns=1)
    space.write("shake.txt", "0.1")
    answer = space.dxb("check", "say/dice:d")
    assert answer.code == 1
    assert "pose.matrix   0.0998 apart, 0 allowed" in answer.err


HEAD = """
from typing import Annotated
import numpy as np
from dextera_build.artifacts.base import Array, Artifact
from dextera_build.rule import Context, Tolerance, rule

class Numbers(Artifact):
    numbers: Annotated[np.ndarray, Array("N", "float64")]
"""


@pytest.mark.medium
def test_it_runs_as_in_a_build_whatever_the_environment_of_the_command(space):
    code = """
import os
@rule(version=1)
def threads(ctx: Context) -> Numbers:
    return Numbers(numbers=np.array([float(os.environ["OMP_NUM_THREADS"])]))
"""
    space.write("rules/toy/threads.py", HEAD + code)
    space.write("recipes/say/threads.yaml", "nodes: {d: {rule: toy.threads}}")
    assert space.build("say/threads").code == 0
    assert "same output again" in space.dxb("check", "say/threads:d", env={"OMP_NUM_THREADS": "7"}).out


@pytest.mark.medium
@pytest.mark.skipif(" fma " not in Path("/proc/cpuinfo").read_text(), reason="needs a processor with FMA to do without")
@pytest.mark.parametrize(("tolerance", "code"), [("1e-12", 0), ("1e-16", 1)])
def test_a_result_of_another_machine_is_compared_within_the_tolerance(space, tolerance, code):
    """A product of matrices whose sums are rounded otherwise by a processor without fused multiply-add."""
    text = """
@rule(version=1, tolerance=Tolerance({"numbers": ALLOWED}))
def product(ctx: Context) -> Numbers:
    matrix = np.sin(np.arange(64.0 * 64).reshape(64, 64))
    return Numbers(numbers=(matrix @ matrix)[0])
"""
    space.write("rules/toy/product.py", HEAD + text.replace("ALLOWED", tolerance))
    space.write("recipes/say/product.yaml", "nodes: {d: {rule: toy.product}}")
    other = {"OPENBLAS_CORETYPE": "Nehalem"}
    assert space.dxb("build", "say/product", env=other).code == 0
    assert "same output again" in space.dxb("check", "say/product:d", env=other).out
    answer = space.dxb("check", "say/product:d")
    assert answer.code == code
    assert f"apart, {tolerance} allowed" in answer.out + answer.err


@pytest.mark.medium
def test_a_forced_node_keeps_its_first_output_and_says_so(dice):
    space = dice()
    first = space.dxb("show", "--json", "say/dice:d").document["output"]
    space.write("shake.txt", "0.5")
    forced = space.build("say/dice", "--force", "d")
    assert forced.code == 0
    assert forced.nodes("ran") == {"d"}
    assert any("gave another output before, which is kept" in event.get("text", "") for event in forced.events)
    assert space.dxb("show", "--json", "say/dice:d").document["output"] == first
    (row,) = divergent(space)
    assert row["first"] == first
    space.write("shake.txt", "0")
    assert space.build("say/dice", "--force", "d").code == 0  # the first one again
    assert divergent(space) == [row]
    assert f"dxb diff {row['first'][:12]}" not in space.dxb("why", "say/dice:d").err
    report = (space.root / space.dxb("report").out.strip()).read_text()
    assert "a later run gave" in report
    assert row["again"][0][:12] in report
    found = space.dxb("diff", row["first"], row["again"][0]).out
    assert found == "output\tnumbers\tfloat64 (2): 1 of 2 differ, by 0.5 at most\n"
