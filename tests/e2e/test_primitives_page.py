"""The page about task primitives: its files add one to a project, and nothing else becomes stale."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import dextera_build
from dextera_build import api
from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RecipeError, RuleError
from dextera_build.project.project import Project
from dextera_build.recipe.plan import Plan, Request, plan
from dextera_build.recipe.profiles import Profile
from dextera_build.running import called
from dextera_build.sim.experts import candidates, planning, rehearse
from dextera_build.sim.primitives import catalogue
from dextera_build.testing import RuleRunner
from tests import episodes, factories
from tests.e2e.space import Space
from tests.robots import robot_recipes

PAGE = (Path(dextera_build.__file__).parent / "docs" / "primitives.md").read_text()
PLACES = "task/kl/place_coconut_water_in_basket"
"""The task that the page's recipe extends."""
POUR = {"name": "Pour", "primitive": "pour", "object": "cup", "pour": {"into": "bowl"}, "timeout_s": 12.0}


def blocks(kind: str) -> list[str]:
    return re.findall(rf"^```{kind}\n(.*?)^```", PAGE, re.DOTALL | re.MULTILINE)


@pytest.fixture
def space(tmp_path: Path) -> Space:
    made = Space(tmp_path)
    made.write("dxb.toml", "")
    return made


def add_pour(space: Space) -> None:
    """Write the files of the page."""
    space.write("rules/primitives/pour/primitive.py", blocks("python")[0])
    space.write("rules/primitives/pour/script.py", blocks("python")[1])
    space.write("recipes/task/pour.yaml", blocks("yaml")[0])


def planned(space: Space, address: str) -> Plan:
    project = Project(space.root)
    return plan(address, project.recipe, project.library, project.root, Request(Profile("stub", {})))


def stale(before: Plan, after: Plan) -> set[str]:
    """Calls of which the key holds something else."""
    old = {path: (call.rule, call.options, call.inputs) for path, call in before.graph.calls()}
    new = {path: (call.rule, call.options, call.inputs) for path, call in after.graph.calls()}
    return {".".join(path) for path in old.keys() | new.keys() if old.get(path) != new.get(path)}


@pytest.mark.slow
def test_adding_and_editing_a_primitive_makes_its_own_nodes_stale_alone(space: Space) -> None:
    first = planned(space, PLACES)
    add_pour(space)
    assert stale(first, planned(space, PLACES)) == set()
    added = planned(space, "task/pour")
    own = {"task", "attempts", "expert", "operated", "poured", "sources", "made.episodes"}
    assert stale(first, added) == own
    space.edit("rules/primitives/pour/primitive.py", "1.0 + tilted", "1.0 + 2.0 * tilted")
    judged = planned(space, "task/pour")
    assert stale(added, judged) == own
    space.edit("rules/primitives/pour/script.py", "RAISED_M = 0.15", "RAISED_M = 0.2")
    assert stale(judged, planned(space, "task/pour")) == {"attempts", "operated", "poured", "sources"}
    # A folder of the same name takes the place of one that comes with dxb, also if it appears later.
    space.write("rules/primitives/pick_and_place/primitive.py", blocks("python")[0])
    space.write("rules/primitives/pick_and_place/script.py", blocks("python")[1])
    with pytest.raises(RecipeError, match=r"needs the option `pick_and_place\.into`"):
        planned(space, "task/ob/stack_bowls")
    assert str(space.root / "rules/primitives/pick_and_place") in _looked_at(space)


def _looked_at(space: Space) -> set[str]:
    project = Project(space.root)
    plan(PLACES, project.recipe, project.library, project.root, Request(Profile("stub", {})))
    return project.library.looked_at()


@pytest.mark.medium
@pytest.mark.parametrize(
    ("old", "new", "message", "hint"),
    [
        ("pour: {into", "into: basket\n    pour: {into", "has no input or option `into`", "`pour: {into: ...}`"),
        ("pour: {into", "lift: {height_m: 0.1}\n    pour: {into", "no input or option `lift`", "`primitive: lift`"),
        ("pour: {into: basket}", "pour: {into: basket, tilt: 9}", "has no option `tilt`", "did you mean `tilt_deg`?"),
        ("pour: {into: basket}", "pour: basket", "`pour` of `simulate.task` is a mapping of options", ""),
        ("primitive: pour", "primitive: puor", "no primitive is called `puor`", "did you mean `pour`?"),
        ("    pour: {into: basket}\n", "", "`simulate.task` needs the option `pour.into`", ""),
    ],
)
def test_what_does_not_fit_is_one_clear_error(space: Space, old: str, new: str, message: str, hint: str) -> None:
    add_pour(space)
    space.edit("recipes/task/pour.yaml", old, new)
    with pytest.raises(RecipeError) as caught:
        planned(space, "task/pour")
    assert message in caught.value.message
    assert "pour.yaml" in str(caught.value.where)
    assert hint in (caught.value.hint or "")


@pytest.mark.medium
def test_a_primitive_without_a_script_is_one_clear_error(space: Space) -> None:
    add_pour(space)
    (space.root / "rules/primitives/pour/script.py").unlink()
    with pytest.raises(RecipeError, match=r"which has no `script\.py` in `primitives/pour`") as caught:
        planned(space, "task/pour")
    assert caught.value.code == "DXB-R216"


