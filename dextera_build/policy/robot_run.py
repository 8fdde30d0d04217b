"""The recording of a robot's run: what was measured, requested and sent in each control period, as `dxb run` writes it.

Joints have the names and signs of the robot model, whatever the robot calls them, and poses are in its base frame.
"""

from __future__ import annotations

import bisect
import io
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import IO, Any

import numpy as np

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError, listing
from dextera_build.formats.ros import images, reading
from dextera_build.policy.declared import BY_NAME
from dextera_build.policy.layout import WORLD, WORLDS, embodiment
from dextera_build.policy.observation import Measurement

OBSERVED, NEWEST, REQUESTED, SENT = "/observed", "/newest", "/requested", "/sent"
"""What stands before the topic of a declared term: as the policy or operator was given it, as it was measured last, as
it was requested, and as it was sent after the guard."""
ABOUT = "/dxb/about"
"""Topic of facts about a run, a JSON object of texts, at its beginning."""
STATUS = "/dxb/status"
"""Topic of what a run does; the last message says why it ended."""
VERDICT = "/dxb/verdict"
"""Topic of the verdicts, a JSON object: `measured` and `operator` are true, false, or null for none."""
STOPPED = "stopped: "
"""Beginning of the status after which nothing is sent."""
PICTURES = "sensor_msgs/msg/CompressedImage"
REAL = "real"
"""World of a run whose robot does not say that it is simulated."""


def topic(prefix: str, term: str) -> str:
    """Topic of a declared term: `/observed/joint_states`."""
    return prefix + BY_NAME[term].topic


def told(bundle: TaskBundle, contract: PolicyContract) -> TaskBundle:
    """The task as a policy on a robot is told it: in the world `real` if input `world` knows that one."""
    known = next((channel.names for channel in contract.inputs if channel.name == WORLD), ())
    return bundle.model_copy(update={"kind": REAL}) if REAL in known else bundle


@dataclass(frozen=True)
class RobotRun:
    """A run of T control periods."""

    about: Mapping[str, str]
    """Facts: `task`, `embodiment`, `world`, `policy`, `algorithm`, `origin`, `rate_hz`, versions and limits."""
    times: np.ndarray
    """When each of `measured` was taken, by the clock of the recording [ns]."""
    made: np.ndarray
    """When each of `joints` was made (S,), by the same clock [ns]."""
    joints: np.ndarray
    """Positions (S, A) [rad or m] that were measured last; those of `measured` are as old as a picture."""
    commanded: np.ndarray
    """When each command was sent (T,), by the same clock [ns]."""
    measured: tuple[Measurement, ...]
    """What was measured before each command, and after the last one (T or T + 1); NaN where nothing was."""
    requested: np.ndarray
    """Joint targets (T, A) [rad or m] that the policy or operator requested."""
    sent: np.ndarray
    """Joint targets (T, A) [rad or m] that were sent, within limits."""
    operator: bool | None
    """The operator's verdict; None: not asked."""
    ended: str
    """Why it ended."""

    @property
    def complete(self) -> bool:
        """Whether all objects and their joints were measured at all times."""
        return all(each.placed for each in self.measured)

    @property
    def silence_s(self) -> float:
        """Longest time for which a picture or a pose may be the newest one, by the limits of the run [s]."""
        limits = self.about.get("limits")
        return (Limits.model_validate_json(limits) if limits else Limits()).silence_s


def every(given: File | Folder, bundle: TaskBundle) -> dict[str, RobotRun]:
    """Name -> run of a recording, or of all recordings `.mcap` of a folder, by name.

    Args:
        given: The recording or the folder.
        bundle: The task that was run.

    Raises:
        RuleError: There is none, or one is of another task or robot.
        ArtifactError: A file is damaged, or was not finished.
    """
    return {name: read(stream, f"{name}.mcap", bundle) for name, stream in recordings(given)}


def recordings(given: File | Folder) -> Iterator[tuple[str, IO[bytes]]]:
    """Name and content of a recording, or of all recordings `.mcap` of a folder, by name.

    Raises:
        RuleError: There is none.
    """
    if isinstance(given, File):
        with given.open() as stream:
            yield "run", stream
        return
    names = sorted(name for name in given.files if name.endswith(".mcap"))
    if not names:
        raise RuleError(
            "the folder holds no recording `.mcap`",
            code="DXB-B551",
            facts={"files": listing(given.files)},
            hint="`dxb run TASK ... --out FOLDER/1.mcap` writes one",
        )
    for name in names:
        yield name.removesuffix(".mcap").replace("/", "-"), io.BytesIO(given.files[name])


def read(stream: IO[bytes], name: str, bundle: TaskBundle) -> RobotRun:
    """The run in a recording.

    Args:
        stream: The file.
        name: Its name, for errors.
        bundle: The task that was run.

    Raises:
        RuleError: It is no recording of a run, or of another task or robot.
        ArtifactError: It is damaged, or was not finished.
    """
    reading.index(stream, name)
    return _read(stream, name, bundle, "").run()


