"""Targets from recordings: what holds, what is refused, and that they drive a robot."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import LOST, TRACKED, HandStream, Take
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.errors import RuleError
from dextera_build.geometry import hands, human_hand, lie, quaternions, transforms
from dextera_build.sim.control.operator import Aim, Command, PoseControl
from dextera_build.sim.model.forward import Kinematics
from dextera_build.sim.retarget.fingers import Fingers
from dextera_build.sim.retarget.matching import matched
from dextera_build.sim.retarget.motion import Follower, check_side, retarget
from dextera_build.sim.retarget.options import Retargeting
from tests.hand_motions import motion
from tests.hand_streams import stream


def palm_of(robot: RobotModel, limb: str) -> np.ndarray:
    kinematics = Kinematics(robot)
    kinematics.pose({})
    return kinematics.frame(robot.limbs[limb].palm)


def lost(own: HandStream, hand: int, rows: slice) -> HandStream:
    """A stream in which a hand is lost for a while."""
    positions, rotations, tracking = own.positions.copy(), own.rotations.copy(), own.tracking.copy()
    positions[rows, hand] = rotations[rows, hand] = np.nan
    tracking[rows, hand] = LOST
    return own.model_copy(update={"positions": positions, "rotations": rotations, "tracking": tracking})


@pytest.mark.medium
def test_each_limb_follows_the_hand_of_its_side(leap: RobotModel, revo: RobotModel) -> None:
    made = stream(60)
    assert {limb: each.side for limb, each in retarget(revo, made).items()} == {"left": "left", "right": "right"}
    only = retarget(leap, made)
    assert {limb: each.side for limb, each in only.items()} == {"arm": "right"}
    assert only["arm"].fingers.shape == (60, 16)
    assert only["arm"].palms.shape == (60, 4, 4)


def test_the_palm_starts_at_home_and_moves_with_the_closed_clutch_alone(leap: RobotModel) -> None:
    made = stream(60)
    found, start = retarget(leap, made)["arm"], palm_of(leap, "arm")
    free = ~made.clutch[:, 1]
    assert free.sum() == 15
    assert found.held.tolist() == [*[True] * 16, *[False] * 44]
    assert found.palms[:16] == pytest.approx(np.tile(start, (16, 1, 1)))
    wrists = made.positions[:, 1, hands.WRIST].astype(float)
    # The head of the stream looks along x, as the robot does.
    assert found.palms[20, :3, 3] - start[:3, 3] == pytest.approx(wrists[20] - wrists[15], abs=1e-6)


def test_a_hand_that_turns_about_its_palm_turns_the_robots_in_place(leap: RobotModel) -> None:
    """The point of the hand that stays is where the robot's palm is, about 30 mm from the knuckles to the wrist."""
    made = stream(60)
    still = np.tile(made.positions[:1], (60, 1, 1, 1)).astype(float)
    knuckles = [hands.KNUCKLES[finger] for finger in (1, 2, 3)]
    frame = hands.palm_frame(still[0, 1], "right")
    pivot = still[0, 1, knuckles].mean(axis=0) + 0.03 * frame[:, 2]
    turned = made.rotations.copy()
    for row in range(60):
        turn = lie.rotation(np.array([0.0, 0.0, 0.01 * row]))
        still[row, 1] = pivot + (still[row, 1] - pivot) @ turn.T
        wrist = turn @ quaternions.to_matrix(made.rotations[0, 1, hands.WRIST].astype(float))
        turned[row, 1, hands.WRIST] = quaternions.from_matrix(wrist)
    found = retarget(leap, made.model_copy(update={"positions": still.astype(np.float32), "rotations": turned}))["arm"]
    wrists = still[:, 1, hands.WRIST]
    assert np.linalg.norm(wrists[-1] - wrists[15]) > 0.02
    assert np.linalg.norm(found.palms[-1, :3, 3] - found.palms[15, :3, 3]) < 0.006
    assert transforms.angle(found.palms[15, :3, :3].T @ found.palms[-1, :3, :3]) == pytest.approx(0.44, abs=0.01)


def test_a_lost_hand_holds_and_goes_on_from_there(leap: RobotModel) -> None:
    made = lost(stream(90), 1, slice(40, 60))
    found = retarget(leap, made)["arm"]
    assert np.ptp(found.fingers[39:60], axis=0).max() == 0.0
    assert np.ptp(found.palms[39:61], axis=0).max() == 0.0
    assert found.held[40:61].all()
    assert not found.held[61:].any()
    assert np.isfinite(found.fingers).all()
    speeds = np.linalg.norm(np.diff(found.palms[:, :3, 3], axis=0), axis=1)
    assert speeds[59:63].max() < 0.01


