"""Text of the recipe that `dxb new robot` writes, and the lines that it says about its guesses."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from dextera_build.cli.project.robot_files import Part
    from dextera_build.sim.model.imported.guess import Guess, Role
    from dextera_build.sim.model.imported.source import Source

HOLLOW = "    # guess: these links of the hand have no collision shapes, so that what is drawn touches."
_PREFIX = "hand_"
"""Prefix of the names of an attached hand."""


class Text:
    """The recipe of one file, or of an arm's and a hand's file.

    Args:
        name: Name of the robot.
        folder: The folder of all files, relative to the project.
        parts: The arm, and the hand if there is one.
        repair: The recipe repairs moments of inertia.
    """

    def __init__(self, name: str, folder: str, parts: Sequence[Part], repair: bool) -> None:
        from dextera_build.sim.model.imported import guess

        self._name, self._folder, self._parts = name, folder, parts
        self._repair = ", repair_inertias: true" if repair else ""
        self._arm = guess.roles(parts[0].source, parts[0].root)
        self._hand = guess.roles(parts[1].source, parts[1].root) if len(parts) > 1 else None

    def told(self) -> Iterator[str]:
        """A line for every guess and every change of a file."""
        for part in self._parts:
            for link, change in part.source.repaired.items():
                yield f"repaired inertia of `{link}`: {change}"
        for link, new in self._parts[0].source.renamed.items():
            yield f"link `{link}` is called `{new}`, because the root of a robot model is `{link}`"
        for prefix, found in self._guesses():
            for role, each in self._frames(found).items():
                yield f"{role} = {self._link(prefix, each)}: {each.confidence}, {each.why}"
            for limb, (joint, opened, closed) in found.grippers.items():
                yield f"gripper of {limb} = {prefix + joint}: open at {opened:.4g}, closed at {closed:.4g}"
            if found.hollow and self._solid(found):
                yield f"no collision shapes, so that what is drawn touches: {', '.join(found.hollow)}"
            if found.still:
                yield f"fixed at home, as no arm needs them: {', '.join(found.still)}"

    def recipe(self) -> str:
        """The YAML."""
        files = " and ".join(part.file.name for part in self._parts)
        arm = self._parts[0]
        whole = ", root: world" if arm.whole else ""
        lines = [
            f"summary: {files}, with roles that were guessed by `dxb new robot`.",
            "inputs:",
            f"  files: {self._folder}",
            "nodes:",
            "  robot:",
            "    rule: simulate.imported_robot",
            "    files: $files",
            f"    name: {self._name}",
            f'    source: "{files}"',
            *([HOLLOW] if self._arm.hollow and self._hand is None else []),
            f"    parts: [{{file: {_quoted(arm.path)}{whole}{self._repair}{self._solid(self._arm)}}}]",
            *self._attach(),
            *self._roles(),
            *self._grips(),
            *self._numbers(),
        ]
        return "\n".join([*lines, "targets:", "  default: [robot]", ""])

    def _guesses(self) -> list[tuple[str, Guess]]:
        """Prefix and guess of each part."""
        return [("", self._arm)] if self._hand is None else [("", self._arm), (_PREFIX, self._hand)]

    def _frames(self, found: Guess) -> dict[str, Role]:
        """Frames of a part; of two files, the flange is the arm's, and all others are the hand's."""
        if self._hand is None:
            return found.frames
        arm = found is self._arm
        return {role: each for role, each in found.frames.items() if role.endswith("flange") == arm}

    def _attach(self) -> list[str]:
        if self._hand is None:
            return []
        hand, more = self._parts[1], self._repair + self._solid(self._hand)
        return [
            "    # guess: the root of the hand lies in the flange's frame; `at_m` and `quaternion` move and turn it.",
            f"    attach: {{hand: {_quoted(hand.path)}, at: flange, at_m: [0, 0, 0]{more}}}",
        ]

    def _solid(self, found: Guess | None) -> str:
        """Links of the hand that would touch nothing; the end of an arm that carries another hand is none."""
        if found is None or not found.hollow or (self._hand is not None and found is self._arm):
            return ""
        return f", solid: [{', '.join(map(_quoted, found.hollow))}]"

    def _roles(self) -> list[str]:
        lines: list[str] = []
        # The hand of a second file begins at its root.
        if self._hand is None and self._arm.hand:
            lines += [
                "    # guess: the hand begins where the chain branches, at its jaw, or at the last link that turns.",
                _line("hand", self._arm.hand),
            ]
        frames = [(prefix, self._frames(found)) for prefix, found in self._guesses()]
        if any(each for _, each in frames):
            lines.append(
                "    # guess: a tip is on the inner surface of the end of its finger; the fingers of a gripper point"
            )
            lines.append("    # along the palm's z, and those of a hand along its x and bend to its z.")
            lines.append("    frames:")
            for prefix, roles in frames:
                lines += [_frame(role, each, self._link(prefix, each)) for role, each in roles.items()]
        return lines

    def _link(self, prefix: str, role: Role) -> str:
        """Name in the robot of the link of a role; the root of an attached hand keeps its own name."""
        of_hand = prefix and role.spot.link == "base"
        return prefix + (self._parts[1].root if of_hand else role.spot.link)

    def _grips(self) -> list[str]:
        """Grippers, and limbs that push."""
        lines = []
        prefix, found = self._guesses()[-1]
        for limb, (joint, opened, closed) in found.grippers.items():
            limits = self._limits(found, prefix, joint)
            ends = f"open: {_rounded(opened, *limits)}, closed: {_rounded(closed, *limits)}"
            lines.append(f"      {limb}: {{gripper: {{joint: {_quoted(prefix + joint)}, {ends}}}}}")
        for limb in found.pointing:
            tool = "facing: [1, 0, 0], pointing: [0, 0, 1], tip_radius_m: 0.003"
            hand = "facing: [0, 0, 1], pointing: [1, 0, 0], tip_radius_m: 0.01"
            grip = f"{{against: nothing, open_rad: {{}}, {tool if limb in found.tools else hand}}}"
            lines.append(f"      {limb}: {{grips: {{point: {grip}}}}}")
        why = (
            "    # guess: where a gripper is open, and closed without an object; what pushes with its tips [rad or m]."
        )
        return [why, "    limbs:", *lines] if lines else []

    def _limits(self, found: Guess, prefix: str, joint: str) -> tuple[float, float]:
        source = self._parts[1 if prefix else 0].source
        low, high = (float(each) for each in source.spec.joint(joint).range)
        return (low, high) if low < high else (-math.inf, math.inf)

    def _numbers(self) -> list[str]:
        """Couplings, homes, and properties that the files do not state."""
        parts = [
            (prefix, part.source, found) for part, (prefix, found) in zip(self._parts, self._guesses(), strict=True)
        ]
        lines = _followers(parts)
        joints = {
            prefix + joint.name: (joint, source, found)
            for prefix, source, found in parts
            for joint in source.spec.joints
            if joint.name not in source.mimics and joint.name not in found.followers
        }
        still = {prefix + name for prefix, _, found in parts for name in found.still}
        if still:
            lines += ["    # guess: joints that no arm needs are left out, and fixed at home."]
            lines += [_line("active", [name for name in joints if name not in still])]
        if any(joint.name not in source.speeds for joint, source, _ in joints.values()):
            lines.append("    velocity_rad_s: 2.0  # guess: the file states no speed of some joints")
        if any(joint.name not in source.efforts for joint, source, _ in joints.values()):
            lines.append("    effort_nm: 10.0  # guess: the file states no torque of some joints")
        lines += [
            "    # guess: the hand in front of the base, and nothing touches [rad, of sliding joints m].",
            "    home_rad:",
        ]
        lines += [f"      {_quoted(name)}: {_home(*each)}" for name, each in joints.items()]
        bare = [name for name, (joint, *_) in joints.items() if float(joint.range[0]) >= float(joint.range[1])]
        if bare:
            lines += ["    # guess: the file states no limits of these joints.", "    joints:"]
            lines += [f"      {_quoted(name)}: {{lower_rad: -3.1416, upper_rad: 3.1416}}" for name in bare]
        return lines


def _followers(parts: Sequence[tuple[str, Source, Guess]]) -> list[str]:
    lines = [
        f"      {_quoted(prefix + name)}: {{leader: {_quoted(prefix + leader)}, ratio: {ratio:g}}}"
        for prefix, _, found in parts
        for name, (leader, ratio) in found.followers.items()
    ]
    why = "    # guess: the file moves both fingers by themselves; a gripper has one motor."
    return [why, "    followers:", *lines] if lines else []


def _frame(role: str, each: Role, link: str) -> str:
    spot = each.spot
    place = ", ".join(_short(value, 4) for value in spot.at)
    turn = ", ".join(_short(value, 6) for value in spot.turn)
    turned = "" if abs(abs(float(spot.turn[0])) - 1) < 1e-6 else f", quaternion: [{turn}]"
    return f"      {role}: {{link: {_quoted(link)}, at_m: [{place}]{turned}}}  # {each.confidence}: {each.why}"


def _home(joint: Any, source: Source, found: Guess) -> str:
    """A position inside the limits; the file's keyframe, the arm's guess, or 0."""
    low, high = (float(each) for each in joint.range)
    value = source.home.get(joint.name, found.home.get(joint.name, 0.0))
    return _rounded(value, low, high) if low < high else _rounded(value, -math.inf, math.inf)


def _rounded(value: float, low: float, high: float) -> str:
    """A position with four decimals; at a limit rounded inwards, so that the limit holds."""
    value = min(max(value, low), high)
    rounded = round(value, 4)
    if rounded < low:
        rounded = math.ceil(low * 1e4) / 1e4
    elif rounded > high:
        rounded = math.floor(high * 1e4) / 1e4
    return _short(rounded, 4) if low <= rounded <= high else repr(value)


def _short(value: float, digits: int) -> str:
    return f"{round(float(value), digits) + 0.0:.{digits}f}".rstrip("0").rstrip(".")


def _line(field: str, names: Sequence[str]) -> str:
    return f"    {field}: [{', '.join(map(_quoted, names))}]"


def _quoted(text: str) -> str:
    return text if re.fullmatch(r"[A-Za-z_][A-Za-z0-9_./-]*", text) else '"' + text.replace('"', '\\"') + '"'
