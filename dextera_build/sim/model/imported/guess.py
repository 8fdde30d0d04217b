"""Roles of a robot's links, guessed from the kinematic tree, from names and from shapes, each with its confidence."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from dextera_build.errors import RuleError, listing
from dextera_build.sim.model.imported import hands, home, limbs
from dextera_build.sim.model.imported.hands import Shape, Spot
from dextera_build.sim.model.imported.source import Source

_FLANGES = re.compile(r"(^|_)(flange|tool0|ee_link|hand_mount|link_?ee|link_?eef|attachment)", re.IGNORECASE)
_FINGERS = {
    "thumb": r"thumb|(^|_)th(_|$)",
    "index": r"index|(^|_)(if|ff)(_|$)",
    "middle": r"middle|(^|_)mf(_|$)",
    "ring": r"ring|(^|_)rf(_|$)",
    "little": r"little|pinky|(^|_)lf(_|$)",
    "inner": r"inner",
    "outer": r"outer",
    "left": r"left",
    "right": r"right",
}
"""Finger -> names of its links."""
Confidence = Literal["certain", "likely", "unsure"]


@dataclass(frozen=True)
class Role:
    """A frame of the robot."""

    spot: Spot
    confidence: Confidence
    why: str
    """What the guess rests on."""


@dataclass
class Guess:
    """Initial values for a recipe."""

    hand: list[str] = field(default_factory=list)
    """Links at which hands begin."""
    frames: dict[str, Role] = field(default_factory=dict)
    """Role -> frame."""
    grippers: dict[str, tuple[str, float, float]] = field(default_factory=dict)
    """Limb -> joint of both fingers, its positions open and closed [rad or m]."""
    pointing: list[str] = field(default_factory=list)
    """Limbs without a gripper: they push with the ends of their fingers, or with the tool."""
    tools: list[str] = field(default_factory=list)
    """Those of them that have no hand."""
    followers: dict[str, tuple[str, float]] = field(default_factory=dict)
    """Second finger of a gripper -> the first one, and the ratio, where the file does not couple them."""
    home: dict[str, float] = field(default_factory=dict)
    """Joint of the arms, or of a gripper -> position at the start [rad or m]."""
    hollow: list[str] = field(default_factory=list)
    """Links of hands that the file draws, but lets touch nothing, as the file calls them."""
    still: list[str] = field(default_factory=list)
    """Joints of wheels, heads and other parts that no arm needs."""


def roles(source: Source, root: str) -> Guess:
    """Arms, hands, flanges, palms and fingertips below a link, whose name in the model is `base`.

    Raises:
        RuleError: The robot has legs alone.
    """
    found = Guess()
    branches = limbs.branches_of(source.spec.body(root))
    if not branches:
        legs = listing((body.name for body in limbs.moving(source.spec.body(root))), most=8)
        raise RuleError(f"the robot has no arm or hand: its moving links are legs, {legs}", code="DXB-B217")
    sides = _sides(branches)
    shape = Shape(source.spec, source.mimics)
    for branch, side in zip(branches, sides, strict=True):
        _Limb(source, root, shape, branch, side).add(found, alone=len(branches) == 1)
    if len(branches) > 1:  # tasks for one hand ask for frames without a side
        last = "right_" if "right_" in sides else sides[-1]
        found.frames |= {role.removeprefix(last): each for role, each in found.frames.items() if role.startswith(last)}
    kept = {joint.name for each in branches for body in limbs.subtree(each.top) for joint in body.joints}
    kept |= {
        joint.name for each in branches for body in limbs.way(source.spec.body(root), each.top) for joint in body.joints
    }
    hands_of = [
        body for name in found.hand for body in limbs.subtree(source.spec.body(root if name == "base" else name))
    ]
    found.hollow = [body.name for body in hands_of if _hollow(body)]
    aside = [body for each in branches for top in each.others for body in limbs.subtree(top)]
    loose = [joint.name for body in aside for joint in body.joints]
    found.still = sorted({*loose, *(joint.name for joint in source.spec.joints if joint.name not in kept)})
    return found


def _sides(branches: list[limbs.Branch]) -> list[str]:
    """Prefix of the roles of each arm."""
    if len(branches) == 1:
        return [""]
    names = [next((side for side in ("left", "right") if side in each.top.name.lower()), "") for each in branches]
    clear = all(names) and len(set(names)) == len(names)
    return [f"{name if clear else number}_" for number, name in enumerate(names, 1)]


class _Limb:
    """Guesses the roles of one arm.

    Args:
        source: The file.
        root: Its root link.
        shape: Its geometry.
        branch: The arm.
        side: Prefix of its roles.
    """

    def __init__(self, source: Source, root: str, shape: Shape, branch: limbs.Branch, side: str) -> None:
        self._source, self._root, self._shape, self._branch, self._side = source, root, shape, branch, side
        self._palm = branch.palm

    def add(self, found: Guess, *, alone: bool) -> None:
        """Add its roles; `alone`: the robot has no other arm."""
        count = len(self._branch.fingers)
        self._flange(found)
        leader = self._leader(found) if count > 1 else None
        down = 0 if count > 1 and leader is None else 2
        if count == 0:
            self._tool(found)
        elif count == 1:
            self._jaw(found)
        elif leader is not None:
            self._parallel(found, *leader)
        else:
            self._many(found)
        joints = [joint.name for body in limbs.way(self._branch.top, self._palm) for joint in body.joints]
        driven = [name for name in joints if name not in self._source.mimics]
        found.home |= home.found(self._shape, driven, found.frames[self._side + "palm"].spot, down, alone)
        if (gripper := found.grippers.get(self._limb)) is not None:
            found.home[gripper[0]] = gripper[1]

    @property
    def _limb(self) -> str:
        return self._side.rstrip("_") or "arm"

    def _role(self, found: Guess, role: str, body: Any, at: np.ndarray, axes: Any, sure: Confidence, why: str) -> None:
        place = self._shape.inside(body, at)
        turn = np.array([1.0, 0.0, 0.0, 0.0]) if axes is None else self._shape.turned(body, axes)
        found.frames[self._side + role] = Role(Spot(self._named(body), place, turn), sure, why)

    def _named(self, body: Any) -> str:
        return "base" if body.name == self._root else str(body.name)

    def _flange(self, found: Guess) -> None:
        """The link that is called so, or else the one that carries the hand."""
        known = next((each for each in limbs.subtree(self._branch.top) if _FLANGES.search(each.name)), None)
        if known is not None:
            self._role(found, "flange", known, self._shape.data.body(known.name).xpos, None, "certain", "its name")
        elif not self._branch.fingers:
            at = self._shape.data.body(self._palm.name).xpos
            self._role(found, "flange", self._palm, at, None, "likely", "the end of the chain")
        elif self._palm.name != self._root:
            one = len(self._branch.fingers) == 1
            carrier = self._palm if one or self._palm.parent.name == "world" else self._palm.parent
            at = self._shape.data.body(carrier.name).xpos
            self._role(found, "flange", carrier, at, None, "likely", "it carries the hand")

    def _tool(self, found: Guess) -> None:
        """An arm without a hand: it pushes with the end of its last link."""
        carrier = self._palm
        while carrier.parent is not None and carrier.parent.name != "world" and not list(carrier.joints):
            carrier = carrier.parent
        middle = self._shape.data.body(self._palm.name).xpos
        ahead = self._shape.outwards(self._branch)
        axes = hands.square(ahead, np.zeros(3))
        far = float(((self._shape.outline(carrier) - middle) @ ahead).max())
        tip = middle + max(far, 0.0) * ahead
        why = "the file has no hand: the arm pushes with its end"
        self._role(found, "palm", self._palm, tip - hands.BACK_M * ahead, axes, "unsure", why)
        for role, (x, y) in hands.rim(self._shape.outline(carrier), tip, axes).items():
            self._role(found, role, self._palm, tip + axes @ [x, y, 0.0], None, "unsure", "the rim of the end")
        # What touches the object on purpose is a hand, and not a part of the arm.
        if carrier.name != self._root:
            found.hand.append(self._named(carrier))
        found.pointing.append(self._limb)
        found.tools.append(self._limb)

    def _jaw(self, found: Guess) -> None:
        """One finger, which closes against the link that carries it."""
        (finger,) = self._branch.fingers
        (joint, *_) = finger.joints
        closed, opened = sorted(self._shape.limits(joint.name), key=abs)
        if abs(opened - closed) > hands.SWING_RAD and not _slides(joint):
            opened = closed + float(np.sign(opened - closed)) * hands.SWING_RAD
        self._shape.place({joint.name: opened})
        wide = self._shape.outline(finger).mean(axis=0)
        self._shape.place({joint.name: closed})
        points = self._shape.outline(finger)
        ahead = self._shape.ahead(self._branch, points)
        axes = hands.square(ahead, wide - points.mean(axis=0))
        tip = hands.end(points, ahead, -axes[:, 1])
        called = "alone is called a gripper" if len(self._source.spec.joints) > 1 else "is the only one"
        why = f"joint `{joint.name}` {called}: a jaw that closes against `{self._palm.name}`"
        self._role(found, "palm", self._palm, tip - hands.BACK_M * ahead, axes, "likely", why)
        self._role(found, "tip_fixed", self._palm, tip, None, "likely", "where the closed jaw ends")
        self._role(found, "tip_jaw", finger, tip, None, "likely", "the end of its mesh")
        found.hand.append(self._named(self._palm))
        found.grippers[self._limb] = (joint.name, opened, closed)

    def _leader(self, found: Guess) -> tuple[str, list[str]] | None:
        """The one joint that moves both fingers, and the joints that follow it; None: they move by themselves."""
        inner = [[j.name for b in limbs.subtree(f) for j in b.joints] for f in self._branch.fingers]
        names = [name for each in inner for name in each]
        leaders = {name for name in names if name not in self._source.mimics}
        led = {self._source.mimics[name][0] for name in names if name in self._source.mimics}
        if len(leaders | led) == 1:
            # Of a linkage, the two longest chains are the fingers, and the others support them.
            self._branch.fingers = sorted(self._branch.fingers, key=limbs.depth, reverse=True)[:2]
            return (leaders | led).pop(), names
        if len(names) == 2 and not led and all(_slides(f.joints[0]) for f in self._branch.fingers):
            one, other = names
            axes = [self._shape.data.joint(name).xaxis for name in names]
            found.followers[other] = (one, -1.0 if axes[0] @ axes[1] > 0 else 1.0)
            return one, names
        return None

    def _parallel(self, found: Guess, leader: str, names: list[str]) -> None:
        """Two fingers that one joint moves."""
        fingers = self._branch.fingers
        gaps: list[tuple[float, float]] = []
        both = [name for name in names if name in found.followers]
        for position in self._shape.limits(leader):
            self._shape.place({leader: position, **{n: found.followers[n][1] * position for n in both}})
            one, other = (self._shape.outline(each).mean(axis=0) for each in fingers)
            gaps.append((float(np.linalg.norm(one - other)), position))
        (_, closed), (_, opened) = sorted(gaps)
        self._shape.place({leader: opened, **{n: found.followers[n][1] * opened for n in both}})
        outlines = [self._shape.outline(each) for each in fingers]
        ahead = self._shape.ahead(self._branch, np.array([each.mean(axis=0) for each in outlines]))
        axes = hands.square(ahead, outlines[0].mean(axis=0) - outlines[1].mean(axis=0))
        tips = [hands.end(each, ahead, sign * axes[:, 1]) for each, sign in zip(outlines, (-1, 1), strict=True)]
        why = "two fingers that one joint moves branch here"
        middle = (tips[0] + tips[1]) / 2
        self._role(found, "palm", self._palm, middle - hands.BACK_M * ahead, axes, "likely", why)
        for number, (finger, tip) in enumerate(zip(fingers, tips, strict=True), 1):
            role = f"tip_{self._finger(finger) or number}"
            last = limbs.last(finger)
            self._role(found, role, last, tip, None, "likely", "the inner side of the end of its mesh")
        found.hand.append(self._named(self._palm))
        found.grippers[self._limb] = (leader, opened, closed)

    def _many(self, found: Guess) -> None:
        """A hand with fingers that move by themselves."""
        tips, fingers = [], self._branch.fingers
        for finger in fingers:
            points, start = self._shape.outline(finger), self._shape.data.body(finger.name).xpos
            far = points.mean(axis=0) - start
            tips.append(hands.end(points, far / max(float(np.linalg.norm(far)), 1e-9), np.zeros(3)))
        ahead = self._shape.ahead(self._branch, np.array(tips))
        straight, bent = np.mean(tips, axis=0), self._bent()
        # The palm's normal is the side to which the fingers bend.
        normal = hands.square(ahead, bent - straight)[:, 1]
        axes = np.stack([ahead, np.cross(normal, ahead), normal], axis=1)
        start = np.mean([self._shape.data.body(each.name).xpos for each in fingers], axis=0)
        count = len(fingers)
        self._role(found, "palm", self._palm, start, axes, "likely", f"{count} fingers branch here, and bend to its z")
        for number, (finger, tip) in enumerate(zip(fingers, tips, strict=True), 1):
            name = self._finger(limbs.last(finger))
            role = f"tip_{name or number}"
            role = role if self._side + role not in found.frames else f"tip_{number}"
            sure: Confidence = "likely" if name else "unsure"
            self._role(found, role, limbs.last(finger), tip, None, sure, "the end of its mesh")
        found.hand.append(self._named(self._palm))
        found.pointing.append(self._limb)

    def _bent(self) -> np.ndarray:
        """Mean position (3,) of the fingers with their joints nearer to the limit that is farther from 0."""
        joints = [
            joint.name for finger in self._branch.fingers for body in limbs.subtree(finger) for joint in body.joints
        ]
        before = {name: float(self._shape.data.joint(name).qpos[0]) for name in joints}
        self._shape.place({name: 0.3 * max(self._shape.limits(name), key=abs) for name in joints})
        found = np.mean([self._shape.outline(each).mean(axis=0) for each in self._branch.fingers], axis=0)
        self._shape.place(before)
        return np.asarray(found)

    def _finger(self, body: Any) -> str:
        """Name of a finger; in `openarm_left_ee_outer_finger` and `left/right_finger`, the first `left` is the arm."""
        side = self._side.rstrip("_")
        own = re.sub(side, "", body.name, count=1, flags=re.IGNORECASE) if side else body.name
        return next((name for name, form in _FINGERS.items() if re.search(form, own, re.IGNORECASE)), "")


def _hollow(body: Any) -> bool:
    geoms = list(body.geoms)
    return bool(geoms) and not any(geom.contype or geom.conaffinity for geom in geoms)


def _slides(joint: Any) -> bool:
    import mujoco

    return bool(joint.type == mujoco.mjtJoint.mjJNT_SLIDE)