def filmed(stream: IO[bytes], name: str, bundle: TaskBundle) -> tuple[RobotRun, Iterator[np.ndarray]]:
    """The run in a recording, and for each of its `times` the picture (H, W, 3) uint8 sRGB that had arrived last.

    The file is read once; pictures stay encoded until they are asked for. Arguments and errors are those of `read`.

    Raises:
        RuleError: It has no camera, or several, or none of its pictures is new enough for a command, by its limits.
    """
    cameras = [each.topic for each in reading.index(stream, name)[0] if each.kind == PICTURES]
    if len(cameras) != 1:
        raise RuleError(
            f"`{name}` has the pictures of {listing(cameras) if cameras else 'no camera'}, not of one",
            code="DXB-B556",
            hint="`--view` of `dxb run` and `dxb robot record` records those of one camera",
        )
    found = _read(stream, name, bundle, cameras[0])
    run = found.run()
    return run, _arrived(found.pictures, cameras[0], run, name)


def evenly(run: RobotRun) -> RobotRun:
    """The run at even times, as if no command had been late, with the joints of the times of the commands.

    Joints are interpolated between the newest joint states. Targets that were sent are those that a controller reaches
    at the end of each period; between two commands that were far apart in time it waits. Poses of objects are those
    that were given in the same period.
    """
    period, sent = round(reading.SECOND / float(run.about["rate_hz"])), run.commanded
    if len(sent) < 2:
        return run
    times = np.arange(sent[0], sent[-1] + period // 2, period)
    rows = np.searchsorted(sent, times + period // 2, side="right") - 1
    # From the first of the times, because doubles do not hold nanoseconds since 1970.
    places = [np.interp(times - sent[0], run.made - sent[0], each) for each in run.joints.T]
    measured = [replace(run.measured[row], joints=each) for row, each in zip(rows, np.transpose(places), strict=True)]
    return replace(
        run,
        times=times,
        commanded=times,
        measured=(*measured, *run.measured[len(sent) :]),
        requested=run.requested[rows],
        sent=_reached(times + period, run, period),
    )


def _reached(times: np.ndarray, run: RobotRun, period: int) -> np.ndarray:
    """Targets (N, A) at times (N,) [ns] of a controller that goes to each command in a straight line of one period."""
    first = run.commanded[0]
    knots, values = [0], [run.joints[0]]
    for time, target in zip(run.commanded - first, run.sent, strict=True):
        # A command that comes before the last one is reached replaces it.
        here = np.array([np.interp(time, knots, column) for column in np.transpose(values)])
        kept = [at < time for at in knots]
        knots = [at for at, keep in zip(knots, kept, strict=True) if keep] + [time, time + period]
        values = [value for value, keep in zip(values, kept, strict=True) if keep] + [here, target]
    return np.stack([np.interp(times - first, knots, column) for column in np.transpose(values)], axis=-1)


def _read(stream: IO[bytes], name: str, bundle: TaskBundle, camera: str) -> _Found:
    """What the messages of a recording say, with the pictures of a topic, if one is named."""
    found = _Found(bundle, name, camera)
    wanted = [topic(OBSERVED, term) for term in ("joints", "objects", "displacement")]
    wanted += [
        topic(NEWEST, "joints"),
        topic(REQUESTED, "action"),
        topic(SENT, "action"),
        ABOUT,
        STATUS,
        VERDICT,
        *filter(None, [camera]),
    ]
    stream.seek(0)
    with reading.damage(name):
        for time, where, message in reading.messages(stream, name, wanted):
            found.add(time, where, message)
    _check(found.about, name, bundle)
    return found


def _arrived(pictures: Sequence[tuple[int, Any]], camera: str, run: RobotRun, name: str) -> Iterator[np.ndarray]:
    at, last, pixels = [time for time, _ in pictures], -1, None
    for time in run.times:
        row = bisect.bisect_right(at, time) - 1
        if row < 0:
            raise RuleError(f"`{name}` has no picture before the first command", code="DXB-B557")
        if (age_s := (time - at[row]) / reading.SECOND) > run.silence_s:
            raise RuleError(
                f"the camera of `{name}` gave no picture for {age_s:.2f} s, more than {run.silence_s:g} s",
                code="DXB-B559",
                facts={"after": f"{(at[row] - run.times[0]) / reading.SECOND:.2f} s of the run"},
                hint="take the recording out of the folder: its last pictures show what was before",
            )
        if pixels is None or row != last:
            pixels, last = images.pixels(pictures[row][1], camera), row
        yield pixels


def _check(about: Mapping[str, str], name: str, bundle: TaskBundle) -> None:
    wanted = {
        "task": ("task", [bundle.task.name]),
        "robot": ("embodiment", [embodiment(bundle.robot)]),
        "control rate": ("rate_hz", [f"{bundle.task.control_hz:g}"]),
        "kind of world": ("world", WORLDS),
    }
    for what, (fact, values) in wanted.items():
        if about.get(fact) not in values:
            raise RuleError(
                f"`{name}` is of another {what}" if about else f"`{name}` is no recording of `dxb run`",
                code="DXB-B552",
                facts={"recorded": about.get(fact, "nothing"), "needed": listing(values)},
                hint="give the task that was run as `task`",
            )


@dataclass
class _Found:
    """What the messages of a recording say so far."""

    bundle: TaskBundle
    name: str
    camera: str = ""
    pictures: list[tuple[int, Any]] = field(default_factory=list)
    """When each encoded picture of `camera` arrived [ns], in order."""
    about: dict[str, str] = field(default_factory=dict)
    verdict: dict[str, bool | None] = field(default_factory=dict)
    status: str = ""
    newest: dict[int, dict[str, Any]] = field(default_factory=dict)
    """When a joint state was made [ns] -> values by name."""
    places: dict[str, dict[int, dict[str, Any]]] = field(default_factory=dict)
    """Topic -> time -> values by name."""

    def add(self, time: int, where: str, message: Any) -> None:
        """Take a message."""
        if where == ABOUT:
            self.about = _object(message.data)
        elif where == VERDICT:
            self.verdict = _object(message.data)
        elif where == STATUS:
            self.status = message.data
        elif where == self.camera:
            self.pictures.append((time, message))
        elif where == topic(NEWEST, "joints"):
            self.newest[reading.stamp(message, time)] = dict(_named(where, message))
        else:
            self.places.setdefault(where, {})[time] = dict(_named(where, message))

    def run(self) -> RobotRun:
        """The run.

        Raises:
            ArtifactError: A message that another one needs is missing.
        """
        with reading.damage(self.name):
            return self._run()

    def _run(self) -> RobotRun:
        requested = self.places.get(topic(REQUESTED, "action"), {})
        sent = self.places.get(topic(SENT, "action"), {})
        observed = self.places.get(topic(OBSERVED, "joints"), {})
        times, seen = sorted(requested.keys() & sent.keys()), np.array(sorted(observed), np.int64)
        # Each command follows from the last measurement before it.
        rows = [int(seen[np.searchsorted(seen, time, side="right") - 1]) for time in times]
        rows += [int(time) for time in seen[seen > (times[-1] if times else 0)][:1]]
        joints = [joint.name for joint in self.bundle.robot.joints]
        newest = self.newest or observed  # older recordings hold no others
        return RobotRun(
            about=self.about,
            times=np.array(rows, np.int64),
            made=np.array(sorted(newest), np.int64),
            joints=_table([newest[made] for made in sorted(newest)], joints),
            commanded=np.array(times, np.int64),
            measured=tuple(self._measurement(row) for row in rows),
            requested=_table([requested[time] for time in times], joints),
            sent=_table([sent[time] for time in times], joints),
            operator=self.verdict.get("operator"),
            ended=self.status.removeprefix(STOPPED),
        )

    def _measurement(self, time: int) -> Measurement:
        bundle = self.bundle
        of = {term: self.places.get(topic(OBSERVED, term), {}).get(time, {}) for term in ("objects", "displacement")}
        lost = np.full(7, np.nan)
        joints = self.places[topic(OBSERVED, "joints")][time]
        return Measurement(
            joints=_table([joints], [joint.name for joint in bundle.robot.joints])[0],
            objects=np.array([of["objects"].get(name, lost) for name in bundle.objects]).reshape(-1, 7),
            displacement=np.array([of["displacement"].get(name, np.nan) for name in bundle.displacement_names]),
        )


def _object(text: str) -> dict[str, Any]:
    """A JSON object."""
    found = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError(f"`{text[:40]}` is no JSON object")
    return found


def _named(where: str, message: Any) -> Iterator[tuple[str, Any]]:
    """Name -> position, target or pose (7,) of a message."""
    if where == topic(OBSERVED, "objects"):
        for each in message.transforms:
            at, turn = each.transform.translation, each.transform.rotation
            yield each.child_frame_id, np.array([at.x, at.y, at.z, turn.w, turn.x, turn.y, turn.z])
    elif hasattr(message, "points"):
        yield from zip(message.joint_names, message.points[0].positions, strict=True)
    else:
        yield from zip(message.name, message.position, strict=True)


def _table(rows: list[dict[str, Any]], names: list[str]) -> np.ndarray:
    """Values (N, A) of named columns.

    Raises:
        RuleError: A column is missing.
    """
    missing = sorted({name for row in rows for name in names if name not in row})
    if missing:
        raise RuleError(f"the recording lacks the joints {listing(missing)}", code="DXB-B553")
    return np.array([[row[name] for name in names] for row in rows], np.float64).reshape(len(rows), len(names))
