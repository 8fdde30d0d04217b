"""background.static by planes: fills the support in its own plane, everything else in the image."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import cv2
import numpy as np
from pydantic import Field, NonNegativeFloat, PositiveFloat

from dextera_build.artifacts.cameras.camera import Camera, Photograph
from dextera_build.artifacts.objects.object import Support
from dextera_build.artifacts.objects.view import InstanceMap
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.geometry import cameras, transforms
from dextera_build.rule import Backend, Context, Fraction, Options

from . import walls
from .behind import Behind
from .furnished import bounded, feet_of, furnished, seen_of, survey, trimmed
from .holes import hole, remnants, scraps, shaded
from .layers import SAME_COLOUR, Layers, apart, grown, split
from .rectified import top_view
from .synthesis import fill_texture, membrane, smooth_part

if TYPE_CHECKING:
    from .static import StaticOptions

BACKEND = Backend(
    summary="a layered mesh: planes and smooth surfaces of the photograph, a slab for the support, a closed room",
    profiles=("cpu",),
    packages=("opencv-python-headless",),
    extra="twin",
)


SOFT = 0.006
"""Width next to a mask, as a fraction of the picture's width, in which pixels mix the colours of both sides."""
MOST_SHADE = 1.08
"""Gain of what a further photograph shows above which it lies in a shadow; a surface has a coarse pattern if it needs
a larger one elsewhere."""
LEAST_GAIN, MOST_GAIN = 1.0 / MOST_SHADE, 1.6
"""Minimum and maximum gain when removing shadows and reflections. A shadow only darkens, and light that an object
reflects adds little, so that a brighter part of the surface is its own."""
TEXTURE = 0.95
"""Part of the surface away from objects whose differences from the smooth illumination are its pattern."""


class PlanesOptions(Options):
    """Options of backend `planes` of background.static."""

    dilate: Fraction = 0.025
    """Reach of contact shadows on the support and of errors of a robot's mask, as a fraction of the width."""
    shadow_reach_m: NonNegativeFloat = 0.1
    """Distance from a mask on the support within which shadows are lightened [m]; 0 keeps them."""
    texel_m: PositiveFloat = 0.001
    """Smallest texel of the rectified support [m]."""
    snap_m: NonNegativeFloat = 0.015
    """Surfaces within this height of the support are snapped to it [m]."""
    stride: float = Field(0.008, gt=0.0, le=1.0)
    """Spacing of the vertices of curved surfaces in the photograph, as a fraction of its width."""
    step_m: PositiveFloat = 0.03
    """Depth difference above which surfaces are not joined [m]."""
    farthest_m: PositiveFloat = 8.0
    """Greater depths are treated as unknown [m]."""


def clean(
    ctx: Context,
    photograph: Photograph,
    depth: np.ndarray,
    support: Support,
    instances: InstanceMap,
    robot: np.ndarray,
    behind: Behind | None,
    common: StaticOptions,
    options: PlanesOptions,
) -> Background:
    """Remove objects and robot from photograph and depth, and reconstruct the room without them."""
    cv2.setNumThreads(1)
    depth = np.where(depth > options.farthest_m, 0.0, depth).astype(np.float32)
    nothing = instances.model_copy(update={"labels": np.zeros_like(instances.labels)})
    # A robot's pixels come from a model and a calibration, so they are inexact.
    taken = hole(instances, robot, SOFT) | hole(nothing, robot, options.dilate)
    wide = hole(instances, robot, options.dilate)
    layers = split(photograph, depth, support, wide, options.snap_m)
    own = shaded(photograph.rgb.pixels, layers.level & layers.behind, taken)
    missed = remnants(~own & ~taken, wide, _flat(photograph, depth, support, options), depth == 0)
    taken |= (wide & ((layers.behind & own) | missed)) | scraps(~own & ~taken, wide)
    layers = apart(split(photograph, depth, support, taken, options.snap_m), own)
    layers = bounded(layers, photograph, support)
    image, empty, known = photograph.rgb.pixels.astype(np.float32), np.where(taken, 0.0, depth), np.zeros_like(taken)
    if behind is not None:
        known = taken & behind.mask
        image, empty = np.where(known[..., None], behind.pixels, image), np.where(known, behind.depth, empty)
        flat = _flat(photograph, behind.depth, support, options)
        layers = replace(layers, behind=np.where(known, flat, layers.behind))
    bare = taken & ~layers.behind & ~known
    beyond = bare & layers.beyond
    whole = replace(layers, behind=layers.behind | beyond)
    if (taken & whole.behind).any():
        image = _fill_support(image, whole, own, known, photograph.camera, support, options)
    pixels = np.clip(np.round(image), 0, 255).astype(np.uint8)
    # The support's outline is known to a few pixels only: its colour must not bleed into the surfaces behind it.
    near = grown(whole.behind, max(1, round(0.01 * taken.shape[1])))
    pixels = _inpaint(pixels, bare & ~beyond, near)
    scenery = survey(pixels, empty, layers.behind, bare, beyond, photograph.camera, support, options.step_m)
    scenery, rim = trimmed(scenery, layers, support)
    scenery = replace(scenery, pixels=walls.filled(scenery, bare | rim))
    things = seen_of(instances.labels > 0, depth, photograph.camera, support)
    stride = max(1.0, options.stride * photograph.camera.width)
    feet = feet_of(instances.labels, depth, photograph.camera, support)
    return furnished(scenery, layers, support, things, feet, stride, common)


