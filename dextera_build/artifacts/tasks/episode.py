"""Episodes: recordings of a robot in a task at control rate, replayable from their start."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field

from dextera_build.artifacts.base import Array, Artifact, Value
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.core.content import Content, Get, OnDisk, Stored
from dextera_build.artifacts.core.identity import check
from dextera_build.artifacts.core.lazy import contents
from dextera_build.artifacts.tasks.reasons import tally
from dextera_build.artifacts.tasks.task import View, WorldKind
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.artifacts.tasks.variation import EXACT, Twist, Variation
from dextera_build.errors import ArtifactError

_MOST = 1 << 30
"""Largest film of one episode [bytes]: 24 min of 128 x 96 px at 20 Hz."""
_PIECE = 1 << 16
"""Packed bytes that are unpacked at a time."""

DEPTH_STEP_M = 0.001
"""Distance of one count of depth in films [m], that of ROS's REP 118."""

Origin = Literal["operator", "synthesis", "policy", "replay"]
"""Source of the actions."""


class Start(Artifact):
    """The complete initial state of an episode, with its random dynamics."""

    seed: int
    """Seed of the draw."""
    qpos: Annotated[np.ndarray, Array("Q", "float64")]
    """MuJoCo positions of the whole model."""
    ctrl: Annotated[np.ndarray, Array("A", "float64", unit="rad")]
    """Joint targets at the start."""
    mass_scale: dict[str, float]
    """Root body -> factor on all its masses and, in addition to that of its size, on its inertias."""
    size_scale: dict[str, float] = Field(default_factory=dict)
    """Root body -> factor on all its lengths, about its own origin; 1 for other bodies."""
    friction: dict[str, float]
    """Root body -> sliding friction coefficient."""
    gain_scale: float
    """Factor on stiffness and damping of the robot's position controllers; identified joints take a part of it, see
    `TaskBundle.gain_share`."""
    base_error: Twist = EXACT
    """Pose error of the robot's base in the world. The robot acts from the displaced base; objects and goals are
    expressed in the bundle's own `base_pose`."""
    variation: Variation = Variation()
    """Further random changes."""


class Segment(Value):
    """A part of a demonstration with its own task frame (Eq. 4a)."""

    name: str
    """`approach`, `grasp`, `lift`, ..."""
    first: int
    """First step."""
    last: int
    """One past the last step."""
    frame: str
    """The body relative to which palm poses are kept; `robot/base`: they are kept in the robot's base; empty: free
    motion that connects two segments."""
    contact: bool
    """Whether the hand should touch the task's object in this segment."""
    limbs: tuple[str, ...] = ()
    """Limbs that do this; empty: the only one. Several are coordinated: they share one transform of the frame."""


class Episode(Artifact):
    """One attempt. Arrays are sampled at control rate: row t is the observation, then the command."""

    start: Start
    """Its initial state."""
    origin: Origin
    """Source of the actions."""
    success: bool
    """Result of the task's success predicate."""
    reason: str
    """Reason for the failure; empty for a success."""
    sources: tuple[str, ...] = ()
    """Indices of the demonstrations that it was synthesised from, in order."""
    segments: tuple[Segment, ...] = ()
    """Parts of a demonstration, by their first step. Those of one limb do not overlap, those of several limbs may."""
    action: Annotated[np.ndarray, Array("T A", "float32", unit="rad")]
    """Intended joint targets: the label to learn from."""
    executed: Annotated[np.ndarray, Array("T A", "float32", unit="rad")]
    """Joint targets sent: `action` with added noise."""
    hand: Annotated[np.ndarray, Array("T L 7", "float32", frame="base")]
    """Palm pose of every limb: commanded, if the targets in `action` were computed from it (operator, synthesis),
    otherwise measured (policy, replay, limbs without a command): position [m] and unit quaternion w x y z, in the
    robot's base."""
    goal: Annotated[np.ndarray, Array("G", "float32")]
    """The goal in the observations of policies, see `dextera_build.artifacts.tasks.goals`."""
    terms: dict[str, Annotated[np.ndarray, Array("T ...", "float32")]]
    """Observed term -> its values; `dextera_build.policy.declared` and `Episodes.terms` describe them."""

    def values(self, term: str) -> np.ndarray:
        """Recorded values of a term: observed, commanded or the goal."""
        observed = self.terms.get(term)
        return np.asarray(getattr(self, term) if observed is None else observed)

    @property
    def joints(self) -> np.ndarray:
        """Measured positions of the robot's joints (T, A) [rad]."""
        return self.terms["joints"]

    @property
    def objects(self) -> np.ndarray:
        """Poses of the objects (T, O, 7) in the base: position [m] and unit quaternion w x y z."""
        return self.terms["objects"]

    @property
    def displacement(self) -> np.ndarray:
        """Positions of the objects' joints (T, K) [rad or m]."""
        return self.terms["displacement"]

    @property
    def contact(self) -> np.ndarray:
        """Force on each fingertip (T, F, 3) [N] in the base; privileged."""
        return self.terms["contact"]


