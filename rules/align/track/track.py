"""align.track: pose of objects in every frame of an RGB-D video."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol

import numpy as np
from pydantic import NonNegativeInt, PositiveFloat

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame, RgbdVideo
from dextera_build.artifacts.objects.object import Asset, Support
from dextera_build.artifacts.spatial.tracking import Tracking
from dextera_build.geometry import transforms
from dextera_build.rule import ROUNDING, Context, Options, Tolerance, rule
from dextera_build.tracking.tracked_object import Tracked

from . import overlay
from .reported import reported


class TrackOptions(Options):
    """Options of align.track."""

    first: NonNegativeInt | None = None
    """Number of the frame in which the objects are at their placements, by default that of the masks, or 0; earlier
    frames are tracked backwards."""
    camera: Literal["stands", "stated", "unknown"] = "stands"
    """Whether the camera is static, moves as the video states, or moves in an unknown way. Poses are in the world of
    the assets, or in the frame of the camera if its motion is unknown."""
    tall_m: PositiveFloat = 0.005
    """Minimum diameter of an object; a smaller one suggests a mesh in another unit than metres [m]."""


@dataclass(frozen=True)
class Job:
    """Input of a backend."""

    video: RgbdVideo
    numbers: Sequence[int]
    """Frames in the order in which they are tracked."""
    assets: dict[str, Asset]
    starts: dict[str, np.ndarray]
    """Name -> T_camera_object (4, 4) in the first of these frames."""
    moves: Literal["stands", "stated", "unknown"]
    """See `TrackOptions.camera`."""
    masks: MaskTrack | None

    def frames(self) -> Iterator[tuple[RgbdFrame, dict[str, np.ndarray] | None]]:
        """Frames in this order, and (H, W) bool by name if there are masks."""
        for number, frame in zip(self.numbers, self.video.frames(self.numbers), strict=True):
            yield frame, self.shown(number)

    def shown(self, number: int) -> dict[str, np.ndarray] | None:
        """Name -> (H, W) bool of a frame; None without masks."""
        if self.masks is None:
            return None
        labels = self.masks.labels(number)
        return {name: labels == label for label, name in enumerate(self.masks.names, 1) if name in self.assets}


class TrackBackend(Protocol):
    """Interface of a backend of align.track."""

    def track(self, ctx: Context, job: Job, options: Any) -> list[dict[str, Tracked]]:
        """State of each object in each frame of the job."""
        ...


# A filter propagates rounding differences from frame to frame, and pixels at a threshold come and go.
@rule(
    version=3,
    packages=("numpy", "opencv-python-headless", "open3d"),
    tolerance=Tolerance({"": ROUNDING, "tracks.poses": 0.01, "tracks.covariances": 1e-3}),
)
def track(
    ctx: Context[TrackBackend],
    video: RgbdVideo,
    assets: Collection[Asset],
    support: Support,
    masks: MaskTrack | None = None,
    *,
    options: TrackOptions | None = None,
) -> Tracking:
    """Return T_world_object of every asset in every frame [m], with covariance and status, and the joints' positions.

    `support` holds T_world_camera of the frame `first`. A pose is `tracked` if the frame confirms it, `predicted` if it
    was extrapolated for a short time, and `lost` otherwise; masks of a video segmentation reveal drift.
    """
    options = options or TrackOptions()
    first = _first(ctx, video, masks, options)
    _check(ctx, video, assets.items, masks, options)
    world = support.camera_pose.matrix
    starts = {name: transforms.invert(world) @ asset.pose.matrix for name, asset in assets.items.items()}
    found: dict[int, dict[str, Tracked]] = {}
    count = len(video.stamps)
    for numbers in (range(first, count), range(first, -1, -1)):
        if len(numbers) > 1 or not found:
            job = Job(video, numbers, assets.items, starts, options.camera, masks)
            found |= dict(zip(numbers, ctx.backend.track(ctx, job, ctx.backend_options), strict=True))
    rows = [found[number] for number in range(count)]
    made = reported(video, assets.items, rows, _cameras(video, world, options.camera, first))
    for name, each in made.tracks.items():
        ctx.metric(f"tracked.{name}", each.status.count("tracked") / count, "fraction")
    ctx.preview(overlay.draw(video, assets.items, rows), "outlines in the first, the middle and the last frame")
    ctx.say(_summary(made))
    return made


def _first(ctx: Context[Any], video: RgbdVideo, masks: MaskTrack | None, options: TrackOptions) -> int:
    """Number of the frame in which the objects are at their placements."""
    given = None if masks is None else masks.first
    if given is not None and options.first not in (None, given):
        ctx.fail(
            "the masks were given in another frame than the placements",
            first=options.first,
            masks=f"given in frame {given}",
            hint="state the number of the photograph's frame as option `frame` of align.follow only",
        )
    first = given if options.first is None else options.first
    first = 0 if first is None else first
    ctx.check(first < len(video.stamps), f"the video has no frame {first}", frames=f"0 to {len(video.stamps) - 1}")
    return first


def _check(
    ctx: Context[Any], video: RgbdVideo, assets: dict[str, Asset], masks: MaskTrack | None, options: TrackOptions
) -> None:
    ctx.check(bool(assets), "there is no asset to track", hint="build assets first: `twin/tabletop`")
    ctx.check(
        options.camera != "stated" or video.poses is not None,
        "the video does not state how its camera moves",
        hint="set option `camera` to `unknown`, or write `T_world_camera` for every view",
    )
    if masks is not None:
        ctx.check(
            np.array_equal(masks.stamps, video.stamps) and (masks.height, masks.width) == _size(video),
            "the masks are not those of this video",
            masks=", ".join(masks.facts()),
            video=", ".join(video.facts()),
        )
    for name, asset in assets.items():
        size = max(float(np.ptp(link.mesh.vertices, axis=0).max()) for link in asset.body.links.values())
        # Trackers fail silently on meshes in millimetres and on assets of unknown scale.
        ctx.check(
            options.tall_m <= size <= 3.0 and asset.scale != "unknown",
            f"the mesh of `{name}` is hardly in metres",
            size=f"{size:g} m",
            scale=asset.scale,
            hint="scale the asset by `align.scale`, or measure depth",
        )


def _size(video: RgbdVideo) -> tuple[int, int]:
    return video.camera.height, video.camera.width


def _cameras(video: RgbdVideo, world: np.ndarray, moves: str, first: int) -> np.ndarray | None:
    """T_world_camera (N, 4, 4) of each frame in the world of the assets; None if unknown."""
    if moves == "unknown":
        return None
    if moves == "stands":
        return np.tile(world, (len(video.stamps), 1, 1))
    assert video.poses is not None
    return np.asarray(world @ transforms.invert(video.poses[first]) @ video.poses)


def _summary(made: Tracking) -> str:
    def told(name: str) -> str:
        status = made.tracks[name].status
        return f"{name} {status.count('tracked')}" + (f" ({status.count('lost')} lost)" if "lost" in status else "")

    frames = len(next(iter(made.tracks.values())).status)
    return f"tracked in {frames} frames: " + ", ".join(map(told, made.tracks))