def _flat(photograph: Photograph, depth: np.ndarray, support: Support, options: PlanesOptions) -> np.ndarray:
    """Pixels (H, W) measured in the support's plane."""
    points = cameras.backproject(depth, photograph.camera.matrix())
    height = transforms.apply(support.camera_pose.matrix, points)[..., 2]
    return np.asarray((depth > 0) & (np.abs(height) <= options.snap_m))


def _fill_support(
    image: np.ndarray,
    layers: Layers,
    own: np.ndarray,
    known: np.ndarray,
    camera: Camera,
    support: Support,
    options: PlanesOptions,
) -> np.ndarray:
    """The picture with holes on the support filled in its plane, and shadows in and next to them lightened.

    Only pixels of `own` (H, W) have the support's colours; the others are unchanged. At pixels of `known` (H, W), the
    picture has the colours of a further photograph already.
    """
    target = layers.hole & layers.behind
    spots = layers.floor[target]
    margin = max(0.15, 1.2 * options.shadow_reach_m, 0.6 * float(np.ptp(spots, axis=0).max()))
    limits = layers.floor[layers.behind]
    # No finer than the photograph at its nearest point.
    texel = max(options.texel_m, float(layers.plane[target].min()) / camera.fx)
    view = top_view(spots, limits, margin, texel, camera, support.camera_pose.matrix)
    gap = view.lay(target.astype(np.uint8), smooth=False) > 0
    flat = view.lay(image)
    level, free = (
        view.lay(m.astype(np.uint8), smooth=False) > 0
        for m in (layers.level & layers.behind & own, layers.behind & ~layers.hole & own)
    )
    source = _alike(flat, level & ~gap, free & ~gap, 0.03 / view.texel)
    shown = view.lay((known & target).astype(np.uint8), smooth=False) > 0
    outside = view.lay(np.ones(target.shape, np.uint8), smooth=False) == 0
    gain = _gain(flat, gap, source, shown, outside, options.shadow_reach_m / view.texel)
    # The shadow of an object is where others see it, too: there, the texture around it is the better guess.
    shown &= gain.max(axis=-1) < MOST_SHADE
    known = known & (view.lift(shown.astype(np.uint8), target.shape, smooth=False) > 0)
    # Unfilled pixels keep their texture; only their brightness changes.
    target &= ~known
    beside = (layers.behind & ~target)[..., None]
    filled = flat * gain
    if target.any():
        filled = fill_texture(filled, gap & ~shown, source | shown, view.distance())
    lit = np.where(beside, view.lift(gain - 1.0, target.shape) + 1.0, 1.0)
    return np.where(target[..., None], view.lift(filled, target.shape), image * lit).astype(np.float32)


def _alike(flat: np.ndarray, level: np.ndarray, free: np.ndarray, sigma: float) -> np.ndarray:
    """Pixels measured as support, and unmeasured neighbours of its colour."""
    if level.sum() < 500:
        return free
    expected = smooth_part(flat, level, sigma)
    step = np.abs(cv2.blur(flat, (9, 9)) - expected).max(axis=-1)
    return np.asarray(level | (free & (step < SAME_COLOUR)))


