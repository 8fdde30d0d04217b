"""Glasses: depth of the table behind them or none, and an outline in the picture."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.testing import RuleRunner
from rules.factorize.masks import clear
from rules.factorize.measured import Workspace
from tests import factories, tabletops

BOX = (tabletops.box(0.1, 0.08, 0.15, (0.8, 0.2, 0.2)), factories.pose(-0.15, 0.0, yaw=0.4))
GLASS = (tabletops.cylinder(0.035, 0.12, (0.9, 0.9, 0.9)), factories.pose(0.12, 0.0))
CAN = (tabletops.cylinder(0.035, 0.12, (0.2, 0.3, 0.7)), factories.pose(0.12, 0.0))


def with_glass(*, seen_through: float, scrap: bool = False) -> tuple[Capture, np.ndarray]:
    """A box and a glass, and the pixels of the glass.

    Args:
        seen_through: Fraction of its pixels with the depth of the table behind it, longer by refraction; the others
            have none.
        scrap: A patch of its wall has depth.
    """
    empty = tabletops.tabletop(BOX, lens=tabletops.FINE)
    full = tabletops.tabletop(BOX, GLASS, lens=tabletops.FINE)
    glass = full.labels.labels == 2
    assert empty.capture.measured is not None
    assert full.capture.measured is not None
    rng = np.random.default_rng(1)
    behind = empty.capture.measured.depth.depth
    through = ndimage.uniform_filter(rng.random(glass.shape), 9) < 0.5 + 0.2 * (seen_through - 0.5)
    depth = np.where(glass, np.where(through, 1.05 * behind, 0.0), behind)
    if scrap:
        rows, columns = np.nonzero(glass)
        patch = np.zeros_like(glass)
        patch[int(rows.max()) - 44 :, int(columns.mean()) - 14 : int(columns.mean()) + 14] = True
        depth = np.where(glass & patch, full.capture.measured.depth.depth, depth)
    # The wall mirrors the lamp beside its outline, and is clear in the middle.
    rim = glass & ~ndimage.binary_erosion(glass, iterations=4)
    own, table = full.capture.photograph.rgb.pixels, empty.capture.photograph.rgb.pixels
    pixels = np.where(rim[..., None], own, table)
    return factories.rgbd(pixels, depth.astype(np.float32), full.capture.photograph.camera), glass


def segmented(runner: RuleRunner, capture: Capture):
    shot = factories.shot(capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    return runner.run("factorize.segment", **shot, support=support, elements=elements)


def place(warning: str) -> tuple[int, ...]:
    return tuple(int(number) for number in warning.split("box [")[1].split("]")[0].split(","))


@pytest.mark.slow
def test_a_glass_is_told_with_its_place_and_a_picture(tmp_path):
    capture, glass = with_glass(seen_through=0.5)
    runner = RuleRunner(tmp_path)
    found = segmented(runner, capture)
    assert len(found.names) == 1
    (warning,) = [text for text in runner.outcome.warnings if "clear or shiny" in text]
    left, top, right, bottom = place(warning)
    rows, columns = np.nonzero(glass)
    assert abs(np.array([left, top, right, bottom]) - [columns.min(), rows.min(), columns.max(), rows.max()]).max() < 20
    assert [caption for caption, _ in runner.outcome.previews] == [
        "instances",
        "clear or shiny things, which are no bodies",
    ]


@pytest.mark.slow
def test_what_is_left_of_a_glass_is_no_body(tmp_path):
    capture, glass = with_glass(seen_through=0.0, scrap=True)
    runner = RuleRunner(tmp_path)
    found = segmented(runner, capture)
    assert len(found.names) == 1
    assert not glass[found.map.labels == 1].any()
    (warning,) = [text for text in runner.outcome.warnings if "clear or shiny" in text]
    assert "which is a part of it, is no body" in warning


@pytest.mark.slow
def test_lost_depth_beside_things_or_on_the_bare_table_is_no_thing(tmp_path):
    scene = tabletops.tabletop(BOX, lens=tabletops.FINE)
    assert scene.capture.measured is not None
    depth = scene.capture.measured.depth.depth.copy()
    box = scene.labels.labels == 1
    depth[ndimage.shift(box, (0, -12), order=0) & ~box] = 0.0
    depth[300:340, 400:440] = 0.0
    runner = RuleRunner(tmp_path)
    segmented(runner, factories.rgbd(scene.capture.photograph.rgb.pixels, depth, scene.capture.photograph.camera))
    assert not [text for text in runner.outcome.warnings if "clear or shiny" in text]


def test_a_body_that_is_measured_for_the_most_part_is_not_clear(tmp_path):
    scene = tabletops.tabletop(BOX, CAN, lens=tabletops.FINE)
    assert scene.capture.measured is not None
    depth, can = scene.capture.measured.depth.depth.copy(), scene.labels.labels == 2
    rows, columns = np.indices(can.shape)
    right = can & (columns > np.nonzero(can)[1].max() - 8)
    stripes = (rows % 8 < 2) & (scene.labels.labels == 0) & (columns > 300)  # together more than the can
    depth[(ndimage.binary_dilation(can, iterations=6) & ~can) | right | stripes] = 0.0
    photograph = scene.capture.photograph
    support = RuleRunner(tmp_path).run("align.support", **factories.shot(scene.capture))
    seen = Workspace(photograph, depth, support)
    assert not clear.clear_things(seen, {"box": scene.labels.labels == 1, "can": can & ~right})


def found(capture: Capture, folder: Path, masks: dict[str, np.ndarray], *, farther_m: float = 0.0) -> list[clear.Clear]:
    """Clear things beside masks; the far edge of the support's outline lies `farther_m` too far away at one end [m]."""
    support = RuleRunner(folder).run("align.support", **factories.shot(capture))
    corners = support.polygon.copy()
    corners[np.argmax(corners @ [-1.0, 1.0])] += [0.0, farther_m]
    assert capture.measured is not None
    seen = Workspace(capture.photograph, capture.measured.depth.depth, support.model_copy(update={"polygon": corners}))
    return clear.clear_things(seen, masks)


