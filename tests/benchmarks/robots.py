"""Robots of `dxb new robot` at a table: `python -m tests.benchmarks.robots PROJECT [NAME ...]` prints rows of a table.

The recipes of the project below `recipes/robot` are built as they were written, without a change of any guess. A cube
of 40 mm lies below the palm's home on a table. A robot with a gripper lifts it by 80 mm, any other pushes it by 80 mm;
the scripted operator plans, rehearses, and attempts the task a few times from drawn starts.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import time

import mujoco
import numpy as np

from dextera_build import Project
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import DxbError
from dextera_build.geometry import transforms
from dextera_build.sim.model.robot import load
from dextera_build.sim.primitives.lift.primitive import LiftGoal
from dextera_build.sim.primitives.poses import Tolerance
from dextera_build.sim.primitives.push.primitive import PushGoal
from dextera_build.testing import RuleRunner
from tests import factories
from tests.openarm_tasks import bundle

COLUMNS = ("robot", "joints", "built [s]", "task", "done", "operator [s]", "or why not")
EDGE_M, MASS_KG, FAR_M = 0.04, 0.06, 0.08
TALL_M = 0.5
"""Height of the palm's home above the base, from which on a robot stands on the floor, in front of the table [m]."""
ABOVE_M = 0.25
"""Height of the palm's home above the table of such a robot [m]."""
MARGIN_M = 0.12
"""Distance of the cube from the table's edge for such a robot [m]."""


def palm(robot: RobotModel, limb: str) -> np.ndarray:
    """T_base_palm (4, 4) at home."""
    model = load(robot.model).compile()
    data = mujoco.MjData(model)
    for name, position in robot.followed(robot.home).items():
        data.joint(name).qpos[0] = position
    mujoco.mj_kinematics(model, data)
    site = data.site(robot.frames[robot.limbs[limb].palm])
    base = transforms.rigid(data.body("base").xmat.reshape(3, 3), data.body("base").xpos)
    return transforms.invert(base) @ transforms.rigid(site.xmat.reshape(3, 3), site.xpos)


def task(robot: RobotModel, limb: str, primitive: str) -> TaskBundle:
    """The cube below the palm's home, to be lifted or pushed away from the base."""
    home = palm(robot, limb)
    tall = home[2, 3] > TALL_M
    place = np.array([0.0, -(0.5 - MARGIN_M) if tall else 0.0, 0.0])
    base = factories.pose(0.0, 0.0, -(home[2, 3] - ABOVE_M) if tall else 0.0, np.pi / 2)
    base[:2, 3] = place[:2] - base[:2, :2] @ home[:2, 3]
    cube = factories.box_asset(transforms.rigid(np.eye(3), place), (EDGE_M,) * 3, MASS_KG, friction=0.8)
    target = (float(place[0]), float(place[1] + FAR_M))
    goal = LiftGoal(height_m=FAR_M)
    if primitive == "push":
        loose = Tolerance(position_m=0.02, rotation_rad=np.pi)
        goal = PushGoal(place_m=target, yaw_rad=None, upright=(1.0, 0.0, 0.0, 0.0), tolerance=loose)
    return bundle(robot, goal, {"cube": cube}, "cube", base=base, limbs=(limb,))


def attempted(robot: RobotModel, primitive: str, attempts: int) -> tuple[str, str]:
    """Successes of all attempts, and the operator's reason for none."""
    limb = robot.limb_names[-1]
    if not robot.limbs[limb].arm:
        return "-", "a hand alone: no arm moves it"
    with tempfile.TemporaryDirectory() as folder:
        try:
            options = {"attempts": attempts}
            made = RuleRunner(folder).run(
                "demonstrate.operate", backend="mujoco", bundle=task(robot, limb, primitive), options=options
            )
        except DxbError as error:
            facts = "; ".join(f"{name}: {text}" for name, text in error.facts.items())
            return "0", f"{error.message} ({facts})" if facts else error.message
    why = next((str(each.failure) for each in made.failures.values()), "") if not made.items else ""
    return f"{len(made.items)} of {made.attempts}", why


def row(project: Project, name: str, attempts: int) -> tuple[str, ...]:
    """One robot."""
    began = time.monotonic()
    result = project.build(f"robot/{name}")
    if not result.ok:
        return (name, "-", "no", "-", "-", "-", "; ".join(error.message for error in result.errors.values()))
    robot = result.artifact("robot")
    assert isinstance(robot, RobotModel)
    built = time.monotonic() - began
    limb = robot.limbs[robot.limb_names[-1]]
    rows = []
    for primitive in ("lift", "push") if limb.gripper else ("push",):
        began = time.monotonic()
        done, why = attempted(robot, primitive, attempts)
        rows.append((primitive, done, f"{time.monotonic() - began:.0f}", why))
        if done[0] not in "0-":
            break
    tasks = [", ".join(each) for each in zip(*rows, strict=True)]
    return (name, str(len(robot.joints)), f"{built:.0f}", *tasks)


def main() -> None:
    """Print the rows; each robot in a process of its own, so that one that takes too long ends alone."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("project")
    parser.add_argument("names", nargs="*")
    parser.add_argument("--attempts", type=int, default=3)
    parser.add_argument("--most-s", type=float, default=400.0, help="time for one robot")
    parser.add_argument("--here", action="store_true", help="in this process")
    args = parser.parse_args()
    project = Project.find(args.project)
    names = args.names or sorted(each.stem for each in (project.root / "recipes" / "robot").glob("*.yaml"))
    for name in names:
        if args.here:
            print(f"| {' | '.join(row(project, name, args.attempts))} |", flush=True)
            continue
        words = [
            sys.executable,
            "-m",
            "tests.benchmarks.robots",
            args.project,
            name,
            "--here",
            "--attempts",
            str(args.attempts),
        ]
        try:
            print(subprocess.run(words, capture_output=True, text=True, timeout=args.most_s).stdout.strip() or name)
        except subprocess.TimeoutExpired:
            print(f"| {name} | | | | - | > {args.most_s:.0f} | took too long |")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