def _gain(
    flat: np.ndarray, gap: np.ndarray, source: np.ndarray, shown: np.ndarray, outside: np.ndarray, reach: float
) -> np.ndarray:
    """Gains (H, W, 3) that remove shadows and coloured reflections around `gap`, and in it where it is `shown`.

    They extend the smooth illumination from beyond `reach` [px] up to the gap, and up to the picture's border, beyond
    which is `outside` (H, W): the surface goes on there as it ends. On a surface with a coarse pattern, a colour that
    differs from it by no more than the pattern does elsewhere is no shadow.
    """
    away = cv2.distanceTransform((~gap).astype(np.uint8), cv2.DIST_L2, 5)
    rest = source & (away > reach)
    if reach <= 0 or rest.sum() < 500:
        return np.ones_like(flat)
    light = smooth_part(flat, rest, reach / 4)
    local = _stepped(flat, source | shown, reach / 8)
    ratio = np.log(np.maximum(light, 1.0) / np.maximum(local, 1.0))
    apart = np.abs(ratio).max(axis=-1, keepdims=True)
    own = float(np.quantile(apart[rest], TEXTURE))
    if own > np.log(MOST_SHADE):
        ratio *= np.clip((apart - own) / (0.5 * own), 0.0, 1.0)
    gain = np.clip(np.exp(ratio), LEAST_GAIN, MOST_GAIN)
    weight = np.clip(2.0 * (1.0 - away / reach), 0.0, 1.0)
    # Avoid steps at unknown surface.
    rim = (source | gap | outside).astype(np.uint8)
    inner = np.clip(cv2.distanceTransform(rim, cv2.DIST_L2, 5) / (reach / 4), 0.0, 1.0)
    return np.asarray(gain ** (weight * np.where(gap, 1.0, inner))[..., None], np.float32)


def _stepped(flat: np.ndarray, source: np.ndarray, reach: float) -> np.ndarray:
    """The local colour (H, W, 3) without texture: a median keeps the edges of shadows, which a mean would blur."""
    whole = membrane(np.where(source[..., None], flat, 0.0).astype(np.float32), source)
    side = 2 * max(2, round(reach)) + 1
    levels = cv2.medianBlur(np.clip(np.round(whole), 0, 255).astype(np.uint8), side)
    return np.asarray(cv2.GaussianBlur(levels.astype(np.float32), (0, 0), max(1.0, reach / 6)))


def _inpaint(pixels: np.ndarray, hole: np.ndarray, behind: np.ndarray) -> np.ndarray:
    """Fill pixels off the support from other pixels off the support: the mean of Telea's and Navier-Stokes inpainting.

    Each hole is filled at half resolution in its own crop, where the support counts as hidden.
    """
    filled = pixels.copy()
    count, labels, facts, _ = cv2.connectedComponentsWithStats(hole.astype(np.uint8))
    for number in range(1, count):
        left, top, width, height = facts[number, :4].tolist()
        rim = 24
        area = np.s_[max(0, top - rim) : top + height + rim, max(0, left - rim) : left + width + rim]
        unknown = (hole | behind)[area]
        source = pixels if not unknown.all() else filled
        unknown = unknown if not unknown.all() else hole[area]
        here = labels[area] == number
        filled[area] = np.where(here[..., None], _both_ways(source[area], unknown), filled[area])
    return filled


def _both_ways(pixels: np.ndarray, hole: np.ndarray) -> np.ndarray:
    size = (pixels.shape[1], pixels.shape[0])
    half = (max(1, size[0] // 2), max(1, size[1] // 2))
    small = cv2.resize(pixels, half, interpolation=cv2.INTER_AREA)
    mask = cv2.resize(
        cv2.dilate(hole.astype(np.uint8), np.ones((3, 3), np.uint8)), half, interpolation=cv2.INTER_NEAREST
    )
    telea, flow = (cv2.inpaint(small, mask, 4, how).astype(np.float32) for how in (cv2.INPAINT_TELEA, cv2.INPAINT_NS))
    return np.asarray(np.round(cv2.resize((telea + flow) / 2, size, interpolation=cv2.INTER_LINEAR)), np.uint8)
