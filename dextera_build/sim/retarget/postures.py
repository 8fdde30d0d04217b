"""A robot's hand in the postures of an operator's hand: what the correspondence of both comes to, for pictures."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.geometry import hands, human_hand
from dextera_build.geometry.human_pinch import pinching
from dextera_build.sim.retarget.fingers import Fingers
from dextera_build.sim.retarget.matching import matched
from dextera_build.sim.retarget.options import Retargeting

PINCH_M = 0.01
"""Distance of the operator's tips in a pinch [m]."""


@dataclass(frozen=True)
class Examples:
    """Postures of one hand of a robot."""

    about: str
    """The correspondence in a sentence."""
    joints: dict[str, dict[str, float]]
    """Name -> positions of the hand's motors by joint [rad]."""
    links: tuple[str, ...]
    """Links of the hand."""
    view: np.ndarray
    """(3,) direction from the hand to a viewer who sees the palm, in the base."""


def examples(robot: RobotModel, limb: str) -> Examples:
    """The hand of a limb while the hand of an operator of usual size is open, and while it pinches.

    Raises:
        RuleError: The limb has no hand that an operator's can move.
    """
    own = matched(robot, limb)
    names = [hands.FINGERS[finger] for finger in own.fingers]
    postures = {"open": human_hand.open_angles()}
    postures |= {f"thumb and {name}": pinching(name, PINCH_M) for name in names[1:]}
    found, told = {}, []
    for name, angles in postures.items():
        points, _ = human_hand.Hand().joints(angles, own.side)
        follower = Fingers(own, hands.finger_lengths(points), Retargeting(low_pass_hz=0.0))
        posture = follower.next(points, 0.0)
        found[name] = dict(zip(own.hand.joints, posture.tolist(), strict=True))
        if name != "open":
            own.hand.at(posture)
            told.append(f"{name[10:]} {own.hand.gap(0, names.index(name[10:])) * 1e3:.0f} mm")
    about = (
        f"the operator's {own.side} hand, {', '.join(names)}; fingers of {own.length_m * 1e3:.0f} mm, "
        f"scale {follower.beside.scale:.2f}; in a pinch the thumb comes to {', '.join(told)}"
    )
    # From in front of the palm, from the side of the thumb.
    across = -own.turn[:, 0] if own.side == hands.SIDES[1] else own.turn[:, 0]
    view = own.hand.palm[:3, :3] @ (across - own.turn[:, 1])
    return Examples(about, found, own.hand.links, view)
