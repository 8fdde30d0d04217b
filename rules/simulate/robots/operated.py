"""Hands of a robot that an operator's hands can move: additions of a recipe, and pictures of what follows from them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from pydantic import Field, PositiveFloat

from dextera_build.artifacts.robots.hand_map import HandMap, Side
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import did_you_mean, listing
from dextera_build.rule import Context, Options

from .limbs import Vector

Finger = Literal["thumb", "index", "middle", "ring", "pinky"]
"""Fingers of an operator, as in `geometry.hands`."""


class HandOptions(Options):
    """How an operator's hand maps to a hand of the robot; what is left out follows from frames and geometry."""

    side: Side = ""
    """Hand of the operator: `left` or `right`; empty: the limb's name, or by the order of the fingers."""
    fingers: dict[Finger, str] = Field(default_factory=dict)
    """Finger of the operator -> role of a fingertip among `frames`; empty: by their names, such as `tip_thumb`."""
    facing: Vector | None = None
    """Unit direction normal to the palm, outwards, in frame `palm`; empty: of the first grip, or where fingers bend."""
    pointing: Vector | None = None
    """Unit direction along the straight fingers, in frame `palm`; empty: of the first grip, or from frame `flange`."""
    scale: PositiveFloat | None = None
    """Metre of the robot's hand per metre of the operator's; empty: the ratio of the lengths of the fingers."""


def with_hands(ctx: Context, robot: RobotModel, hands: Mapping[str, HandOptions]) -> RobotModel:
    """The robot with how operators' hands map to its hands; each that is stated is shown open and in a pinch.

    Args:
        ctx: Context for errors and pictures.
        robot: The robot with its limbs.
        hands: Limb -> options.
    """
    for limb, options in hands.items():
        ctx.check(
            limb in robot.limbs,
            f"`hands`: the robot has no limb `{limb}`",
            limbs=listing(robot.limbs),
            hint=did_you_mean(limb, robot.limbs) or "name a limb of the robot",
        )
        for finger, role in options.fingers.items():
            ctx.check(
                role in robot.frames,
                f"`hands` {limb}: no frame is called `{role}`, the tip of the {finger}",
                frames=listing(robot.frames, most=40),
                hint=did_you_mean(role, robot.frames) or f"add `{role}` to `frames`",
            )
    made = robot.model_copy(update={"hands": {limb: HandMap(**dict(each)) for limb, each in hands.items()}})
    for limb in hands:
        _show(ctx, made, limb)
    return made


def _show(ctx: Context, robot: RobotModel, limb: str) -> None:
    from dextera_build.sim.render import portrait
    from dextera_build.sim.retarget.postures import examples

    found = examples(robot, limb)
    for name, joints in list(found.joints.items())[:2]:
        picture = portrait.of_robot(
            robot.model, robot.followed({**robot.home, **joints}), around=(found.links, found.view)
        )
        ctx.preview(picture, f"hand of `{limb}`, {name}: {found.about}")
