"""reference.hands: hands that an operator would have moved, made by a program from the motion of a robot."""

from __future__ import annotations

import math
from itertools import islice
from typing import Any, NamedTuple, Protocol

import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat, PositiveInt

from dextera_build.artifacts.robots.hand_stream import HandStream, Take, Workplace
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.errors import listing
from dextera_build.geometry import hands as human
from dextera_build.geometry import poses, quaternions
from dextera_build.geometry.human_hand import Hand, open_angles
from dextera_build.previews.hands import strip
from dextera_build.rule import Context, Tolerance, rule
from dextera_build.sim.retarget.correspondence import Correspondence

from . import fitted, smooth, tracked
from .smooth import Motion
from .tracked import TrackedOptions

DEVICE = "reference.hands: a program, no person and no headset"


class HandsOptions(TrackedOptions):
    """Options of reference.hands."""

    takes: PositiveInt = 1
    """Number of successful episodes, in order, that become takes of one recording."""
    hand_length_m: PositiveFloat = Field(0.19, ge=0.1, le=0.3)
    """From the wrist's crease to the tip of the middle finger [m]; an assumption."""
    hand_breadth_m: PositiveFloat = Field(0.085, ge=0.05, le=0.15)
    """Across the knuckles [m]; an assumption."""
    open_s: NonNegativeFloat = 2.0
    """Time for which the hand is held open before a take, from which its size is measured [s]."""
    way_s: PositiveFloat = 1.0
    """Time from the end of a take to the beginning of the next, and from the open hand to the first grasp [s]."""


class HandsBackend(Protocol):
    """Interface of a backend of reference.hands."""

    def beside(self, ctx: Context, robot: RobotModel, limb: str, lengths_m: np.ndarray, options: Any) -> Correspondence:
        """Points of a human hand with fingers of lengths (5,) [m] that are those of a limb's hand."""
        ...

    def tips(
        self, ctx: Context, robot: RobotModel, limb: str, own: Correspondence, positions: np.ndarray, options: Any
    ) -> np.ndarray:
        """Tips (T, F, 3) of the fingers of `own` [m] in the frame of the palm at joint positions (T, A)."""
        ...


class _Driven(NamedTuple):
    """A hand that moves a limb."""

    limb: str
    own: Correspondence
    still: np.ndarray
    """(25, 3) joints of the human hand in the frame of its wrist, whose palm is rigid [m]."""

    @property
    def side(self) -> int:
        """0 for a left hand, 1 for a right one."""
        return human.SIDES.index(self.own.side)


# The angles of the fingers are solved for, which is rounded differently on another processor; signs of quaternions are
# free.
@rule(
    version=2,
    packages=("numpy",),
    tolerance=Tolerance({"positions": 1e-4, "rotations": math.inf, "head": 1e-4, "pinch": 0.01}),
)
def hands(
    ctx: Context[HandsBackend], robot: RobotModel, episodes: Episodes, *, options: HandsOptions | None = None
) -> HandStream:
    """Return the hands of an operator who moves the robot as in the episodes, in its base frame. No person made them.

    A human hand of stated proportions follows each palm that was commanded, and its fingers bring their tips to those
    of the robot's fingers, scaled to the hand. Tremor, tracking noise, losses and an uneven clock are added. Before
    every take the hand is open and drives nothing. A take's seed is that of the episode's start.

    Which points of the human hand are those of the robot's is the definition of retargeting, read backwards.

    The backend offers `beside(robot, limb, lengths_m) -> Correspondence`, and `tips(robot, limb, own, positions)`.
    """
    options = options or HandsOptions()
    shown = list(islice(episodes.in_order(), options.takes))
    if not shown:
        ctx.fail("no episode succeeded, so there is no motion to follow", failures=len(episodes.failures))
    _check_robot(ctx, robot, episodes)
    hand = Hand(options.hand_length_m, options.hand_breadth_m)
    driven = [_driven(ctx, robot, limb, hand) for limb in robot.limb_names]
    parts: dict[int, list[Motion]] = {each.side: [] for each in driven}
    takes: list[Take] = []
    off: list[np.ndarray] = []
    for _, episode in shown:
        for each in driven:
            row = robot.limb_names.index(each.limb)
            followed, far = _followed(ctx, robot, each, hand, episode, row)
            off.append(far)
            moved = smooth.resampled(followed, episodes.rate_hz, options.rate_hz)
            parts[each.side] += [*_before(parts[each.side], moved, options), moved]
        end = sum(len(part.wrist) for part in parts[driven[0].side])
        takes.append(Take(first=end - len(moved.wrist), last=end, seed=episode.start.seed))
    motions = {side: smooth.joined(found) for side, found in parts.items()}
    place = Workplace(task=episodes.task, robot=robot.model_name, joints=episodes.joint_names)
    made = tracked.stream(hand, motions, tuple(takes), options, DEVICE).model_copy(update={"workplace": place})
    ctx.metric("tip_error", 1000 * float(np.concatenate(off).mean()), "mm")
    ctx.preview(strip(made), "hands from behind and from the right; no person made them")
    ctx.say(", ".join(made.facts()))
    return made


