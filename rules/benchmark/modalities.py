"""benchmark.modalities: colours, masks and depth of the twin beside those of the photograph (paper, figure 5)."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.cameras.camera import Measured, Photograph
from dextera_build.artifacts.cameras.image import Image, smaller
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.geometry import metrics
from dextera_build.geometry.plot import COLOURS
from dextera_build.rule import Context, rule
from dextera_build.sim.model.names import body_names

from ..evaluate.panels import GAP, PAPER, beside, lettering, titled

_PALE = (225, 228, 232)


class ModalitiesBackend(Protocol):
    """Interface of a backend of benchmark.modalities."""

    def render(self, ctx: Context, scene: Scene, options: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What the twin shows through camera `capture`, without custom flags or lights.

        Returns:
            Colours (H, W, 3) uint8; the index of each pixel's object in `bodies` and `held` of the scene, (H, W) int32,
            or -1; image-plane z (H, W) float32 [m], 0 if empty.
        """
        ...


@rule(version=1)
def modalities(
    ctx: Context[ModalitiesBackend],
    photograph: Photograph,
    objects: Segmentation,
    scene: Scene,
    measured: Measured | None = None,
) -> Image:
    """Return a picture of the twin (left) and the photograph (right): colours, masks and, if it was measured, depth.

    An object has one colour on both sides, and both depths have one scale. `mask_iou` is the mean over the objects of
    the photograph, those that the twin lacks counted as 0; `depth_difference` the median where both have a depth [m].
    """
    size = photograph.rgb.pixels.shape[:2]
    if size != (scene.camera.height, scene.camera.width):
        ctx.fail(
            "the scene's camera is not the photograph's",
            photograph=f"{size[1]} x {size[0]} px",
            scene=f"{scene.camera.width} x {scene.camera.height} px",
        )
    rgb, owner, depth = ctx.backend.render(ctx, scene, ctx.backend_options)
    bodies, names = (*scene.bodies, *scene.held), body_names(objects.names)
    numbers = [bodies.index(names[name]) if names[name] in bodies else -2 for name in objects.names]
    twin = np.zeros(size, np.int32)
    for label, number in enumerate(numbers, start=1):
        twin[owner == number] = label
    seen = objects.map.labels
    overlaps = [metrics.mask_iou(twin == label, seen == label) for label in range(1, len(numbers) + 1)]
    if overlaps:
        ctx.metric("mask_iou", float(np.mean(overlaps)))
    rows = [[("twin", rgb), ("photograph", photograph.rgb.pixels)]]
    rows.append([("twin, masks", _painted(twin)), ("photograph, masks", _painted(seen))])
    if measured is not None:
        rows.append(_depths(ctx, depth, measured.depth.depth))
    picture = _board(rows)
    ctx.say(f"masks of {len(overlaps)} objects" + (" and depth" if measured is not None else ", no measured depth"))
    ctx.preview(picture, f"left: twin; right: photograph; {', '.join(objects.names)}")
    return Image(pixels=picture)


def _painted(labels: np.ndarray) -> np.ndarray:
    """One colour per label, (H, W, 3) uint8."""
    palette = np.array([COLOURS[number % len(COLOURS)] for number in range(max(int(labels.max()), 1))], np.uint8)
    return np.where(labels[..., None] > 0, palette[labels - 1], np.array(_PALE, np.uint8))


def _depths(ctx: Context, twin: np.ndarray, seen: np.ndarray) -> list[tuple[str, np.ndarray]]:
    """Both depths [m] on the scale of the measured one, near is bright, black where there is none."""
    both = (twin > 0) & (seen > 0)
    if both.any():
        ctx.metric("depth_difference", float(np.median(np.abs(twin - seen)[both])), "m")
    near, far = np.percentile(seen[seen > 0], (1, 99)) if (seen > 0).any() else (0.0, 1.0)
    found = []
    for title, depth in (("twin", twin), ("photograph", seen)):
        share = np.clip((depth - near) / max(far - near, 1e-6), 0, 1)
        grey = np.where(depth > 0, 255 - 195 * share, 0).astype(np.uint8)
        found.append((f"{title}, depth {near:.2f} to {far:.2f} m", np.repeat(grey[..., None], 3, axis=2)))
    return found


def _board(rows: list[list[tuple[str, np.ndarray]]]) -> np.ndarray:
    panes = [[(title, smaller(pixels)) for title, pixels in row] for row in rows]
    size = lettering(2 * panes[0][0][1].shape[1])
    lines = [beside(titled(*left[::-1], size), titled(*right[::-1], size), axis=1) for left, right in panes]
    whole = lines[0]
    for line in lines[1:]:
        whole = beside(whole, line, axis=0)
    return np.pad(whole, ((GAP, GAP), (GAP, GAP), (0, 0)), constant_values=PAPER[0])
