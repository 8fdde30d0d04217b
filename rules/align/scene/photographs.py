"""align.photographs: the poses of further photographs of a scene, relative to the first one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pydantic import PositiveFloat, PositiveInt

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.cameras.further import Further, FurtherPhotographs
from dextera_build.artifacts.spatial.pose import Pose
from dextera_build.geometry import cameras, transforms
from dextera_build.geometry.photo_terms import Drawn
from dextera_build.rule import ROUNDING, Context, Fraction, Options, Tolerance, rule

from ..matches.matches_sift import SiftOptions
from . import beginning
from .beginning import Start
from .features import Features, features_of, paired
from .overlap import Agreement, Depths, agreement, refined

FEWEST = 12
"""Fewer points that agree on a pose are chance."""
APART_M, APART_DEG = 0.05, 4.0
"""Largest difference between a stated pose and the one that matched points give."""
STATED = (
    "`T_first_camera` maps points of its camera to those of the first one, in metres and OpenCV axes; leave it out to "
    "have it found"
)
MOVED = "nothing may move between the photographs; take them at one time, or remove this one from `photographs`"


class PhotographsOptions(Options):
    """Options of align.photographs."""

    points: PositiveInt = 4000
    """Maximum number of keypoints per picture, and of the same picture seen from above."""
    most_scale: PositiveFloat = 0.04
    """Maximum accepted relative difference between the lengths in two pictures."""
    least_overlap: Fraction = 0.15
    """Minimum fraction of a photograph whose place in another one is seen."""
    least_same: Fraction = 0.5
    """Minimum fraction of these places where both show the same surface."""
    least_things: Fraction = 0.35
    """The same of places on no table, floor or wall, which alone tell a motion along them."""


@rule(
    version=1,
    packages=("numpy", "opencv-python-headless", "pycolmap", "scipy"),
    tolerance=Tolerance({"": ROUNDING, "items.pose.matrix": 1e-5}),
)
def photographs(
    ctx: Context, photo: Capture, further: FurtherPhotographs, *, options: PhotographsOptions | None = None
) -> FurtherPhotographs:
    """Return the further photographs with T_camera_further [m], the first photograph's camera being the frame.

    A photograph without a stated pose is matched with the first one and with those that are placed already (SIFT); its
    pose follows from the matched points at their measured depth (LO-RANSAC), and is refined with all measured surfaces
    that both see. A stated pose is kept. Every pose is checked with the depth of both.

    Raises:
        RuleError: A photograph has no depth, cannot be placed, or contradicts the others.
    """
    options = options or PhotographsOptions()
    if not further.items:
        ctx.say("one photograph")
        return further
    ctx.check(
        photo.measured is not None,
        "the first photograph has no depth, so further ones cannot be placed",
        further=", ".join(one.file for one in further.items),
        hint="add its depth, or remove `photographs` from `capture.json`",
    )
    known, placed = [Depths.of(photo, np.eye(4))], dict[str, Further]()
    taken = [features_of(photo, options.points)]
    left = [(one, features_of(one.capture, options.points)) for one in further.items]
    while left:
        ctx.progress(len(placed), len(further.items), left[0][0].file)
        one, points, own, start = _next(ctx, left, known, taken)
        if start is not None:
            here, there = _pairs(own, start)
            own = replace(own, pose=refined(own, known, here, there))
        _tell(ctx, one.file, own, agreement(own, known), start, options)
        pose = Pose(parent="camera", child="further", matrix=own.pose)
        placed[one.file] = one.model_copy(update={"pose": pose})
        known.append(own)
        taken.append(points)
        left = [each for each in left if each[0] is not one]
    ctx.say("; ".join(_where(one) for one in placed.values()))
    return FurtherPhotographs(items=tuple(placed[one.file] for one in further.items))


def _next(
    ctx: Context, left: list[tuple[Further, Features]], known: list[Depths], taken: list[Features]
) -> tuple[Further, Features, Depths, Start | None]:
    """The photograph that is placed next: one with a stated pose, or the one with the most matches."""
    tried: list[tuple[Start, Further, Features]] = []
    for one, points in left:
        starts = [_matched(one.capture, points, *each) for each in zip(known, taken, strict=True)]
        found = [start for start in starts if start is not None and len(start.matches) >= FEWEST]
        if one.pose is not None:
            _compare(ctx, one, found, known)
            return one, points, Depths.of(one.capture, one.pose.matrix), None
        tried += [(start, one, points) for start in found]
    best = max(tried, key=lambda each: len(each[0].matches), default=None)
    if best is None:
        ctx.fail(
            f"`{left[0][0].file}` cannot be placed: it shares no view with the other photographs",
            points=f"fewer than {FEWEST} agree on a pose",
            photographs=", ".join(one.file for one, _ in left),
            hint="take it of the same scene, from at most 40 degrees beside another photograph; state its "
            "`T_first_camera` if it is known; or remove it from `photographs`",
        )
    start, one, points = best
    return one, points, Depths.of(one.capture, start.pose.scene_from_camera), start


def _compare(ctx: Context, one: Further, found: list[Start], known: list[Depths]) -> None:
    """Refuse a stated pose that matched points contradict; the depth of a bare table contradicts few poses."""
    if not found or one.pose is None:
        return
    best = max(found, key=lambda start: len(start.matches))
    own = Depths.of(one.capture, best.pose.scene_from_camera)
    apart = transforms.invert(one.pose.matrix) @ refined(own, known, *_pairs(own, best))
    distance, angle = float(np.linalg.norm(apart[:3, 3])), float(np.degrees(transforms.angle(apart[:3, :3])))
    if distance > APART_M or angle > APART_DEG:
        ctx.fail(
            f"`{one.file}` contradicts the other photographs: its stated pose is not where they see it from",
            off=f"{distance:.2f} m and {angle:.0f} deg from where {len(best.matches)} points place it",
            hint=STATED,
        )


def _matched(capture: Capture, points: Features, other: Depths, anchors: Features) -> Start | None:
    """The pose of a capture in the first camera's frame, from points that it shares with another one."""
    pairs = paired(anchors, points, SiftOptions().ratio)
    rgb = other.capture.photograph.rgb.pixels
    drawn = Drawn(rgb / 255.0, other.depth, np.ones(other.depth.shape))
    return beginning.given(capture, other.capture.photograph.camera, pairs, (other.pose, drawn))