def test_a_rule_that_does_not_declare_the_primitive_cannot_play_it(space: Space, tmp_path: Path) -> None:
    bundle = episodes.bundle()
    space.write("rules/mine/judge.py", JUDGE.format(runs=""))
    with pytest.raises(RuleError, match=r"`primitive\.py` of primitive `lift` is not in the key") as caught:
        RuleRunner(tmp_path, space.root).run("mine.judge", bundle=bundle)
    assert caught.value.code == "DXB-B386"
    space.write("rules/mine/judge.py", JUDGE.format(runs=', runs={"bundle": "primitive"}'))
    assert RuleRunner(tmp_path, space.root).run("mine.judge", bundle=bundle).data == b"LiftGoal"


def test_what_shows_a_task_finds_the_primitives_of_its_project(space: Space) -> None:
    add_pour(space)
    with called.shown(Project(space.root).library):
        assert [catalogue.kind(name).goal_type.__name__ for name in ("pour", "lift")] == ["PourGoal", "LiftGoal"]
    with pytest.raises(RuleError, match="no primitive of dxb is called `pour`"):
        catalogue.kind("pour")


JUDGE = '''"""mine.judge: the type of a task's goal."""

from dextera_build.artifacts.base import File
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.rule import Context, rule
from dextera_build.sim.primitives import catalogue


@rule(version=1{runs})
def judge(ctx: Context, bundle: TaskBundle) -> File:
    """Return its name."""
    return File(data=type(catalogue.of(bundle.task).goal).__name__.encode())
'''


@pytest.mark.slow
def test_the_script_of_the_page_pours_in_mujoco(space: Space, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With few candidates: a task, its rehearsal and a demonstration."""
    add_pour(space)
    rehearse_few(monkeypatch)
    runner = RuleRunner(tmp_path / "scratch", space.root)
    bundle = pour_task(runner, tmp_path)
    assert (bundle.task.primitive, bundle.task.goal.names) == ("pour", ("tilt",))
    made = runner.run("demonstrate.operate", bundle=bundle, options={"attempts": 2})
    assert made.items, [each.reason for each in made.failures.values()]
    shown = next(iter(made.items.values()))
    assert shown.segments[-1].name == "tilt"
    # The reward of the page rises with it, and its judge is the one that the trials use.
    table = runner.run("evaluate.expert", bundle=bundle, episodes=made)
    returns = {column.name: value for column, value in zip(table.columns, table.rows[0], strict=True)}
    assert float(returns["return"]) > float(returns["random return"])


@pytest.mark.slow
def test_the_recipe_for_a_stub_twin_lets_an_operator_act_in_mujoco(
    space: Space, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    space.write("recipes/task/try.yaml", blocks("yaml")[1])
    project = api.Project.find(space.root, cache=str(tmp_path / "store"))
    built = project.build("task/try", "task", profile="stub", backends={"simulate.task": "mujoco"})
    assert built.ok, built.errors
    rehearse_few(monkeypatch, 24)
    runner = RuleRunner(tmp_path / "scratch", space.root)
    made = runner.run("demonstrate.operate", bundle=built.artifact("task"), options={"attempts": 2})
    assert made.items, [each.reason for each in made.failures.values()]


def rehearse_few(monkeypatch: pytest.MonkeyPatch, few: int = 6) -> None:
    """Search and rehearse few candidates."""
    for module, name, value in ((planning, "PLANNED", 0), (candidates, "LOOKED", 0), (candidates, "FEW", few)):
        monkeypatch.setattr(module, name, value)
    for name, value in (("GOOD", 1), ("FINAL", 1), ("STARTS", 1)):
        monkeypatch.setattr(rehearse, name, value)


def pour_task(runner: RuleRunner, tmp_path: Path) -> TaskBundle:
    """A cup and a bowl in front of an iiwa with a LEAP Hand."""
    assets = Collection[Asset](
        items={
            "cup": factories.box_asset(factories.pose(0.0, -0.12), size=(0.06, 0.06, 0.10), mass=0.2),
            "bowl": factories.bowl_asset(factories.pose(0.05, 0.12), radius=0.09, height=0.06),
        }
    )
    scene = runner.run(
        "simulate.scene",
        assets=assets,
        background=factories.background(0.8),
        support=factories.support(0.8),
        camera=factories.camera(),
    )
    robot = robot_recipes.built("kuka_leap", tmp_path / "robot")
    base = factories.placed(factories.pose(-0.55, 0.0, 0.0), "base")
    reset = {"position_m": 0.01, "yaw_deg": 5.0, "dynamics": 0.2}
    made: TaskBundle = runner.run(
        "simulate.task", scene=scene, assets=assets, robot=robot, base=base, options={**POUR, "reset": reset}
    )
    assert np.isfinite(made.objects["bowl"].cavity.rim_m).all()  # type: ignore[union-attr]
    return made


@pytest.mark.slow
def test_the_commands_of_the_page_run_and_only_what_was_added_runs(space: Space) -> None:
    before = space.build(PLACES, "--profile", "stub")
    assert before.code == 0, before.err[-3000:]
    add_pour(space)
    assert space.dxb("plan", "--check", PLACES, "--profile", "stub").code == 0
    commands = [line[2:] for block in blocks("console") for line in block.splitlines() if line.startswith("$ ")]
    assert any(command.startswith("dxb build") for command in commands)
    for command in commands:
        words = shlex.split(command)[1:]
        done = space.build(*words[1:]) if words[0] == "build" else space.dxb(*words)
        assert done.code == 0, done.err[-3000:]
        if words[0] == "build":
            assert done.nodes("ran") == {"task", "poured"}
    space.edit("rules/primitives/pour/script.py", "RAISED_M = 0.15", "RAISED_M = 0.2")
    why = space.dxb("why", "task/pour:poured", "--profile", "stub")
    assert "`RAISED_M` of rules+2/primitives/pour/script.py" in why.out, why.out
    assert space.build("task/pour", "--profile", "stub").nodes("ran") == {"poured"}
