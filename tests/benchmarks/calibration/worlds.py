"""Markers, ICP and `align.robot_camera` in a reference world: `python -m tests.benchmarks.calibration.worlds 100 20`.

Draws number 100 to 119. Ten pictures each, of 640 x 360 pixels, of the KUKA with the LEAP Hand in
`reference/laptop_scene`: rendered markers with noise, an arm whose surface is 2 % larger than its model, encoders with
a wrong zero (0.1 deg) and noise (0.02 deg), depth noise of a stereo camera. Errors of T_camera_base, and of the palm:
where joints and calibration put it against where it is.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np
import yaml
from scipy.stats import chi2

from dextera_build.artifacts.cameras.calibration import Calibration
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.geometry import transforms
from dextera_build.sim.model import forward
from dextera_build.sim.worlds.posed import biased
from dextera_build.testing import RuleRunner
from tests.geometry.hand_eyes import error_of

RECIPES = Path(__file__).parents[3] / "recipes"
METHODS: dict[str, dict[str, bool]] = {
    "plain ICP": {"balanced": False},
    "balanced ICP": {"exact_model": True},
    "align.robot_camera": {},
}
"""Name -> options of `align.robot_camera`, from the markers."""
ERRORS = {"arm_shape": 0.02, "zero_sigma_deg": 0.1, "encoder_sigma_deg": 0.02}


def options(recipe: str, node: str) -> dict[str, object]:
    """The options of a node of a recipe."""
    found = dict(yaml.safe_load((RECIPES / recipe).read_text())["nodes"][node])
    found.pop("rule")
    return found


def half(world: World) -> World:
    """The world with a camera of half the resolution."""
    return world.model_copy(update={"camera": world.camera.scaled(0.5)})


def off(world: World, found: Calibration, hands: tuple[np.ndarray, np.ndarray]) -> tuple[float, float, float, float]:
    """Error of the camera [mm, deg], of the palm [mm], and the error squared in units of the stated covariance."""
    assert world.stand is not None
    truth = np.asarray(transforms.invert(world.stand.pose().matrix) @ world.camera_pose.matrix)
    error = error_of(found.pose.matrix, truth)
    stated, real = hands
    ours = transforms.apply(transforms.invert(found.pose.matrix), stated)
    palm = np.linalg.norm(ours - transforms.apply(transforms.invert(truth), real), axis=1).mean()
    far = float(error @ np.linalg.solve(found.pose.covariance, error))
    return (
        1000 * float(np.linalg.norm(error[:3])),
        float(np.degrees(np.linalg.norm(error[3:]))),
        1000 * float(palm),
        far,
    )


def run(seed: int, world: World, robot: RobotModel) -> dict[str, tuple[float, float, float, float]]:
    """Method -> errors."""
    runner = RuleRunner(tempfile.mkdtemp())
    how = {"count": 10, "seed": seed, "errors": ERRORS}
    # Where the joints really are; the capture's own have the encoders' errors.
    exact = runner.run("reference.postures", world=world, robot=robot, options=how)
    noisy = runner.run("reference.robot_views", world=world, robot=robot, postures=exact, options=how)
    made = biased(robot, ERRORS["arm_shape"], 0.0)
    names = [joint.name for joint in robot.joints]
    stated, real = (
        forward.frames(each, names, positions, "palm")[:, :3, 3]
        for each, positions in ((robot, noisy.joints.positions), (made, exact.positions))
    )
    zero = {"joint_sigma_deg": ERRORS["zero_sigma_deg"]}
    found = {"markers": runner.run("align.hand_eye", views=noisy, robot=robot, options=zero)}
    for name, chosen in METHODS.items():
        found[name] = runner.run(
            "align.robot_camera", views=noisy, robot=robot, calibration=found["markers"], options={**chosen, **zero}
        )
    return {name: off(world, each, (stated, real)) for name, each in found.items()}


if __name__ == "__main__":
    first, count = (int(each) for each in sys.argv[1:3])
    runner = RuleRunner(tempfile.mkdtemp())
    world = half(runner.run("reference.world", options=options("reference/laptop_scene.yaml", "world")))
    robot = runner.run("simulate.robot", options=options("robot/kuka_leap.yaml", "robot"))
    rows: dict[str, list[tuple[float, float, float, float]]] = {}
    for seed in range(first, first + count):
        for name, errors in run(seed, world, robot).items():
            rows.setdefault(name, []).append(errors)
        print(seed, {name: np.round(each[-1], 2).tolist() for name, each in rows.items()}, flush=True)
    print(
        "| method | camera | rotation | palm, median | palm, worst | in 95 % |\n| --- | --- | --- | --- | --- | --- |"
    )
    for name, each in rows.items():
        table = np.array(each)
        place, angle, palm, _ = np.median(table, axis=0)
        inside = (table[:, 3] < chi2.ppf(0.95, 6)).mean()
        print(
            f"| {name} | {place:.1f} mm | {angle:.2f} deg | {palm:.2f} mm | {table[:, 2].max():.1f} mm | {inside:.2f} |"
        )