def _pairs(own: Depths, start: Start) -> tuple[np.ndarray, np.ndarray]:
    """Matched points (M, 3) in the camera's frame and in that of the first one [m]."""
    measured = start.matches.depths > 0
    pixels, depths = start.matches.pixels[measured], start.matches.depths[measured]
    return cameras.directions(pixels, own.k) * depths[:, None], start.matches.anchors[measured]


def _tell(
    ctx: Context, name: str, own: Depths, found: Agreement, start: Start | None, options: PhotographsOptions
) -> None:
    """Refuse a photograph that contradicts the others; metrics of one that does not."""
    facts = {
        "overlap": f"{found.overlap:.0%} of it, {options.least_overlap:.0%} needed",
        "agree": f"{found.same:.0%} of that within 2 cm, {options.least_same:.0%} needed",
        "things": f"{found.things:.0%} of what is on no table or wall, {options.least_things:.0%} needed",
    }
    if start is not None and abs(start.pose.scale - 1.0) > options.most_scale:
        ctx.fail(
            f"lengths in `{name}` are {start.pose.scale:.3f} times those in the other photographs",
            believed=f"1 ± {options.most_scale:g}",
            hint="its depth has another unit, or it was taken with another focal length: all photographs need the "
            "intrinsics and `depth_scale_m` of `capture.json`",
        )
    few = found.same < options.least_same or found.things < options.least_things
    if few or found.overlap < options.least_overlap:
        stated = "its stated pose" if start is None else "what it shows"
        ctx.fail(
            f"`{name}` contradicts the other photographs: {stated} does not fit their depth",
            **facts,
            hint=STATED if start is None else MOVED,
        )
    ctx.metric(f"{name}: overlap", 100.0 * found.overlap, "%")
    ctx.metric(f"{name}: residual", 1000.0 * found.residual_m, "mm")
    if start is not None:
        ctx.metric(f"{name}: points", float(len(start.matches)))


def _where(one: Further) -> str:
    """`left.png 0.42 m and 31 deg from the first`."""
    assert one.pose is not None
    distance, angle = np.linalg.norm(one.pose.matrix[:3, 3]), np.degrees(transforms.angle(one.pose.matrix[:3, :3]))
    return f"{one.file} {distance:.2f} m and {angle:.0f} deg from the first"
