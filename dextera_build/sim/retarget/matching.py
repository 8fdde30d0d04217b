"""Correspondence of an operator's hand and a robot's: fingers, sides, axes, size and origin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.hand_map import HandMap
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError, listing
from dextera_build.geometry import hands
from dextera_build.sim.retarget.correspondence import Correspondence
from dextera_build.sim.retarget.hand_model import HandModel

SAME = {"little": "pinky"}
"""Names of fingers in roles of frames, if they are not those of the operator's fingers."""
SLANT = 0.5
"""Smallest sine of the angle between the directions out of the palm and along the fingers."""
SWEEPS, STEPS = 3, 9
"""Sweeps over the joints of a finger, and positions of each, when it is straightened."""


@dataclass(frozen=True)
class Matched:
    """A robot's hand beside an operator's."""

    hand: HandModel
    """The robot's."""
    limb: str
    """Its limb."""
    side: str
    """The operator's hand: "left" or "right"."""
    roles: tuple[str, ...]
    """Frames of the robot's fingertips, the thumb's first."""
    fingers: tuple[int, ...]
    """Finger of the operator, as a place in `hands.FINGERS`, of each of these."""
    turn: np.ndarray
    """(3, 3) rotation from WebXR's axes of the operator's wrist to the frame of the robot's palm."""
    anchor: np.ndarray
    """(3,) mean first joint of the robot's fingers but the thumb, in the palm's frame [m]."""
    length_m: float
    """Mean length of these fingers [m]."""
    straight: np.ndarray
    """(H,) motor positions of the open hand [rad]."""
    across: np.ndarray
    """(3,) unit direction from the index finger to the last one, in the palm's frame."""
    widths: np.ndarray
    """(F,) distance from each fingertip to the sides of its link, along `across` [m]."""
    scale: float | None
    """The scale of the recipe."""

    @property
    def others(self) -> list[int]:
        """Fingers of the operator but the thumb."""
        return list(self.fingers[1:])

    def beside(self, lengths_m: np.ndarray, scale: float | None = None) -> Correspondence:
        """The correspondence with a hand whose fingers have lengths (5,), `hands.finger_lengths` [m].

        Args:
            lengths_m: Those of all five.
            scale: Metre of the robot's hand per metre of the operator's; None: that of the recipe, or else by the
                lengths.
        """
        found = scale or self.scale or self.length_m / float(np.mean(lengths_m[self.others]))
        return Correspondence(self.side, self.roles, self.fingers, self.turn, self.anchor, found)


def matched(robot: RobotModel, limb: str) -> Matched:
    """The correspondence of a limb, from the recipe's `hands` and else from frames and geometry.

    Raises:
        RuleError: The limb has no palm, no thumb and finger, or its hand is of the other side than stated.
    """
    stated = robot.hands.get(limb, HandMap())
    roles = _roles(robot, limb, stated)
    hand = HandModel(robot, limb, tuple(roles.values()))
    hand.at(hand.home)
    roots = np.array([hand.root(finger) for finger in range(len(roles))])
    anchor = roots[1:].mean(axis=0)
    facing, pointing = _directions(robot, limb, stated, hand, roots)
    straight = _straight(hand, pointing)
    fingers = tuple(hands.FINGERS.index(name) for name in roles)
    # Fingers begin in their order, but the two of a gripper may begin at one place.
    order = roots[[1, -1]] if len(roles) > 2 else hand.at(hand.home).tips
    side = _side(limb, stated, order, fingers, np.cross(pointing, facing))
    reach = hand.at(straight).tips - roots
    # WebXR: -Z along the fingers, -Y out of the palm.
    axes = np.stack([np.cross(-facing, -pointing), -facing, -pointing], axis=1)
    length = float(np.linalg.norm(reach[1:], axis=1).mean())
    across = axes[:, 0] if side == hands.SIDES[1] else -axes[:, 0]
    widths = np.array([hand.width(finger, across) for finger in range(len(roles))])
    return Matched(
        hand, limb, side, tuple(roles.values()), fingers, axes, anchor, length, straight, across, widths, stated.scale
    )


