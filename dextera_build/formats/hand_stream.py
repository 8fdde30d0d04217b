"""`HandStream` as MCAP of ROS 2 messages, one file for what dxb writes and what another recorder wrote.

Each hand is a topic of `geometry_msgs/PoseArray` with 25 poses in WebXR's order, or 26 in OpenXR's, whose first is the
palm; an array without poses, or whose numbers are all NaN or all 0, is a lost hand. The head is
`geometry_msgs/PoseStamped`. A message `sensor_msgs/Joy` holds pinch of left and right and further inputs as `axes`, and
clutch and tracking state of left and right as `buttons`; without it, a tracked hand moves the robot, and the pinch
follows from the distance of the tips. Device, origin, task and robot, names of inputs and takes are a JSON object in
a `std_msgs/String`, which stays with the hands in every copy of a recording, and which other recorders may leave out.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

from dextera_build.artifacts.core.file_errors import unreadable
from dextera_build.artifacts.robots.hand_stream import LOST, TRACKED, HandStream, Take, Workplace
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import ArtifactError, listing
from dextera_build.formats import mcap
from dextera_build.formats.files import suffix_among
from dextera_build.formats.ros import messages, reading
from dextera_build.formats.ros.recording import Recording
from dextera_build.geometry import hands

HANDS = ("geometry_msgs/msg/PoseArray", "geometry_msgs/PoseArray")
INPUTS = ("sensor_msgs/msg/Joy", "sensor_msgs/Joy")
"""Equivalent message types of ROS 2 and ROS 1."""
TEXTS = ("std_msgs/msg/String", "std_msgs/String")
ABOUT = "/hands/about"
"""Topic of the description of a recording."""
OPENXR = 26
"""Joints of OpenXR's hands: the palm, and then those of WebXR with the same axes (XR_EXT_hand_tracking)."""
NEAR_S = 0.1
"""Largest time from a hand's message to the head's pose and the inputs that belong to it [s]."""


class Topics(NamedTuple):
    """Topics of a recording of hands; a topic that was not recorded is left out."""

    left: str = "/hands/left"
    right: str = "/hands/right"
    head: str = "/head"
    inputs: str = "/hands/input"


class Read(NamedTuple):
    """What a recording holds."""

    hands: HandStream
    unused: tuple[int, int]
    """Messages of left and right with a hand that fit no time of the other hand's, so that they are left out."""


class _Rows(NamedTuple):
    """Poses of a topic: times (M,) [ns], poses (M, K, 7) float32 with NaN where lost, and their frame."""

    times: np.ndarray
    poses: np.ndarray
    frame: str


def save(made: HandStream, path: Path) -> list[Path]:
    """Write an `.mcap` file."""
    with path.open("wb") as out:
        write(made, out)
    return [path]


def write(made: HandStream, out: IO[bytes]) -> None:
    """Write the content of an `.mcap` file."""
    topics = Topics()
    with Recording(out) as recording:
        first = _nanoseconds(float(made.stamps[0]))
        recording.send(ABOUT, "std_msgs/String", first, messages.text(json.dumps(_facts(made))))
        for row, stamp in enumerate(made.stamps):
            time = _nanoseconds(float(stamp))
            for hand, topic in enumerate(topics[:2]):
                rows = np.concatenate([made.positions[row, hand], made.rotations[row, hand]], axis=1)
                shown = rows[: 0 if made.tracking[row, hand] == LOST else None]
                recording.send(topic, "geometry_msgs/PoseArray", time, messages.pose_array(time, made.frame, shown))
            if made.head is not None and np.isfinite(made.head[row]).all():
                head = messages.pose(time, made.frame, made.head[row])
                recording.send(topics.head, "geometry_msgs/PoseStamped", time, head)
            more = made.buttons[row] if made.buttons is not None else ()
            axes = np.concatenate([made.pinch[row], np.asarray(more, np.float32)])
            codes = [*made.clutch[row], *made.tracking[row]]
            recording.send(topics.inputs, "sensor_msgs/Joy", time, messages.joy(time, axes, codes))


def load(path: str | Path, topics: Topics | None = None, *, unit_m: float = 1.0) -> HandStream:
    """Read a recording of hands; see `read`.

    Raises:
        ArtifactError: There is no such file, it is no MCAP file, or `read` refuses it.
    """
    suffix_among("HandStream", Path(path), (".mcap",))
    return of(mcap.load(path), topics, unit_m=unit_m)


