"""The contract of a PPO policy; the task fixes its normalisation, so no statistics of rollouts are needed."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.robots.robot import Grip
from dextera_build.artifacts.tasks.policy import Channel, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.geometry import quaternions
from dextera_build.policy import contract as contracts
from dextera_build.policy import features
from dextera_build.policy.layout import Layout, of_bundle
from dextera_build.sim.primitives import catalogue
from dextera_build.sim.primitives.poses import PoseGoal
from dextera_build.sim.training import insight

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

JOINT_RAD = 0.5
"""Scale of joint positions and targets [rad]."""
TURNED_RAD = 0.3
"""Rotation of a palm per decision where the object must be turned [rad]."""
PLACE_M, TURN = 0.05, 0.3
"""Scale of object positions [m] and of the columns of their rotations."""


def contract_of(
    bundle: TaskBundle,
    limbs: tuple[str, ...],
    options: PpoOptions,
    heading_rad: float | None = None,
    terms: Collection[TermSpec] = (),
) -> PolicyContract:
    """Inputs and outputs of a policy trained with these options.

    Args:
        bundle: The task.
        limbs: The limbs that the policy moves.
        options: The rule's options.
        heading_rad: Direction of the palm about the vertical, in the base [rad]; None: as at home.
        terms: Terms of observations that do not come with dxb.
    """
    layout = of_bundle(bundle, terms=terms)
    robot = bundle.robot
    grips = [grip_of(bundle, limb, options.grip) for limb in limbs]
    elsewhere = {name for other in robot.limbs.values() for name in (*other.arm, *other.hand)}
    elsewhere -= {name for limb in limbs for name in (*robot.limbs[limb].arm, *robot.limbs[limb].hand)}
    open_at = {name: place for grip in grips if grip for name, place in grip.open.items()}
    rest = tuple(float(open_at.get(joint.name, joint.home)) for joint in robot.joints)
    single = [
        joint.name
        for joint in robot.joints
        if joint.group in options.groups
        and not (joint.group == "arm" and options.control == "palm")
        and joint.name not in elsewhere
    ]
    palms = len(limbs) if options.control == "palm" else 0
    closing = _closing(bundle, limbs, options)
    turn_rad = _turn_rad(bundle, options)
    decisions = palms * (6 if turn_rad else 3) + len(closing) + len(single)
    return PolicyContract(
        algorithm="ppo",
        task=bundle.task.name,
        embodiment=layout.embodiment,
        inputs=_inputs(bundle, layout, options),
        action=Channel(name="action", shape=(len(rest),), names=layout.joints, mean=rest),
        rate_hz=layout.rate_hz,
        dataset=bundle.encode(digest.of_bytes),
        settings={
            "control": options.control,
            "limb": " ".join(limbs),
            "joints": " ".join(single),
            "decisions": decisions,
            "places": 6 * palms,
            "step_m": options.step_m,
            "step_rad": options.step_rad,
            "lead_rad": options.lead_rad,
            "every": options.every,
            "width": options.width,
            "layers": options.layers,
            **({"grip": " ".join(closing)} if closing else {}),
            **({"turn_rad": turn_rad} if turn_rad else {}),
            **({contracts.PRIVILEGED: insight.size(layout, len(limbs))} if options.privileged else {}),
            **(_turned(grips[0], heading_rad, options.lean_rad) if grips[0] and heading_rad is not None else {}),
        },
    )


def _inputs(bundle: TaskBundle, layout: Layout, options: PpoOptions) -> tuple[Channel, ...]:
    """Input channels with the objects of the task, normalised."""
    names = catalogue.concerned(bundle.task, bundle.objects)
    joints = tuple(joint for name in names for joint in bundle.objects[name].joints)
    kept: dict[str, tuple[str, ...] | None] = {"objects": names, "displacement": joints}
    inputs = [contracts.channel(layout, name, kept.get(name)) for name in options.inputs]
    return tuple(_normalised(channel, bundle) for channel in inputs if channel.shape[0])


def limbs_of(bundle: TaskBundle, nearest: Callable[[], str]) -> tuple[str, ...]:
    """The limbs that the policy moves: those that carry the object by the task or its roles, otherwise one.

    Args:
        bundle: The task.
        nearest: Gives the limb whose palm is nearest to the object, which acts if none is named.
    """
    primitive = catalogue.of(bundle.task, bundle.objects)
    named = bundle.task.limbs or primitive.ordered() or (nearest(),)
    return named if primitive.carries else named[:1]


def grip_of(bundle: TaskBundle, limb: str, name: str | None) -> Grip | None:
    """The grip of a limb named `name`; None: a suitable one, if the hand has any."""
    grips = bundle.robot.limbs[limb].grips
    if name is not None:
        return grips[name]
    wanted = catalogue.kind(bundle.task.primitive).against
    return next((grip for grip in grips.values() if grip.against in wanted), None)


def _turn_rad(bundle: TaskBundle, options: PpoOptions) -> float:
    """How far a decision turns a palm [rad]; 0: not at all."""
    if options.turn_rad is not None:
        return options.turn_rad
    primitive = catalogue.of(bundle.task, bundle.objects)
    goal, carries = primitive.goal, primitive.carries
    return TURNED_RAD if carries and isinstance(goal, PoseGoal) and goal.quaternion is not None else 0.0


def _closing(bundle: TaskBundle, limbs: tuple[str, ...], options: PpoOptions) -> list[str]:
    """The grip that a decision closes, for each limb; none if fingers stay open or are moved one by one."""
    carries = catalogue.kind(bundle.task.primitive).carries
    if "hand" in options.groups or not (carries if options.closes is None else options.closes):
        return []
    found = []
    for name in limbs:
        grip, grips = grip_of(bundle, name, options.grip), bundle.robot.limbs[name].grips
        found += [label for label, each in grips.items() if each is grip and each.closed]
    return found if len(found) == len(limbs) else []


def _turned(grip: Grip, heading_rad: float, lean_rad: float) -> dict[str, float]:
    """The palm's quaternion in the base: fingers down and tilted forward, the palm facing forward."""
    ahead, up = np.array([np.cos(heading_rad), np.sin(heading_rad), 0.0]), np.array([0.0, 0.0, 1.0])
    fingers = ahead * np.sin(lean_rad) - up * np.cos(lean_rad)
    out = ahead * np.cos(lean_rad) + up * np.sin(lean_rad)
    along, facing = np.array(grip.pointing), np.array(grip.facing)
    axes = np.stack([along, facing, np.cross(along, facing)])
    turn = quaternions.from_matrix(np.stack([fingers, out, np.cross(fingers, out)], axis=1) @ axes)
    return {f"palm_{part}": float(value) for part, value in zip("wxyz", turn, strict=True)}