def _check_robot(ctx: Context, robot: RobotModel, episodes: Episodes) -> None:
    names = tuple(joint.name for joint in robot.joints)
    if episodes.joint_names != names or episodes.limb_names != robot.limb_names:
        ctx.fail(
            "the episodes are of another robot",
            episodes=listing(episodes.joint_names),
            robot=listing(names),
            hint="give the robot of the task",
        )


def _driven(ctx: Context[HandsBackend], robot: RobotModel, limb: str, hand: Hand) -> _Driven:
    """The human hand of a limb."""
    lengths = human.finger_lengths(hand.joints(open_angles(), human.SIDES[1])[0])
    own = ctx.backend.beside(ctx, robot, limb, lengths, ctx.backend_options)
    return _Driven(limb, own, hand.joints(open_angles(), own.side)[0])


def _followed(
    ctx: Context[HandsBackend], robot: RobotModel, each: _Driven, hand: Hand, episode: Episode, row: int
) -> tuple[Motion, np.ndarray]:
    """The hand that follows a limb's commands in an episode, and how far (K,) its tips are from their places [m]."""
    own = each.own
    tips = ctx.backend.tips(ctx, robot, each.limb, own, episode.action.astype(np.float64), ctx.backend_options)
    targets = own.human_tips(tips, each.still)
    targets = targets if each.side else human.mirrored(targets)
    angles = fitted.angles(hand, targets, own.fingers)
    off = np.linalg.norm(fitted.tips(hand, angles)[:, list(own.fingers)] - targets, axis=-1)
    return Motion(_wrists(each, episode.hand[:, row].astype(np.float64)), angles), off.ravel()


def _wrists(each: _Driven, palms: np.ndarray) -> np.ndarray:
    """Poses (T, 7) of the human wrist where the robot's palm is at poses (T, 7)."""
    origin, axes = each.own.origin(each.still), each.own.axes(each.still)
    found = []
    for palm in palms:
        matrix = poses.to_matrix(palm)
        turn = matrix[:3, :3] @ axes.T
        found.append(np.append(matrix[:3, 3] - turn @ origin, quaternions.from_matrix(turn)))
    return np.array(found)


def _before(parts: list[Motion], moved: Motion, options: HandsOptions) -> list[Motion]:
    """From the last take to the open hand at the next one's start, and from there to its first posture."""
    way, still = round(options.way_s * options.rate_hz), round(options.open_s * options.rate_hz)
    ready = Motion(moved.wrist[:1], open_angles()[None])
    before = [smooth.way(parts[-1], ready, way)] if parts else []
    return [*before, smooth.held(ready, 0, max(1, still)), smooth.way(ready, moved, way)]
