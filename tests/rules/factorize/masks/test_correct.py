"""Masks painted by hand: they change the object that they are named after, and no other one."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build import digest
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image, png
from dextera_build.artifacts.objects.view import Segmentation
from dextera_build.errors import RuleError
from dextera_build.testing import RuleRunner
from tests import factories, object_views, tabletops
from tests.rules.factorize.elements.test_name import LABELS, PHOTOGRAPH, PROPOSED

RED = tabletops.box(0.10, 0.08, 0.10, (0.8, 0.2, 0.2))
BLUE = tabletops.box(0.08, 0.08, 0.07, (0.2, 0.2, 0.8))


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """The inputs of the rule, from a photograph of two boxes with a gap between them."""
    scene = tabletops.tabletop((RED, factories.pose(-0.12)), (BLUE, factories.pose(0.12)))
    runner = RuleRunner(tmp_path_factory.mktemp("found"))
    shot = factories.shot(scene.capture)
    support = runner.run("align.support", **shot)
    elements = runner.run("factorize.parse", **shot, support=support)
    objects = runner.run("factorize.segment", **shot, support=support, elements=elements)
    return {**shot, "support": support, "objects": objects}


def correct(tmp_path, found, files: dict[str, bytes] | None) -> tuple[Segmentation, RuleRunner]:
    runner = RuleRunner(tmp_path)
    given = {} if files is None else {"masks": Folder(files=files)}
    return runner.run("factorize.correct", **found, **given), runner


def of(objects: Segmentation, name: str) -> np.ndarray:
    return objects.map.labels == objects.names.index(name) + 1


@pytest.mark.slow
def test_without_masks_nothing_changes(tmp_path, found):
    objects, _ = correct(tmp_path, found, None)
    assert objects.encode(digest.of_bytes) == found["objects"].encode(digest.of_bytes)


def test_a_mask_as_it_was_written_changes_nothing(tmp_path, found):
    painted = png(of(found["objects"], "red_box"))
    objects, _ = correct(tmp_path, found, {"red_box.png": painted})
    assert objects.encode(digest.of_bytes) == found["objects"].encode(digest.of_bytes)


def test_only_the_object_with_a_painted_mask_changes(tmp_path, found):
    before = found["objects"]
    mask = of(before, "red_box")
    mask[: np.nonzero(mask)[0].min() + 10] = False
    objects, _ = correct(tmp_path, found, {"red_box.png": png(mask)})
    assert objects.names == before.names
    assert np.array_equal(of(objects, "red_box"), mask)
    assert object_views.content(objects.items["red_box"]) != object_views.content(before.items["red_box"])
    assert object_views.content(objects.items["blue_box"]) == object_views.content(before.items["blue_box"])
    view = objects.items["red_box"].view
    assert (view.mask.sum(), view.phrase) == (mask.sum(), before.items["red_box"].view.phrase)
    # What was taken from the object stands out from the support, and is a part of the background.
    assert objects.map.fixed[of(before, "red_box") & ~mask].mean() > 0.9


def test_pixels_of_another_object_are_taken_from_it_and_that_is_said(tmp_path, found):
    before = found["objects"]
    blue = of(before, "blue_box")
    column = int(np.median(np.nonzero(blue)[1]))
    taken = blue & (np.arange(blue.shape[1]) < column)
    objects, runner = correct(tmp_path, found, {"red_box.png": png(of(before, "red_box") | taken)})
    assert np.array_equal(of(objects, "blue_box"), blue & ~taken)
    assert objects.items["blue_box"].view.mask.sum() == (blue & ~taken).sum()
    assert "taken by a painted mask" in runner.outcome.line


@pytest.mark.medium
def test_editors_may_write_colours_palettes_or_transparency(tmp_path, found):
    mask = of(found["objects"], "red_box")
    mask[: np.nonzero(mask)[0].min() + 10] = False
    grey = Pillow.fromarray(mask.astype(np.uint8) * 255)
    clear = np.full((*mask.shape, 4), 255, np.uint8)
    clear[~mask, 3] = 0
    for picture in (grey.convert("1"), grey.convert("RGB"), grey.convert("P"), Pillow.fromarray(clear)):
        buffer = io.BytesIO()
        picture.save(buffer, format="PNG")
        objects, _ = correct(tmp_path, found, {"red_box.png": buffer.getvalue()})
        assert np.array_equal(of(objects, "red_box"), mask), picture.mode


def empty(mask: np.ndarray) -> bytes:
    return png(np.zeros_like(mask))


@pytest.mark.parametrize(
    ("name", "painted", "message", "words"),
    [
        ("red_box", empty, "`red_box.png` is an empty mask", "paint the object white"),
        ("red_box", lambda mask: png(mask[::2, ::2]), "is not of the photograph's size", "320 x 240 px"),
        ("red_box", lambda mask: png(~np.zeros_like(mask)), "is all white", "everything else is black"),
        ("red_box", lambda mask: png(np.indices(mask.shape).sum(0) < 6), "is too small", "at least 100 are needed"),
        ("red_box", lambda mask: png(mask.astype(np.uint16)), "is not an 8 bit PNG", "I;16"),
        ("red_box", lambda mask: png(mask)[:200], "is truncated or damaged", "export it again"),
        ("red_box", lambda mask: b"GIF89a", "is not a PNG image", "export it as PNG"),
        ("redbox", png, "`redbox.png` is the mask of no object", "did you mean `red_box`?"),
        ("tin", png, "`tin.png` is the mask of no object", "blue_box"),
    ],
)
def test_a_wrong_mask_is_refused_with_its_file_and_the_next_step(tmp_path, found, name, painted, message, words):
    with pytest.raises(RuleError) as caught:
        correct(tmp_path, found, {f"{name}.png": painted(of(found["objects"], "red_box"))})
    assert f"{name}.png" in caught.value.message
    assert message in caught.value.message
    assert words in f"{caught.value.facts} {caught.value.hint}"


def test_a_mask_that_leaves_nothing_of_another_object_is_refused(tmp_path, found):
    both = of(found["objects"], "red_box") | of(found["objects"], "blue_box")
    with pytest.raises(RuleError, match="painted masks leave nothing of blue_box"):
        correct(tmp_path, found, {"red_box.png": png(both)})


def test_other_files_are_named_and_not_read(tmp_path, found):
    _, runner = correct(tmp_path, found, {"red_box.xcf": b"gimp xcf", ".DS_Store": b"", "old/blue_box.png": b""})
    assert runner.outcome.warnings == [
        "not read: old/blue_box.png, red_box.xcf; a mask is `OBJECT.png`, directly in the folder"
    ]


def test_without_depth_a_painted_mask_may_hide_another_object(tmp_path):
    """Nothing is measured: what reaches lower in the picture is nearer, see `masks.occlusion`."""
    painted = (LABELS == 1) | (LABELS == 0) & (np.indices(LABELS.shape)[0] > 140) & (np.indices(LABELS.shape)[1] < 140)
    runner = RuleRunner(tmp_path)
    photograph = Photograph(rgb=Image(pixels=PHOTOGRAPH), camera=factories.camera())
    masks = Folder(files={"blue_mug.png": png(painted)})
    objects = runner.run("factorize.correct", photograph=photograph, objects=PROPOSED, masks=masks)
    assert np.array_equal(of(objects, "blue_mug"), painted)
    assert objects.items["blue_mug"].view.asset_source == "rgb"
    assert objects.items["red_mug"].view.occluder.any()
    assert np.array_equal(of(objects, "red_mug"), LABELS == 2)
