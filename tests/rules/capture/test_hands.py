"""capture.hands: good recordings come through, and each fault is one error or warning with facts and a next step."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.errors import RuleError
from dextera_build.formats import mcap
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import Recording
from dextera_build.geometry import human_hand, quaternions
from dextera_build.testing import RuleRunner
from tests.hand_streams import AHEAD, stream, with_buttons

pytest.importorskip("mcap_ros2", reason="needs mcap-ros2-support (extra `recordings`)")


def run(tmp_path: Path, made: HandStream, **options: Any) -> tuple[HandStream, RuleRunner]:
    recording = mcap.load(made.save(tmp_path / "hands.mcap")[0])
    return runner().run("capture.hands", stream=recording, options=options), runner()


@cache
def runner() -> RuleRunner:
    """One for all tests, because it reads the code of all rules."""
    return RuleRunner(Path(tempfile.mkdtemp(prefix="dxb-hands-")))


def warnings(tmp_path: Path, made: HandStream, **options: Any) -> list[str]:
    return run(tmp_path, made, **options)[1].outcome.warnings


def fault(tmp_path: Path, made: HandStream, **options: Any) -> RuleError:
    with pytest.raises(RuleError) as caught:
        run(tmp_path, made, **options)
    assert caught.value.facts
    assert caught.value.hint
    return caught.value


def changed(made: HandStream, **fields: Any) -> HandStream:
    return HandStream(**dict(made) | fields)


def turned(made: HandStream, rotation: np.ndarray) -> HandStream:
    """The same motion in a frame with other axes."""
    quaternion = quaternions.from_matrix(rotation)

    def rows(each: np.ndarray) -> np.ndarray:
        return quaternions.multiply(np.broadcast_to(quaternion, each.shape), each).astype(np.float32)

    positions = (made.positions @ rotation.T).astype(np.float32)
    head = np.hstack([(made.head[:, :3] @ rotation.T).astype(np.float32), rows(made.head[:, 3:])])
    return changed(made, positions=positions, rotations=rows(made.rotations), head=head)


def reflected(made: HandStream, axis: int, local: int) -> HandStream:
    """What a device with left-handed axes gives: positions S p, and rotations S R L."""
    sign, own = np.ones(3), np.ones(3)
    sign[axis], own[local] = -1, -1

    def rows(each: np.ndarray) -> np.ndarray:
        matrices = np.array([quaternions.to_matrix(row) for row in each.reshape(-1, 4)])
        return quaternions.from_matrices(sign[:, None] * matrices * own).reshape(each.shape).astype(np.float32)

    head = np.hstack([made.head[:, :3] * sign, rows(made.head[:, 3:])]).astype(np.float32)
    positions = (made.positions * sign).astype(np.float32)
    return changed(made, positions=positions, rotations=rows(made.rotations), head=head)


def assert_same_poses(found: HandStream, wanted: HandStream) -> None:
    np.testing.assert_allclose(found.positions, wanted.positions, atol=1e-6)
    np.testing.assert_allclose(found.head[:, :3], wanted.head[:, :3], atol=1e-6)
    for ours, theirs in ((found.rotations, wanted.rotations), (found.head[:, 3:], wanted.head[:, 3:])):
        np.testing.assert_allclose(np.abs((ours * theirs).sum(axis=-1)), 1, atol=1e-5)


def test_a_good_recording_comes_through_unchanged(tmp_path: Path) -> None:
    made = with_buttons(144)
    found, ran = run(tmp_path, made)
    for name in HandStream.model_fields:
        np.testing.assert_array_equal(getattr(found, name), getattr(made, name))
    assert ran.outcome.warnings == []
    assert ran.outcome.metrics["rate"] == (pytest.approx(72, abs=0.01), "Hz")
    assert ran.outcome.metrics["tracked_left"] == (pytest.approx(100 * 141 / 144), "%")
    assert "no person and no headset" in ran.outcome.line
    assert len(ran.outcome.previews) == 1


@pytest.mark.parametrize(("unit", "factor"), [("millimetres", 0.001), ("centimetres", 0.01), ("inches", 0.0254)])
def test_another_unit_is_named_and_its_option_corrects_it(tmp_path: Path, unit: str, factor: float) -> None:
    made = stream()
    head = np.hstack([made.head[:, :3] / factor, made.head[:, 3:]]).astype(np.float32)
    scaled = changed(made, positions=(made.positions / factor).astype(np.float32), head=head)
    error = fault(tmp_path, scaled)
    assert f"looks like {unit} instead of metres" in str(error)
    assert error.hint == f"set `unit_m: {factor:g}`"
    assert_same_poses(run(tmp_path, scaled, unit_m=factor)[0], made)


def test_a_length_of_no_hand_is_refused(tmp_path: Path) -> None:
    made = stream()
    assert "no hand's length" in str(fault(tmp_path, changed(made, positions=3 * made.positions)))


def test_a_recording_without_head_needs_an_option(tmp_path: Path) -> None:
    error = fault(tmp_path, stream(head=None))
    assert "has no head" in str(error)
    assert '`head: ""`' in error.hint
    assert run(tmp_path, stream(head=None), head="")[0].head is None


def test_y_up_is_named_and_its_option_corrects_it(tmp_path: Path) -> None:
    made = turned(stream(), AHEAD.T)
    error = fault(tmp_path, made)
    assert "the head does not stand upright" in str(error)
    assert error.hint == "set `up: y`"
    assert_same_poses(run(tmp_path, made, up="y")[0], stream())


def test_a_head_on_its_side_is_refused(tmp_path: Path) -> None:
    error = fault(tmp_path, turned(stream(), np.array([[0.0, 0, 1], [0, 1, 0], [-1, 0, 0]])))
    assert "check the axes" in error.hint


def test_swapped_hands_are_named_and_the_option_corrects_them(tmp_path: Path) -> None:
    made = stream()
    swapped = changed(made, positions=made.positions[:, ::-1].copy(), rotations=made.rotations[:, ::-1].copy())
    error = fault(tmp_path, swapped)
    assert "left and right hand are swapped" in str(error)
    assert error.hint.startswith("set `swap: true`")
    assert_same_poses(run(tmp_path, swapped, swap=True)[0], made)


def test_left_handed_axes_are_named(tmp_path: Path) -> None:
    """As Unity gives them: y up, z ahead, and the axes of joints reversed likewise."""
    error = fault(tmp_path, reflected(turned(stream(), AHEAD.T), 2, 2), up="y")
    assert "the hands are mirrored" in str(error)
    assert "`mirror: z`" in error.hint


def test_a_mirrored_person_is_like_one_with_swapped_hands(tmp_path: Path) -> None:
    error = fault(tmp_path, reflected(stream(), 1, 0))
    assert "left and right hand are swapped" in str(error)
    assert "`mirror` to the axis across the picture" in error.hint
    assert_same_poses(run(tmp_path, reflected(stream(), 1, 0), mirror="y")[0], stream())


@pytest.mark.parametrize(("axis", "local"), [(1, 0), (0, 0), (2, 0), (2, 2)])
def test_reversing_an_axis_gives_back_the_hands(tmp_path: Path, axis: int, local: int) -> None:
    made = stream()
    mirrored = reflected(turned(made, AHEAD.T), axis, local)
    assert_same_poses(run(tmp_path, mirrored, mirror="xyz"[axis], up="y")[0], made)


def test_two_hands_of_one_side_are_refused(tmp_path: Path) -> None:
    made = stream()
    twice = changed(made, positions=made.positions[:, [1, 1]].copy(), rotations=made.rotations[:, [1, 1]].copy())
    assert "the left hand is a right one, as the other hand is" in str(fault(tmp_path, twice))


def test_one_hand_of_the_other_side_is_refused(tmp_path: Path) -> None:
    made = stream(lost=[(0, 0, 144)], head=None)
    flipped = changed(made, positions=(made.positions * [1, -1, 1]).astype(np.float32))
    error = fault(tmp_path, flipped, head="")
    assert "the right hand is a left one" in str(error)
    assert "`swap: true`" in error.hint


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.0])
def test_flat_hands_are_of_no_side_and_bent_ones_are(tmp_path: Path, angle: float) -> None:
    """A flat hand is its own mirror image, so nothing can be said of it, and nothing is."""
    angles = np.zeros((5, 4))
    angles[1:, 1] = angle
    made = stream(20)
    flat, _ = human_hand.Hand().joints(angles, "right")
    positions = made.positions.copy()
    for hand in range(2):  # both are right hands
        positions[:, hand] = flat @ AHEAD.T + positions[:, hand, :1]
    refused = "the left hand is a right one"
    if angle == 0:
        assert run(tmp_path, changed(made, positions=positions))
    else:
        assert refused in str(fault(tmp_path, changed(made, positions=positions)))


def test_a_hand_that_is_never_tracked_is_refused_if_it_is_needed(tmp_path: Path) -> None:
    made = stream(lost=[(0, 0, 144)])
    assert run(tmp_path, made)[0].tracking[:, 0].max() == 0
    assert "the left hand is never tracked" in str(fault(tmp_path, made, sides="both"))
    both = stream(lost=[(0, 0, 144), (1, 0, 144)])
    assert "the left and the right hand are never tracked" in str(fault(tmp_path, both))


def test_a_low_rate_and_gaps_are_doubted(tmp_path: Path) -> None:
    made = stream(100)
    assert "hands come at 14.4 Hz" in warnings(tmp_path, changed(made, stamps=5 * made.stamps))[0]
    late = made.stamps + np.where(np.arange(100) >= 50, 0.5, 0.0)
    (said,) = warnings(tmp_path, changed(made, stamps=late))
    assert "more than 100 ms once, the longest 0.51 s, the first after 0.68 s" in said
    assert warnings(tmp_path, changed(made, stamps=late), gap_s=0.6) == []


def test_messages_that_are_left_out_are_told(tmp_path: Path) -> None:
    """The right hand has three times the rate of the left one for a while, and leaves before it."""
    made = stream(100)
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        for row, part in np.ndindex(100, 3):
            time = round(1e9 * float(made.stamps[row])) + part * round(1e9 / 216)
            for hand, topic in enumerate(("/hands/left", "/hands/right")):
                if (part == 0 or (hand and 40 <= row < 52)) and not (hand and row >= 64):
                    poses = np.concatenate([made.positions[row, hand], made.rotations[row, hand]], axis=1)
                    sent = messages.pose_array(time, "odom", poses)
                    recording.send(topic, "geometry_msgs/PoseArray", time, sent)
    runner().run("capture.hands", stream=mcap.load(tmp_path / "a.mcap"), options={"head": ""})
    (said,) = runner().outcome.warnings
    assert said.startswith("24 of 88 messages of the right hand lie between those of the other hand")


def test_jumps_and_losses_are_doubted(tmp_path: Path) -> None:
    made = stream(100, lost=[(0, 30, 50)])
    positions = made.positions.copy()
    positions[60:, 1] += np.float32(0.1)
    found = warnings(tmp_path, changed(made, positions=positions))
    assert "the left hand is lost 20 % of the time" in found[0]
    assert "the right wrist jumps once, first after 0.83 s by 17" in found[1]
    assert len(found) == 2
    rotations = made.rotations.copy()
    half = quaternions.multiply(np.array([np.cos(0.3), 0, 0, np.sin(0.3)]), rotations[70:, 1])
    rotations[70:, 1] = half
    assert "and 34 deg" in warnings(tmp_path, changed(made, rotations=rotations))[1]


def test_noisy_landmarks_and_other_axes_are_doubted(tmp_path: Path) -> None:
    made = stream(60)
    noise = np.random.default_rng(0).normal(size=made.positions.shape)
    noisy = changed(made, positions=(made.positions + 0.004 * noise).astype(np.float32))
    assert any("bones of the left hand change their length" in text for text in warnings(tmp_path, noisy))
    other = quaternions.multiply(made.rotations, np.broadcast_to([0.0, 1, 0, 0], made.rotations.shape))
    found = warnings(tmp_path, changed(made, rotations=other.astype(np.float32)))
    assert [text.partition(":")[0] for text in found] == [
        "the axes of the left wrist are 180 deg from those of the palm",
        "the axes of the right wrist are 180 deg from those of the palm",
    ]


@pytest.mark.medium
def test_a_film_shows_the_hands() -> None:
    pytest.importorskip("av", reason="needs av (extra `learn`)")
    film = runner().run("capture.hands_film", stream=stream(72), options={"rate_hz": 12.0})
    frames = list(film.every())
    assert len(frames) == 12
    assert np.diff(film.stamps) == pytest.approx(1 / 12, abs=1e-4)
    assert all((frame < 128).any() for frame in frames)
    assert np.abs(frames[0].astype(int) - frames[6]).max() > 100
    short = runner().run("capture.hands_film", stream=stream(72), options={"rate_hz": 12.0, "most_s": 0.5})
    assert len(short.stamps) == 7