def _normalised(channel: Channel, bundle: TaskBundle) -> Channel:
    """`channel` with the photograph's configuration as its mean and the same scale for every task."""
    mean, scale = _statistics(channel, bundle)
    plain = [tuple(float(value) for value in np.asarray(part, np.float32)) for part in (mean, scale)]
    return channel.model_copy(update={"mean": plain[0], "scale": plain[1]})


def _statistics(channel: Channel, bundle: TaskBundle) -> tuple[np.ndarray, np.ndarray]:
    count = int(np.prod(channel.shape))
    if channel.name in ("joints", "previous_action"):
        return np.array([joint.home for joint in bundle.robot.joints]), np.full(count, JOINT_RAD)
    if channel.name == "objects":
        seen = [(bundle.base_pose.inverse() @ bundle.objects[name].pose).matrix for name in channel.names]
        turns = [features.rotation_columns(quaternions.from_matrix(pose[:3, :3])) for pose in seen]
        mean = [np.append(pose[:3, 3], turn) for pose, turn in zip(seen, turns, strict=True)]
        return np.concatenate(mean), np.tile([PLACE_M] * 3 + [TURN] * 6, len(seen))
    if channel.name == "displacement":
        at = {
            joint: place
            for thing in bundle.objects.values()
            for joint, place in zip(thing.joints, thing.positions, strict=True)
        }
        return np.array([at[name] for name in channel.names]), np.full(count, JOINT_RAD)
    return np.zeros(count), np.ones(count)
