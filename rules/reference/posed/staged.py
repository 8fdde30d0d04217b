"""A world whose robot holds a board, and postures in which the camera sees it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.cameras.calibration import Board
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.world import World
from dextera_build.geometry import transforms
from dextera_build.rule import Context
from dextera_build.sim.worlds import posed as worlds

from . import plate

if TYPE_CHECKING:
    from .postures import PlateOptions, PosturesOptions

HAND_PIXELS = 600
"""Minimum number of visible pixels of the hand."""


def stage(ctx: Context, world: World, robot: RobotModel, board: Board, common: PosturesOptions) -> worlds.PosedWorld:
    """The world with the robot including its errors, and the board on it."""
    if common.board.frame not in robot.frames:
        ctx.fail(f"the robot has no frame `{common.board.frame}`", frames=", ".join(robot.frames))
    made = worlds.biased(robot, common.errors.arm_shape, common.errors.arm_length)
    pixels, frame = plate.texture(board), common.board.frame
    held = worlds.Plate(plate.part(board, pixels), plate.corners(board), frame, _pose(ctx, common.board))
    return worlds.PosedWorld(world, made, held)


def chosen(
    ctx: Context, stage: worlds.PosedWorld, world: World, robot: RobotModel, common: PosturesOptions
) -> np.ndarray:
    """Joint positions (K, J) [rad], in the order of the robot's joints, of postures with board and hand visible."""
    assert world.stand is not None
    draw = np.random.default_rng([common.seed])
    centre = {name: float(np.radians(angle)) for name, angle in common.joints_deg.items()}
    if unknown := sorted(set(centre) - set(robot.home)):
        ctx.fail(f"the robot has no joint `{unknown[0]}`", joints=", ".join(robot.home))
    around = {**robot.home, **world.stand.joints, **centre}
    reach = np.radians(common.reach_deg)
    arm = [joint.name for joint in robot.joints if joint.group == "arm"]
    chosen: list[dict[str, float]] = []
    batch: list[dict[str, float]] = []
    tries = 0
    while len(chosen) < common.count and tries < common.tries:
        tries += 1
        posture = dict(around)
        for joint in robot.joints:
            if joint.group == "arm":
                # The last joint turns the board towards the camera for any positions of the others.
                wide = np.pi if joint.name == arm[-1] else reach
                place = around[joint.name] + wide * draw.uniform(-1, 1)
                posture[joint.name] = float(np.clip(place, joint.lower + 0.02, joint.upper - 0.02))
        stage.put(posture)
        if not stage.fits(common.widest_deg):
            continue
        batch.append(posture)
        if len(batch) >= common.count - len(chosen):
            seen = stage.visible(batch)
            good = [share >= worlds.LEAST_VISIBLE and hand >= HAND_PIXELS for share, hand in seen]
            chosen += [each for each, fine in zip(batch, good, strict=True) if fine]
            batch = []
    ctx.check(
        len(chosen) >= common.count,
        f"only {len(chosen)} postures show board and hand, {common.count} are wanted",
        hint="raise `tries`, `reach_deg` or `widest_deg`, or fix the board to another place of the robot",
    )
    return np.array([[posture[joint.name] for joint in robot.joints] for posture in chosen[: common.count]])


def _pose(ctx: Context, options: PlateOptions) -> np.ndarray:
    """T_frame_board (4, 4)."""
    x, y = np.array(options.x_axis), np.array(options.y_axis)
    lengths = np.linalg.norm(x) * np.linalg.norm(y)
    ctx.check(
        bool(lengths > 0 and abs(float(x @ y)) < 1e-6 * lengths),
        "the axes of the board are not at right angles",
        hint="give `board.x_axis` and `board.y_axis`",
    )
    x, y = x / np.linalg.norm(x), y / np.linalg.norm(y)
    return transforms.rigid(np.stack([x, y, np.cross(x, y)], axis=1), np.array(options.origin_m))