def _roles(robot: RobotModel, limb: str, stated: HandMap) -> dict[str, str]:
    """Finger -> role of its tip, the thumb first."""
    own = robot.limbs[limb]
    named = {SAME.get(name := role.rpartition("tip_")[2], name): role for role in own.tips}
    stated_or_named = stated.fingers or named
    found = {name: stated_or_named[name] for name in hands.FINGERS if name in stated_or_named}
    if not own.palm or "thumb" not in found or len(found) < 2:
        raise RuleError(
            f"limb `{limb}` has no hand that an operator's hand can move",
            code="DXB-B520",
            facts={"palm": own.palm or "none", "fingertips": listing(own.tips) or "none"},
            hint=f"add frames `palm`, `tip_thumb` and `tip_index`, or state `hands: {{{limb}: {{fingers: "
            "{thumb: ..., index: ...}}}` in the robot's recipe",
        )
    return found


def _directions(
    robot: RobotModel, limb: str, stated: HandMap, hand: HandModel, roots: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Unit directions (3,) out of the palm and along the fingers: stated, of a grip, or of the geometry."""
    own = robot.limbs[limb]
    grip = next(iter(own.grips.values()), None)
    pointing = stated.pointing or (grip.pointing if grip else None)
    facing = stated.facing or (grip.facing if grip else None)
    if pointing is None:
        start = hand.place(robot.frames[own.tool]) if own.tool else np.zeros(3)
        pointing = roots[1:].mean(axis=0) - start
    along = _unit(np.array(pointing, np.float64))
    if facing is None:
        # Fingers bend to the palm, so that their tips are in front of it in the mean of all postures.
        middle = hand.at((hand.lower + hand.upper) / 2).tips - roots
        facing = middle[1:].mean(axis=0)
    out = np.array(facing, np.float64)
    beside = out - (out @ along) * along
    if np.linalg.norm(beside) < SLANT * np.linalg.norm(out):
        raise RuleError(
            f"the palm of limb `{limb}` faces along its fingers",
            code="DXB-B522",
            facts={
                "facing": " ".join(f"{each:.3g}" for each in out),
                "pointing": " ".join(f"{each:.3g}" for each in along),
            },
            hint=f"state `facing` and `pointing` in `hands: {{{limb}: ...}}`: facing leaves the palm at right angles",
        )
    return _unit(beside), along


def _straight(hand: HandModel, pointing: np.ndarray) -> np.ndarray:
    """Motor positions (H,) of the open hand: every tip but the thumb's as far along `pointing` (3,) as possible."""
    found = hand.home.copy()
    for finger in range(1, len(hand.bodies)):
        for sweep in range(SWEEPS):
            for motor in hand.chain(finger):
                span = (hand.upper[motor] - hand.lower[motor]) / STEPS**sweep
                tried = found[motor] + span * np.linspace(-1, 1, 2 * STEPS + 1)
                tried = np.clip(tried, hand.lower[motor], hand.upper[motor])
                reach = []
                for position in tried:
                    found[motor] = position
                    reach.append(hand.tip(found, finger) @ pointing)
                # Of equal positions the one nearest to the last.
                found[motor] = tried[int(np.argmax(np.round(reach, 9)))]
    return found


def _side(limb: str, stated: HandMap, order: np.ndarray, fingers: tuple[int, ...], across: np.ndarray) -> str:
    """The operator's hand of which the robot's has the order of fingers: from `order` (2, 3) first to last [m]."""
    found = hands.SIDES[int((order[0] - order[1]) @ across > 0)]
    wanted = stated.side or (limb if limb in hands.SIDES else found)
    if wanted != found:
        raise RuleError(
            f"the hand of limb `{limb}` is a {found} one, but `{wanted}` is stated",
            code="DXB-B521",
            facts={"order of the fingers": ", ".join(hands.FINGERS[each] for each in fingers)},
            hint="check `facing`, `pointing` and the order of `fingers` in `hands`: facing leaves the palm, "
            "pointing runs along straight fingers",
        )
    return wanted


def _unit(vector: np.ndarray) -> np.ndarray:
    return np.asarray(vector / np.linalg.norm(vector))
