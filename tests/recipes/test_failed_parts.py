"""A twin of which a body, an export or a check fails: the scene is built, and what is missing is named."""

from __future__ import annotations

from pathlib import Path

import mujoco
import pytest

from tests.e2e.space import Answer, Space

pytestmark = pytest.mark.slow

CAPTURE = Path(__file__).parent / "captures" / "second_table"
FAILS = '''"""A backend that always fails."""
from dextera_build.rule import Backend, Context

BACKEND = Backend(summary="fails", profiles=())

def {function}(ctx: Context, *given: object) -> None:
    """Fail."""
    ctx.fail("planted in {function}")
'''
BOXES = '''"""A backend for boxes alone."""
from dextera_build.artifacts.objects.object import Collision, Link, Pieces
from dextera_build.rule import Backend, Context, Options

BACKEND = Backend(summary="the walls of boxes", profiles=())

def pieces(ctx: Context, link: Link, hollow: bool, common: object, options: Options) -> Pieces:
    """The walls of a box."""
    ctx.check(all(len(wall.vertices) == 8 for wall in link.walls), "planted: this is no box")
    return Pieces(hulls=link.walls, method="walls")

def picture(ctx: Context, collision: Collision, options: Options) -> None:
    """Draw nothing."""
'''
EXPORTS = {"simulate.usd": "write", "simulate.settle": "let_go", "evaluate.overlay": "render"}
"""Rule -> the function of its backend."""


@pytest.fixture(scope="module")
def space(tmp_path_factory: pytest.TempPathFactory) -> Space:
    made = Space(tmp_path_factory.mktemp("project"))
    made.write("dxb.toml", 'cache = "cache"\n')
    made.write("rules/factorize/collision_broken.py", BOXES)
    for rule, function in EXPORTS.items():
        made.write(f"rules/{rule.replace('.', '/')}_broken.py", FAILS.format(function=function))
    return made


def built(space: Space, *rules: str) -> tuple[Answer, dict[str, Path], str]:
    """The answer of a build with the broken backends of `rules`, target -> its file, and the report."""
    asked = ["--input", f"capture={CAPTURE}", *(word for rule in rules for word in ("--backend", f"{rule}=broken"))]
    answer = space.dxb("build", "twin/tabletop", "--console", "plain", *asked)
    page = space.dxb("report", "twin/tabletop", *asked, "-o", "page.html")
    assert page.code == 0, page.err
    files = {name: space.root / path for name, path in (line.split("\t") for line in answer.out.splitlines())}
    return answer, files, (space.root / "page.html").read_text()


def free_bodies(scene: Path) -> set[str]:
    """Names of the bodies of a scene that stock MuJoCo loads and that may move."""
    model = mujoco.MjModel.from_xml_path(str(scene))
    return {model.body(body).name for body in model.jnt_bodyid[model.jnt_type == mujoco.mjtJoint.mjJNT_FREE]}


def test_a_body_that_fails_does_not_cost_the_scene(space: Space) -> None:
    answer, files, page = built(space, "factorize.collision")
    assert answer.code == 1
    assert free_bodies(files["scene"]) == {"red_box"}
    assert {"usd", "settle", "overlay", "body[red_box].urdf"} <= files.keys()
    assert "body[blue_can].urdf" not in files
    assert all(path.exists() for path in files.values())
    for told in (answer.err, page):
        assert "body[blue_can].collision" in told
        assert "planted: this is no box" in told


def test_exports_and_checks_that_fail_do_not_cost_the_scene(space: Space) -> None:
    answer, files, page = built(space, *EXPORTS)
    assert answer.code == 1
    assert free_bodies(files["scene"]) == {"blue_can", "red_box"}
    assert files.keys() == {"scene", "body[blue_can].urdf", "body[red_box].urdf"}
    assert all(path.exists() for path in files.values())
    for told in (answer.err, page):
        for function in EXPORTS.values():
            assert f"planted in {function}" in told