class Episodes(Artifact):
    """Episodes of one task, readable without the task's model."""

    items: dict[str, Episode]
    """Index -> kept episode, in order."""
    failures: dict[str, Episode]
    """Index of the attempt -> discarded episode, with its reason."""
    attempts: int
    """Number of attempts behind `items` and `failures`."""
    task: str
    """Name of the task."""
    embodiment: str
    """Digest of joint names and limits, see `dextera_build.policy.contract`."""
    rate_hz: float
    """Control rate [Hz]."""
    joint_names: tuple[str, ...]
    """Names of the action's components and of `Episode.joints`."""
    object_names: tuple[str, ...]
    """Bodies of `Episode.objects`."""
    displacement_names: tuple[str, ...]
    """Joints of `Episode.displacement`."""
    tip_names: tuple[str, ...]
    """Fingertips of `Episode.contact`."""
    limb_names: tuple[str, ...]
    """Limbs of `Episode.hand`."""
    world: WorldKind = "twin"
    """Kind of world that they were recorded in: their domain, for training on several at once."""
    terms: dict[str, TermSpec] = Field(default_factory=dict)
    """Name of a term in `Episode.terms` that does not come with dxb -> its declaration."""

    @property
    def reasons(self) -> dict[str, int]:
        """Reason of failure -> count, most frequent first."""
        return tally(episode.reason for episode in self.failures.values())

    def in_order(self) -> list[tuple[str, Episode]]:
        """Accepted episodes with their indices, `2` before `10`; the store sorts keys of dictionaries as text."""
        return sorted(self.items.items(), key=lambda item: (len(item[0]), item[0]))


class Shard(Artifact):
    """A part of a data set that is one node: shards are built in parallel, and finished ones are reused."""

    first: int
    """Index of its first episode."""
    count: int
    """Number of episodes."""
    seed: int
    """Seed of the whole data set."""


