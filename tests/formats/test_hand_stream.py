"""HandStream as MCAP: exact both ways, recordings of others, and every error of a recording that does not fit."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.errors import ArtifactError
from dextera_build.formats import hand_stream, mcap
from dextera_build.formats.hand_stream import Topics
from dextera_build.formats.ros import messages
from dextera_build.formats.ros.recording import Recording
from tests.hand_streams import stream, with_buttons


def same(first: HandStream, second: HandStream) -> None:
    for name in HandStream.model_fields:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name), err_msg=name)


@pytest.mark.parametrize("since", [0.0, 1.7e9])
def test_what_is_written_is_read_back_exactly(tmp_path: Path, since: float) -> None:
    made = with_buttons()
    made = HandStream(**dict(made) | {"stamps": made.stamps + since})
    same(HandStream.load(made.save(tmp_path / "a.mcap")[0]), made)


@pytest.mark.parametrize("changes", [{"head": None}, {"lost": [(0, 0, 144)]}, {"lost": [(1, 0, 30), (0, 100, 144)]}])
def test_streams_without_head_or_hand_are_read_back(tmp_path: Path, changes: dict[str, Any]) -> None:
    made = stream(**changes)
    same(HandStream.load(made.save(tmp_path / "a.mcap")[0]), made)


def test_a_recording_is_an_ordinary_one(tmp_path: Path) -> None:
    found = mcap.load(with_buttons().save(tmp_path / "a.mcap")[0])
    assert {each.topic: (each.kind, each.count) for each in found.channels} == {
        "/hands/about": ("std_msgs/msg/String", 1),
        "/hands/left": ("geometry_msgs/msg/PoseArray", 20),
        "/hands/right": ("geometry_msgs/msg/PoseArray", 20),
        "/hands/input": ("sensor_msgs/msg/Joy", 20),
        "/head": ("geometry_msgs/msg/PoseStamped", 20),
    }


Sent = tuple[str, float, np.ndarray]
"""Topic, time [s], poses (K, 7)."""


def recorded(path: Path, sent: Sequence[Sent], frame: Callable[[str], str] = lambda topic: "odom") -> Path:
    """A recording of another program: no metadata, no inputs."""
    with path.open("wb") as out, Recording(out) as recording:
        for topic, seconds, rows in sent:
            time = round(seconds * 1e9)
            if topic == "/vr/head":
                recording.send(topic, "geometry_msgs/PoseStamped", time, messages.pose(time, frame(topic), rows[0]))
            else:
                made = messages.pose_array(time, frame(topic), rows)
                recording.send(topic, "geometry_msgs/PoseArray", time, made)
    return path


OTHERS = Topics(left="/vr/l", right="/vr/r", head="/vr/head", inputs="")


def rows(made: HandStream, row: int, hand: int) -> np.ndarray:
    return np.concatenate([made.positions[row, hand], made.rotations[row, hand]], axis=1).astype(np.float64)


def test_a_recording_of_another_program_is_read(tmp_path: Path) -> None:
    """The right hand comes a little later than the left, is lost at times, and the head has half the rate."""
    made = stream(144)
    sent: list[Sent] = []
    for row, at in enumerate(made.stamps):
        sent.append(("/vr/l", at, rows(made, row, 0)))
        sent += [("/vr/r", at + 0.003, rows(made, row, 1)[: 0 if 30 <= row < 40 else None])]
        sent += [("/vr/head", at + 0.001, made.head[row][None])] if row % 2 == 0 else []
    found = HandStream.load(recorded(tmp_path / "b.mcap", sent), topics=OTHERS)
    np.testing.assert_allclose(found.stamps, made.stamps)
    np.testing.assert_array_equal(found.positions[:, 0], made.positions[:, 0])
    np.testing.assert_array_equal(np.flatnonzero(found.tracking[:, 1] == 0), np.arange(30, 40))
    np.testing.assert_array_equal(found.head, made.head)
    assert (found.frame, found.device, found.synthetic) == ("odom", "not recorded", False)
    np.testing.assert_array_equal(found.clutch, found.tracking > 0)
    closed, opened = round(0.5 * 72), 72
    assert found.pinch[closed, 0] > 0.2 + found.pinch[opened, 0]


def parts(left: slice, right: slice) -> list[Sent]:
    """Messages of a recorder that sends a hand only while it sees it, the right one 3 ms after the left."""
    made = stream(288)
    sent = [("/vr/l", made.stamps[row], rows(made, row, 0)) for row in range(288)[left]]
    return sent + [("/vr/r", made.stamps[row] + 0.003, rows(made, row, 1)) for row in range(288)[right]]


@pytest.mark.parametrize(("left", "right"), [((0, 150), (110, 250)), ((30, 288), (0, 200)), ((0, 60), (200, 250))])
def test_hands_that_are_seen_one_after_the_other_are_all_read(
    tmp_path: Path, left: tuple[int, int], right: tuple[int, int]
) -> None:
    path = recorded(tmp_path / "a.mcap", parts(slice(*left), slice(*right)))
    found = HandStream.load(path, topics=OTHERS)
    for hand, (first, last) in enumerate((left, right)):
        seen = found.tracking[:, hand] > 0
        assert seen.sum() == last - first
        np.testing.assert_array_equal(found.positions[seen, hand], stream(288).positions[first:last, hand])
        assert np.abs(found.stamps[seen] - stream(288).stamps[first:last]).max() < 0.0031
    assert len(found.stamps) == len({*range(*left), *range(*right)})
    assert (np.diff(found.stamps) > 0).all()
    assert hand_stream.read(mcap.load(path), OTHERS).unused == (0, 0)


def test_messages_that_fit_no_other_are_counted(tmp_path: Path) -> None:
    """A right hand at three times the rate of the left one, for a while."""
    made, sent = stream(144), parts(slice(0, 144), slice(0, 40))
    sent += [("/vr/r", made.stamps[row] + part / 216, rows(made, row, 1)) for row in range(40, 60) for part in range(3)]
    found = hand_stream.read(mcap.load(recorded(tmp_path / "a.mcap", sent)), OTHERS)
    # The last one is near to the next message of the left hand, and belongs to it.
    assert found.unused == (0, 39)
    assert (found.hands.tracking[:, 1] > 0).sum() == 61


def test_poses_without_rotation_or_number_are_a_lost_hand(tmp_path: Path) -> None:
    sent = [("/vr/l", number / 72, rows(stream(4), number, 0)) for number in range(4)]
    sent += [("/vr/r", 0.0, np.zeros((25, 7))), ("/vr/r", 1 / 72, np.full((25, 7), np.nan))]
    sent += [("/vr/r", number / 72, rows(stream(4), number, 1)) for number in (2, 3)]
    found = HandStream.load(recorded(tmp_path / "c.mcap", sent), topics=OTHERS)
    np.testing.assert_array_equal(found.tracking[:, 1], [0, 0, 2, 2])


def test_millimetres_are_scaled(tmp_path: Path) -> None:
    made = stream(3)
    scaled = [np.hstack([1000 * rows(made, row, 0)[:, :3], rows(made, row, 0)[:, 3:]]) for row in range(3)]
    sent = [("/vr/l", row / 72, each) for row, each in enumerate(scaled)]
    found = HandStream.load(recorded(tmp_path / "d.mcap", sent), topics=OTHERS, unit_m=0.001)
    np.testing.assert_allclose(found.positions[:, 0], made.positions[:, 0], atol=1e-6)


def test_joints_without_rotations_are_refused(tmp_path: Path) -> None:
    still = one() * [1, 1, 1, 0, 0, 0, 0]
    with pytest.raises(ArtifactError, match="another length than 1") as caught:
        HandStream.load(recorded(tmp_path / "a.mcap", [("/vr/l", 0.0, still)]), topics=OTHERS)
    assert caught.value.hint.startswith("record rotations")


@given(st.integers(0, 2 * 10**18))
def test_a_time_as_read_is_written_as_the_same_time(nanoseconds: int) -> None:
    stamp = nanoseconds / 1_000_000_000
    assert hand_stream._nanoseconds(stamp) / 1_000_000_000 == stamp


def one(count: int = 25, value: float = 0.1) -> np.ndarray:
    return np.tile([value, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (count, 1))


def broken() -> np.ndarray:
    found = one()
    found[7, 2] = np.nan
    return found


WRONG: dict[str, tuple[list[Sent], str]] = {
    "A557": ([("/other", 0.0, one())], "no hand was recorded on `/vr/l` and `/vr/r`"),
    "A558": ([("/vr/l", 0.0, one()), ("/vr/l", 0.1, broken())], "`/vr/l` holds numbers that are not finite"),
    "A559": ([("/vr/l", 1.0, one()), ("/vr/l", 0.5, one())], "the clock of `/vr/l` goes back"),
    "A560": ([("/vr/l", 0.0, one(21))], "has 21 joints instead of 25"),
}


@pytest.mark.parametrize("code", WRONG)
def test_a_recording_that_does_not_fit_is_refused(tmp_path: Path, code: str) -> None:
    sent, text = WRONG[code]
    with pytest.raises(ArtifactError, match=text) as caught:
        HandStream.load(recorded(tmp_path / "a.mcap", sent), topics=OTHERS)
    assert caught.value.code == f"DXB-{code}"
    assert caught.value.facts
    assert caught.value.hint


def test_the_palm_of_openxr_is_left_out(tmp_path: Path) -> None:
    made = rows(stream(1), 0, 0)
    palm = made[:1] + np.eye(7)[:1] * 0.01
    found = HandStream.load(recorded(tmp_path / "a.mcap", [("/vr/l", 0.0, np.vstack([palm, made]))]), topics=OTHERS)
    np.testing.assert_array_equal(found.positions[:, 0], stream(1).positions[:, 0])


def test_the_hint_names_what_other_numbers_of_joints_are(tmp_path: Path) -> None:
    for count, word in ((21, "MediaPipe"), (27, "WebXR"), (5, "WebXR")):
        with pytest.raises(ArtifactError, match=f"{count} joints") as caught:
            HandStream.load(recorded(tmp_path / "a.mcap", [("/vr/l", 0.0, one(count))]), topics=OTHERS)
        assert word in caught.value.hint


def test_hands_in_two_frames_are_refused(tmp_path: Path) -> None:
    sent = [("/vr/l", 0.0, one()), ("/vr/r", 0.0, one())]
    path = recorded(tmp_path / "a.mcap", sent, frame=lambda topic: topic.strip("/").replace("/", "_"))
    with pytest.raises(ArtifactError, match="in different frames") as caught:
        HandStream.load(path, topics=OTHERS)
    assert caught.value.facts == {"`/vr/l`": "vr_l", "`/vr/r`": "vr_r"}


def test_a_damaged_description_is_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        text = '{"device": "x", "synthetic": true, "buttons": 3, "takes": []}'
        recording.send(hand_stream.ABOUT, "std_msgs/String", 0, messages.text(text))
        recording.send("/hands/left", "geometry_msgs/PoseArray", 0, messages.pose_array(0, "odom", one()))
    with pytest.raises(ArtifactError, match="`about` cannot be read as a description of hands"):
        HandStream.load(tmp_path / "a.mcap")


def test_arrays_of_poses_are_decoded_as_the_general_decoder_does() -> None:
    from mcap.records import Schema
    from mcap_ros2.decoder import DecoderFactory

    from dextera_build.formats.ros import pose_arrays, types

    kind = Schema(id=1, data=types.schema("geometry_msgs/PoseArray"), encoding="ros2msg", name=pose_arrays.KIND)
    general = DecoderFactory().decoder_for("cdr", kind)
    ours = pose_arrays.Decoders().decoder_for("cdr", kind)
    for frame in ("", "a", "odom", "local-floor"):
        for count in (0, 1, 25):
            data = messages.pose_array(1_234_567_890, frame, np.random.default_rng(0).normal(size=(count, 7)))
            first, second = general(data), ours(data)
            assert (second.header.frame_id, second.header.stamp.nanosec) == (frame, first.header.stamp.nanosec)
            listed = [[*vars_of(each.position), *vars_of(each.orientation)] for each in first.poses]
            np.testing.assert_array_equal(second.poses, np.array(listed).reshape(-1, 7))
    assert pose_arrays.Decoders().decoder_for("ros1", kind) is None


def vars_of(value: Any) -> list[float]:
    return [getattr(value, name) for name in ("x", "y", "z", "w") if hasattr(value, name)]


def test_a_message_that_is_cut_short_is_named(tmp_path: Path) -> None:
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        data = messages.pose_array(0, "odom", one())
        recording.send("/hands/left", "geometry_msgs/PoseArray", 0, data[: len(data) // 2])
    with pytest.raises(ArtifactError, match="`left` cannot be read as MCAP"):
        HandStream.load(tmp_path / "a.mcap")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, 10**6), st.integers(1, 255))
def test_a_damaged_message_is_read_or_refused(tmp_path: Path, place: int, flip: int) -> None:
    data = bytearray(messages.pose_array(0, "odom", one()))
    data[place % len(data)] ^= flip
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        recording.send("/hands/left", "geometry_msgs/PoseArray", 0, bytes(data))
    with contextlib.suppress(ArtifactError):
        assert HandStream.load(tmp_path / "a.mcap").positions.shape == (1, 2, 25, 3)


TEXTS = st.recursive(
    st.none() | st.booleans() | st.integers() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.sampled_from(["first", "last", "seed"]), inner),
    max_leaves=4,
)


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.fixed_dictionaries(dict.fromkeys(("device", "synthetic", "buttons", "takes"), TEXTS)))
def test_any_description_is_read_or_refused(tmp_path: Path, found: dict[str, Any]) -> None:
    with (tmp_path / "a.mcap").open("wb") as out, Recording(out) as recording:
        recording.send(hand_stream.ABOUT, "std_msgs/String", 0, messages.text(json.dumps(found)))
        recording.send("/hands/left", "geometry_msgs/PoseArray", 0, messages.pose_array(0, "odom", one()))
    with contextlib.suppress(ArtifactError):
        assert HandStream.load(tmp_path / "a.mcap").device