@pytest.mark.medium
@pytest.mark.parametrize("rate_hz", [30.0, 72.0])
def test_fingers_that_bent_while_they_were_lost_or_unheard_are_followed_smoothly(
    leap: RobotModel, rate_hz: float
) -> None:
    """As fast as after a posture that changes between two messages; the filter forgets nothing meanwhile."""
    sudden, unseen, unheard = (largest_step(leap, rate_hz, what) for what in ("seen", "lost", "silent"))
    assert unseen == pytest.approx(sudden, rel=0.01)  # the solver begins elsewhere, and stops near its minimum
    assert sudden < unheard < 2 * sudden


def largest_step(robot: RobotModel, rate_hz: float, what: str) -> float:
    """Largest change of a finger's target by one message, of a hand that closes while nobody sees it for 0.3 s."""
    own, follower = matched(robot, "arm"), None
    bent = human_hand.open_angles() + np.deg2rad([[0, 10, 10, 10], *[[0, 40, 40, 30]] * 4])
    last, most = None, 0.0
    for row in range(round(rate_hz)):
        away = 0.5 < row / rate_hz < 0.8
        if away and what == "silent":
            continue
        points, turns = human_hand.Hand().joints(bent if row / rate_hz > 0.65 else human_hand.open_angles(), "right")
        follower = follower or Follower(own, hands.finger_lengths(points), np.eye(4), Retargeting(heading_rad=0.0))
        wrist = quaternions.from_matrices(turns)[hands.WRIST]
        follower.next(points, wrist, row / rate_hz, tracked=not (away and what == "lost"), clutch=True)
        most = max(most, 0.0 if last is None else float(np.abs(follower.fingers - last).max()))
        last = follower.fingers.copy()
    return most


def test_the_same_recording_gives_the_same_targets(revo: RobotModel) -> None:
    first, second = retarget(revo, stream(40)), retarget(revo, stream(40))
    for limb in first:
        np.testing.assert_array_equal(first[limb].fingers, second[limb].fingers)
        np.testing.assert_array_equal(first[limb].palms, second[limb].palms)


def test_where_the_operator_stands_and_looks_does_not_matter(leap: RobotModel) -> None:
    """The head gives the heading."""
    plain = stream(40)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    half = np.array([np.cos(np.pi / 4), 0.0, 0.0, np.sin(np.pi / 4)])  # the same as a quaternion
    assert plain.head is not None
    w, z = half[0], half[3]

    def turned(quaternions: np.ndarray) -> np.ndarray:
        a, b, c, d = np.moveaxis(quaternions.astype(float), -1, 0)
        return np.stack([w * a - z * d, w * b - z * c, w * c + z * b, w * d + z * a], axis=-1).astype(np.float32)

    head = np.concatenate([plain.head[:, :3] @ turn.T, turned(plain.head[:, 3:])], axis=1).astype(np.float32)
    moved = plain.model_copy(
        update={
            "positions": (plain.positions @ turn.T + [1.0, 2.0, 0.5]).astype(np.float32),
            "rotations": turned(plain.rotations),
            "head": head,
        }
    )
    one, other = retarget(leap, plain)["arm"], retarget(leap, moved)["arm"]
    assert other.palms == pytest.approx(one.palms, abs=1e-5)
    assert other.fingers == pytest.approx(one.fingers, abs=5e-3)
    fixed = retarget(leap, moved, Retargeting(heading_rad=0.0))["arm"]
    assert np.abs(fixed.palms - one.palms).max() > 0.01


@pytest.mark.medium
def test_targets_do_not_depend_on_later_messages(leap: RobotModel) -> None:
    plain = stream(60)
    positions = plain.positions.copy()
    positions[40:, 1] += np.float32([0.0, 0.03, 0.02])
    other = plain.model_copy(update={"positions": positions})
    one, changed = retarget(leap, plain)["arm"], retarget(leap, other)["arm"]
    assert changed.palms[:40] == pytest.approx(one.palms[:40], abs=1e-9)
    assert changed.fingers[:40] == pytest.approx(one.fingers[:40], abs=1e-4)
    assert np.abs(changed.palms[40:] - one.palms[40:]).max() > 0.01


def test_poses_in_the_base_of_the_robot_keep_their_axes(leap: RobotModel) -> None:
    """Wherever the head looks."""
    made = stream(40, frame="base")
    assert made.head is not None
    turned = made.model_copy(update={"head": np.tile(np.float32([0, 0, 1.6, 1, 0, 0, 0]), (40, 1))})
    np.testing.assert_array_equal(retarget(leap, turned)["arm"].palms, retarget(leap, made)["arm"].palms)