class Film(Artifact):
    """Pictures of episodes through one camera, one per step, and the depth of each if it was asked for."""

    frames: dict[str, bytes]
    """Index -> frames of one episode as `packed`; the keys are those of `Episodes.items`."""
    width: int
    """Width of a frame [px]."""
    height: int
    """Height of a frame [px]."""
    depth: dict[str, bytes] = Field(default_factory=dict)
    """Index -> image-plane distances of one episode as `packed`, (H, W) uint16 in counts of `DEPTH_STEP_M`, 0 where
    nothing was measured; of all episodes or of none."""
    camera: Camera | None = None
    """Intrinsics at the size of a frame; None in a film without depth."""
    view: View | None = None
    """The camera, at the size of a frame; None: it was not stated."""

    @classmethod
    def _from_header(cls, header: Mapping[str, Any], get: Get) -> Self:
        """The film; from a store, the frames of each episode are read at their use."""
        if not hasattr(get, "place"):
            return super()._from_header(header, get)
        check(cls, header["artifact"])
        stored: dict[str, Any] = header["fields"]
        packed = {part: stored.get(part, {"$map": {}})["$map"] for part in ("frames", "depth")}
        rest = {**header, "fields": {**stored, **{part: {"$map": {}} for part in packed}}}
        made: Self = super()._from_header(rest, get)
        sources = {
            part: {name: Stored(get, *raw["$bytes"]) for name, raw in each.items()} for part, each in packed.items()
        }
        return made._behind(sources["frames"], sources["depth"])

    @classmethod
    def of(
        cls,
        files: Mapping[str, Path],
        width: int,
        height: int,
        depth: Mapping[str, Path] | None = None,
        camera: Camera | None = None,
        view: View | None = None,
    ) -> Film:
        """A film of files with frames as `packed` by index, which must no longer change; each is read at its use."""
        places = ({index: OnDisk(path) for index, path in each.items()} for each in (files, depth or {}))
        return cls(frames={}, width=width, height=height, camera=camera, view=view)._behind(*places)

    def _behind(self, frames: Mapping[str, Content], depth: Mapping[str, Content]) -> Self:
        # They would be copied, and thereby read, by validation.
        return self.model_copy(update={"frames": contents(frames), "depth": contents(depth)})

    @staticmethod
    def packed(pixels: Iterable[np.ndarray]) -> bytes:
        """Frames of whole numbers, all of one size, as a zlib stream of differences to the frame before, modulo 2^bits.

        Static regions cost almost nothing: a fifteenth of a PNG of the same frames, and faster in both directions. The
        encoding is lossless, so that a policy is trained on exactly the pixels that it gets at run time.
        """
        packer = zlib.compressobj(6)
        written, before = [], None
        for frame in pixels:
            written.append(packer.compress((frame if before is None else frame - before).tobytes()))
            before = frame
        return b"".join([*written, packer.flush()])

    def each(self, index: str) -> Iterator[np.ndarray]:
        """Frames (H, W, 3) uint8 sRGB of one episode in order, one at a time.

        Raises:
            ArtifactError: The stream is damaged, or does not end with a whole frame.
        """
        return _unpacked(self.frames, index, (self.height, self.width, 3), np.uint8)

    def each_depth(self, index: str) -> Iterator[np.ndarray]:
        """Distances (H, W) uint16 of one episode in order, one at a time, in counts of `DEPTH_STEP_M`.

        Raises:
            ArtifactError: The stream is damaged, or does not end with a whole frame.
        """
        return _unpacked(self.depth, index, (self.height, self.width), np.uint16)

    def pixels(self, index: str) -> np.ndarray:
        """Frames (T, H, W, 3) uint8 sRGB of one episode.

        Raises:
            ArtifactError: The stream is damaged, does not end with a whole frame, or holds more than 1 GiB.
        """
        return _stacked(index, self.each(index), (self.height, self.width, 3), np.uint8)

    def counts(self, index: str) -> np.ndarray:
        """Distances (T, H, W) uint16 of one episode, in counts of `DEPTH_STEP_M`.

        Raises:
            ArtifactError: As `pixels`.
        """
        return _stacked(index, self.each_depth(index), (self.height, self.width), np.uint16)


def _unpacked(
    packed: Mapping[str, bytes], index: str, shape: tuple[int, ...], kind: type[np.generic]
) -> Iterator[np.ndarray]:
    """The frames of one episode; see `Film.packed`."""
    if min(shape) < 1:
        raise _bad_film(index, f"its frames have no area ({shape[1]} x {shape[0]} px)")
    last, rest = np.zeros(shape, kind), b""
    size = last.nbytes
    for piece in _pieces(packed[index], index):
        rest += piece
        whole = len(rest) // size
        for change in np.frombuffer(rest[: whole * size], kind).reshape(whole, *shape):
            last = last + change
            yield last
        rest = rest[whole * size :]
    if rest:
        raise _bad_film(index, f"its last frame is not whole ({shape[1]} x {shape[0]} px)")


def _pieces(packed: bytes, index: str) -> Iterator[bytes]:
    """The differences in pieces, none larger than a thousand times `_PIECE`."""
    stream = zlib.decompressobj()
    try:
        for start in range(0, len(packed), _PIECE):
            yield stream.decompress(packed[start : start + _PIECE])
    except zlib.error as error:
        raise _bad_film(index, str(error)) from None
    if not stream.eof:
        raise _bad_film(index, "its end is missing")


def _stacked(index: str, frames: Iterable[np.ndarray], shape: tuple[int, ...], kind: type[np.generic]) -> np.ndarray:
    found: list[np.ndarray] = []
    for frame in frames:
        found.append(frame)
        if len(found) * frame.nbytes > _MOST:
            raise _bad_film(index, "more than 1 GiB")
    return np.array(found, kind).reshape(-1, *shape)


def _bad_film(index: str, why: str) -> ArtifactError:
    return ArtifactError(f"the film of episode {index} cannot be read", code="DXB-A113", facts={"why": why})