def of(stream: Stream, topics: Topics | None = None, *, unit_m: float = 1.0) -> HandStream:
    """The hands in a recording; see `read`."""
    return read(stream, topics, unit_m=unit_m).hands


def read(stream: Stream, topics: Topics | None = None, *, unit_m: float = 1.0) -> Read:
    """The hands in a recording, and what of it they lack.

    The messages of the hand with more of them give the times, and those of the other hand where the first has none for
    longer than `NEAR_S`, as in a recording that holds hands only while they are seen.

    Args:
        stream: The recording.
        topics: Its topics; None: those that dxb writes.
        unit_m: Length of its unit [m].

    Raises:
        ArtifactError: No hand was recorded, a message has another number of joints or a number that is not finite, its
            clock goes back, or its frames differ.
    """
    named = topics or Topics()
    left, right = (_hand(stream, topic) for topic in named[:2])
    if not len(left.times) and not len(right.times):
        raise ArtifactError(
            f"no hand was recorded on `{named.left}` and `{named.right}`",
            code="DXB-A557",
            facts={"topics": listing(f"{each.topic} ({each.kind})" for each in stream.channels)},
            hint="name the topics of `geometry_msgs/PoseArray` that hold the joints of the hands",
        )
    one, other = sorted((left.times, right.times), key=len, reverse=True)
    period = int(np.median(np.diff(one))) if len(one) > 1 else 0
    most = max(1, period // 2)
    times = np.union1d(one, other[_alone(other, one, most)])
    head = _poses(stream, named.head, mcap.POSES)
    _check_frames({named.left: left, named.right: right, named.head: head})
    poses = np.stack([_matched(times, each, most) for each in (left, right)], axis=1)
    poses[..., :3] *= np.float32(unit_m)
    heads = _matched(times, head, round(NEAR_S * reading.SECOND))[:, 0] if len(head.times) else None
    if heads is not None:
        heads[:, :3] *= np.float32(unit_m)
    found = HandStream(
        frame=next(each.frame for each in (left, right) if len(each.times)),
        stamps=np.array([time / reading.SECOND for time in times.tolist()], np.float64),
        positions=np.ascontiguousarray(poses[..., :3]),
        rotations=np.ascontiguousarray(poses[..., 3:]),
        head=heads,
        **_inputs(stream, named.inputs, times, poses) | _about(stream),
    )
    return Read(found, (_unused(times, left, most), _unused(times, right, most)))


def _facts(made: HandStream) -> dict[str, Any]:
    """The description of a recording."""
    return {
        "device": made.device,
        "synthetic": made.synthetic,
        "workplace": None if made.workplace is None else made.workplace.model_dump(mode="json"),
        "buttons": made.button_names,
        "takes": [take.model_dump() for take in made.takes],
        "joints": hands.JOINTS,
        "units": "m; frame with z up; WebXR's axes of joints",
    }


def _about(stream: Stream) -> dict[str, Any]:
    """Fields from the description, or what is known without it."""
    if all(each.topic != ABOUT or each.kind not in TEXTS for each in stream.channels):
        return {"device": "not recorded", "synthetic": False}
    with stream.file.open() as file:
        text = next((message.data for _, _, message in reading.messages(file, ABOUT, [ABOUT])), "")
    try:
        found = json.loads(text)
        return {
            "device": str(found["device"]),
            "synthetic": bool(found["synthetic"]),
            "workplace": Workplace(**found["workplace"]) if found.get("workplace") else None,
            "button_names": tuple(map(str, found["buttons"])),
            "takes": tuple(Take(**take) for take in found["takes"]),
        }
    except (KeyError, TypeError, ValueError) as error:
        raise unreadable(ABOUT, "a description of hands", error) from None


def _hand(stream: Stream, topic: str) -> _Rows:
    """Joints of one hand; none if the topic was not recorded."""
    found = _poses(stream, topic, HANDS)
    lost = np.isnan(found.poses).all(axis=(1, 2)) | (found.poses == 0).all(axis=(1, 2))
    found.poses[lost] = np.nan
    partly = np.flatnonzero(~lost & ~np.isfinite(found.poses).all(axis=(1, 2)))
    if len(partly):
        first = found.poses[partly[0]]
        joint = int(np.flatnonzero(~np.isfinite(first).all(axis=1))[0])
        raise ArtifactError(
            f"`{topic}` holds numbers that are not finite",
            code="DXB-A558",
            facts={
                "first": f"joint `{hands.JOINTS[joint]}` at {found.times[partly[0]] / reading.SECOND:.3f} s",
                "messages": f"{len(partly):,} of {len(found.times):,}",
            },
            hint="send an array without poses while a hand is not tracked; joints of a tracked hand all have poses",
        )
    return found


def _poses(stream: Stream, topic: str, kinds: Sequence[str]) -> _Rows:
    """Poses of a topic, whose clock must not go back; messages with the time of the one before are left out."""
    if all(each.topic != topic or each.kind not in kinds for each in stream.channels):
        return _Rows(np.zeros(0, np.int64), np.zeros((0, len(hands.JOINTS), 7), np.float32), "")
    times: list[int] = []
    rows: list[np.ndarray] = []
    frames: set[str] = set()
    with stream.file.open() as file:
        for received, _, message in reading.messages(file, topic, [topic], as_written=True):
            time = reading.stamp(message, received)
            if times and time < times[-1]:
                raise ArtifactError(
                    f"the clock of `{topic}` goes back",
                    code="DXB-A559",
                    facts={"first": f"{time / reading.SECOND:.3f} s comes after {times[-1] / reading.SECOND:.3f} s"},
                    hint="record with one clock that nobody sets meanwhile, or cut the recording there",
                )
            if not times or time > times[-1]:
                times.append(time)
                rows.append(_numbers(topic, message, time, len(hands.JOINTS) if kinds == HANDS else 1))
                frames.add(str(message.header.frame_id))
    if len(frames) > 1:
        raise _frames_differ({f"`{topic}`": listing(sorted(frames))})
    shape = (len(rows), -1, 7) if rows else (0, len(hands.JOINTS), 7)
    with np.errstate(over="ignore"):  # such numbers are refused as not finite
        poses = np.array(rows, np.float32).reshape(shape)
    return _Rows(np.array(times, np.int64), poses, next(iter(frames), "") or "world")


def _numbers(topic: str, message: Any, time: int, wanted: int) -> np.ndarray:
    """Poses (K, 7) of a message, position and quaternion w x y z; NaN for an array without poses."""
    poses = message.poses if hasattr(message, "poses") else [message.pose]
    if not len(poses):
        return np.full((wanted, 7), np.nan)
    if len(poses) == wanted + 1 == OPENXR:
        poses = poses[1:]
    if len(poses) != wanted:
        known = {21: "21 are MediaPipe's landmarks: add the metacarpals of the four fingers"}
        raise ArtifactError(
            f"a hand on `{topic}` has {len(poses)} joints instead of {wanted}",
            code="DXB-A560",
            facts={"time": f"{time / reading.SECOND:.3f} s", "order": ", ".join((*hands.JOINTS[:6], "..."))},
            hint=known.get(len(poses), "send the joints of WebXR's hands in their order"),
        )
    if isinstance(poses, np.ndarray):
        return _unit(poses[:, [0, 1, 2, 6, 3, 4, 5]])
    placed = [(each.position, each.orientation) for each in poses]
    return _unit(np.array([[p.x, p.y, p.z, q.w, q.x, q.y, q.z] for p, q in placed], np.float64))


def _unit(poses: np.ndarray) -> np.ndarray:
    """Poses (K, 7) with quaternions of length 1; those in single precision are unchanged."""
    with np.errstate(over="ignore", invalid="ignore"):  # such numbers are refused as not finite
        length = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        exact = (np.abs(length - 1) < 1e-6) | (length == 0)
        return np.hstack([poses[:, :3], poses[:, 3:] / np.where(exact, 1.0, length)])


def _matched(times: np.ndarray, rows: _Rows, most: int) -> np.ndarray:
    """Poses (N, K, 7) nearest to `times` (N,), NaN where none is within `most` ns."""
    found = np.full((len(times), *rows.poses.shape[1:]), np.nan, np.float32)
    nearest, near = _nearest(times, rows.times, most)
    found[near] = rows.poses[nearest[near]]
    return found


def _nearest(times: np.ndarray, known: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Index (N,) of the entry of `known` (M,) nearest to each of `times` (N,), and whether it is within `most`."""
    if not len(known):
        return np.zeros(len(times), np.int64), np.zeros(len(times), bool)
    after = np.clip(np.searchsorted(known, times), 0, len(known) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(known[before] - times) < np.abs(known[after] - times), before, after)
    return nearest, np.abs(known[nearest] - times) <= most


def _alone(times: np.ndarray, others: np.ndarray, most: int) -> np.ndarray:
    """Which of `times` (N,) lie between two `others` (M,) that are further apart than `NEAR_S`, or beyond all of them.

    Those within `most` ns of one of them do not.
    """
    edges = np.concatenate([[-np.inf], others, [np.inf]])
    place = np.searchsorted(others, times, side="right")
    away = np.minimum(times - edges[place], edges[place + 1] - times)
    return np.asarray((edges[place + 1] - edges[place] > NEAR_S * reading.SECOND) & (away > most))


def _unused(times: np.ndarray, rows: _Rows, most: int) -> int:
    """Number of poses that none of `times` (N,) took."""
    nearest, near = _nearest(times, rows.times, most)
    left = np.ones(len(rows.times), bool)
    left[nearest[near]] = False
    return int((left & np.isfinite(rows.poses).all(axis=(1, 2))).sum())


def _inputs(stream: Stream, topic: str, times: np.ndarray, poses: np.ndarray) -> dict[str, Any]:
    """Pinch, clutch, tracking and further inputs at times (N,) [ns] of hands (N, 2, 25, 7)."""
    there = np.isfinite(poses).all(axis=(2, 3))
    found: dict[str, Any] = {
        "pinch": np.nan_to_num(hands.pinch(poses[..., :3]), nan=0.0).astype(np.float32),
        "clutch": there.copy(),
        "tracking": np.where(there, TRACKED, LOST).astype(np.uint8),
    }
    if all(each.topic != topic or each.kind not in INPUTS for each in stream.channels):
        return found
    with stream.file.open() as file:
        read = [(reading.stamp(each, at), each) for at, _, each in reading.messages(file, topic, [topic])]
    known = np.array([stamp for stamp, _ in read], np.int64)
    order = np.argsort(known, kind="stable")
    nearest, near = _nearest(times, known[order], round(NEAR_S * reading.SECOND))
    rows = [read[order[number]][1] if close else None for number, close in zip(nearest, near, strict=True)]
    axes = _column([None if row is None else row.axes for row in rows], np.float32)
    codes = _column([None if row is None else row.buttons for row in rows], np.int64)
    if axes.shape[1] >= 2:
        found["pinch"] = np.where(near[:, None], np.clip(axes[:, :2], 0, 1), found["pinch"])
        found["buttons"] = np.ascontiguousarray(axes[:, 2:]) if axes.shape[1] > 2 else None
        found["button_names"] = tuple(f"axis {number}" for number in range(2, axes.shape[1]))
    if codes.shape[1] >= 2:
        found["clutch"] = np.where(near[:, None], codes[:, :2] > 0, False)
    if codes.shape[1] >= 4:
        states = np.clip(codes[:, 2:4], TRACKED - 1, TRACKED).astype(np.uint8)
        found["tracking"] = np.where(there & near[:, None], states, found["tracking"])
    return found


def _column(rows: Sequence[Any], dtype: type[np.generic]) -> np.ndarray:
    """Numbers (N, K) of messages, 0 where there is none; messages with fewer are filled with 0."""
    width = max((len(row) for row in rows if row is not None), default=0)
    found = np.zeros((len(rows), width), dtype)
    for place, row in enumerate(rows):
        if row is not None:
            found[place, : len(row)] = row
    return found


def _check_frames(rows: dict[str, _Rows]) -> None:
    frames = {f"`{topic}`": each.frame for topic, each in rows.items() if len(each.times)}
    if len(set(frames.values())) > 1:
        raise _frames_differ(frames)


def _frames_differ(frames: dict[str, str]) -> ArtifactError:
    return ArtifactError(
        "the poses of the recording are in different frames",
        code="DXB-A561",
        facts=frames,
        hint="record hands and head in one frame, such as WebXR's `local-floor`",
    )


def _nanoseconds(stamp: float) -> int:
    """A time [s] as whole nanoseconds, without the rounding of a product of large numbers."""
    whole = int(stamp // 1)
    return whole * reading.SECOND + round((stamp - whole) * reading.SECOND)