def test_a_hand_that_turns_about_its_palm_turns_the_palm_in_place(hand: tuple[RobotModel, str]) -> None:
    robot, limb = hand
    made = stream(30, clutch=np.ones((30, 2), bool))
    own = matched(robot, limb)
    side = hands.SIDES.index(own.side)
    points = made.positions[0, side].astype(float)
    pivot = Fingers(own, hands.finger_lengths(points), Retargeting()).beside.origin(points)
    positions, rotations = made.positions.copy(), made.rotations.copy()
    for row in range(30):
        turn = lie.rotation(np.array([0.0, 0.0, 0.04 * row]))
        positions[row, side] = (points - pivot) @ turn.T + pivot
        whole = np.broadcast_to(quaternions.from_matrix(turn), (25, 4))
        rotations[row, side] = quaternions.multiply(whole, made.rotations[0, side].astype(float))
    found = retarget(robot, made.model_copy(update={"positions": positions, "rotations": rotations}))[limb]
    assert np.ptp(positions[:, side, hands.WRIST], axis=0).max() > 0.03
    assert np.ptp(found.palms[:, :3, 3], axis=0).max() < 1e-3
    assert transforms.angle(found.palms[0, :3, :3].T @ found.palms[-1, :3, :3]) == pytest.approx(0.04 * 29, abs=1e-3)


@pytest.mark.medium
def test_targets_drive_the_robot_within_its_limits(revo: RobotModel) -> None:
    made = stream(72)
    found, control = retarget(revo, made), PoseControl(revo, 72.0)
    control.begin(np.array([joint.home for joint in revo.joints]))
    speed = np.array([joint.velocity for joint in revo.joints]) / 72.0
    last, lags = np.array([joint.home for joint in revo.joints]), []
    for row in range(len(made.stamps)):
        command = Command({limb: Aim(each.palms[row], each.fingers[row]) for limb, each in found.items()}, "free")
        targets = control.follow(command)
        assert (np.abs(targets - last) <= speed + 1e-9).all()
        lags.append(control.lag_m(command))
        last = targets
    assert max(lags) < 0.01
    assert max(lags[30:]) > 0.0


def test_a_hand_that_is_never_seen_is_refused(leap: RobotModel) -> None:
    with pytest.raises(RuleError, match="limb `arm` follows the operator's right hand, which is never seen") as caught:
        retarget(leap, lost(stream(20), 1, slice(None)))
    assert caught.value.code == "DXB-B525"
    assert caught.value.facts == {"messages": "20"}
    assert "`hands: {arm: {side: ...}}`" in caught.value.hint


def test_lengths_that_are_no_numbers_are_refused(leap: RobotModel) -> None:
    made = stream(20, takes=(Take(first=0, last=20, finger_lengths_m=(None, (0.05, np.nan, 0.09, 0.08, 0.07))),))
    with pytest.raises(RuleError, match="the lengths of the fingers of the operator's right hand are not") as caught:
        retarget(leap, made)
    assert caught.value.code == "DXB-B539"


@pytest.mark.parametrize("side", hands.SIDES)
def test_a_mirrored_hand_is_refused(side: str) -> None:
    _, points, _ = motion(30.0, side, noise_m=1e-3)
    check_side(points, side)
    other = hands.SIDES[side == "left"]
    with pytest.raises(RuleError, match=f"the {other} hand of the operator is mirrored") as caught:
        check_side(points, other)
    assert caught.value.code == "DXB-B524"
    assert "with bent fingers" in caught.value.facts["messages that show it"]


def test_swapped_hands_of_a_recording_are_refused(leap: RobotModel) -> None:
    made = stream(144)
    swapped = {name: getattr(made, name)[:, ::-1].copy() for name in ("positions", "rotations")}
    with pytest.raises(RuleError, match="the right hand of the operator is mirrored"):
        retarget(leap, made.model_copy(update=swapped))


def test_a_flat_hand_says_nothing_about_its_side() -> None:
    _, points, names = motion(30.0, "right")
    flat = points[:1].copy()
    assert names[0] == "open"
    assert TRACKED == 2
    check_side(flat, "right")


def test_a_robot_without_a_hand_is_refused(leap: RobotModel) -> None:
    bare = leap.model_copy(update={"limbs": {"arm": leap.limbs["arm"].model_copy(update={"hand": ()})}})
    with pytest.raises(RuleError, match="the robot has no hand to move; its limbs: arm") as caught:
        retarget(bare, stream(5))
    assert caught.value.code == "DXB-B523"


def test_palms_are_rigid(revo: RobotModel) -> None:
    for each in retarget(revo, stream(40)).values():
        for palm in each.palms:
            assert transforms.invert(palm) @ palm == pytest.approx(np.eye(4), abs=1e-6)