@pytest.mark.medium
def test_a_strip_of_the_floor_inside_the_outline_of_the_support_is_no_thing(tmp_path):
    """A screen hides a part of it, so it is no longer than things are."""
    screen = (tabletops.box(0.65, 0.05, 0.25, (0.2, 0.3, 0.7)), factories.pose(0.17, 0.36))
    scene = tabletops.tabletop(screen, lens=tabletops.FINE)
    assert not found(scene.capture, tmp_path, {"screen": scene.labels.labels == 1}, farther_m=0.15)


@pytest.mark.medium
def test_a_glass_is_found_although_the_outline_is_too_large(tmp_path):
    capture, glass = with_glass(seen_through=0.5)
    (thing,) = found(capture, tmp_path, {}, farther_m=0.15)
    assert tabletops.iou(thing.mask, glass) > 0.7


@pytest.mark.medium
@pytest.mark.parametrize("parted", [True, False])
def test_a_stripe_without_depth_through_an_opaque_thing_is_no_thing(tmp_path, parted):
    """The halves are two objects, or in no mask, as furniture is."""
    tower = (tabletops.box(0.16, 0.1, 0.12 if parted else 0.3, (0.2, 0.3, 0.7)), factories.pose(0.12, 0.0, yaw=0.2))
    scene = tabletops.tabletop(BOX, tower, lens=tabletops.FINE)
    assert scene.capture.measured is not None
    own, depth = scene.labels.labels == 2, scene.capture.measured.depth.depth.copy()
    rows, columns = np.indices(own.shape)
    middle = np.nonzero(own)[1].mean() if parted else np.nonzero(own)[0].min() + 70
    stripe = ndimage.binary_dilation(own, iterations=4) & (abs((columns if parted else rows) - middle) < 15)
    depth[stripe] = 0.0
    masks = {"box": scene.labels.labels == 1}
    if parted:
        masks |= {"left": own & ~stripe & (columns < middle), "right": own & ~stripe & (columns > middle)}
    photograph = scene.capture.photograph
    assert not found(factories.rgbd(photograph.rgb.pixels, depth, photograph.camera), tmp_path, masks)
