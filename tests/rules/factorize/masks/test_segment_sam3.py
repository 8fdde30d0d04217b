"""Masks by Grounding DINO and SAM 3: the models run with random weights, their answers are chosen as constructed."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.code.loader import Library
from dextera_build.testing import RuleRunner
from tests import factories
from tests.rules.factorize.masks import tiny_models

SHAPE = (48, 64)
LEFT, RIGHT = (4, 8, 24, 40), (36, 8, 60, 40)


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("weights")
    return {
        "grounding_dino": tiny_models.grounding_dino(folder / "dino"),
        "sam3": tiny_models.sam3(folder / "sam3"),
    }


@pytest.fixture
def backend(tmp_path: Path) -> ModuleType:
    return Library().find("factorize.segment").backends["sam3"].module


@pytest.fixture
def photograph() -> Photograph:
    pixels = np.full((*SHAPE, 3), 90, np.uint8)
    pixels[filled(LEFT)], pixels[filled(RIGHT)] = (200, 40, 40), (40, 40, 200)
    return Photograph(rgb=Image(pixels=pixels), camera=factories.camera(SHAPE[1], SHAPE[0]))


def filled(box: tuple[int, int, int, int]) -> np.ndarray:
    mask = np.zeros(SHAPE, bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    return mask


def things(**boxes: tuple[int, int, int, int] | None) -> Elements:
    made = (Element(name=name, category="object", phrase=f"{name} thing", box=box) for name, box in boxes.items())
    return Elements(elements=tuple(made), source="scene.yaml")


def run(tmp_path: Path, weights: dict[str, Path], photograph: Photograph, elements: Elements, **options: float):
    runner = RuleRunner(tmp_path, weights=weights)
    return runner.run(
        "factorize.segment", backend="sam3", photograph=photograph, elements=elements, options={"sam3": options}
    )


@pytest.mark.medium
def test_the_models_run_and_give_the_same_masks_again(tmp_path, weights, photograph) -> None:
    options = {"box_score": 0.0, "mask_score": 0.0, "mask_probability": 0.3, "box_overlap": 0.0}
    found = [run(tmp_path / name, weights, photograph, things(red=None, blue=RIGHT), **options) for name in "ab"]
    assert set(found[0].names) <= {"red", "blue"}
    assert found[0].map.labels.shape == SHAPE
    assert np.array_equal(found[0].map.labels, found[1].map.labels)
    assert {instance.view.asset_source for instance in found[0].items.values()} == {"rgb"}


def test_the_picture_enters_as_the_processor_of_the_model_prepares_it(backend, weights, photograph) -> None:
    from transformers.image_transforms import normalize, resize

    segmenter = backend.load_segmenter(weights["sam3"], "cpu")
    made = segmenter.images.tensor(photograph.rgb.pixels).numpy()[0]
    pixels = resize(photograph.rgb.pixels, (56, 56), resample=2, input_data_format="channels_last")
    wanted = normalize(pixels / 255.0, [0.5] * 3, [0.5] * 3, input_data_format="channels_last").transpose(2, 0, 1)
    assert made.shape == wanted.shape == (3, 56, 56)
    assert np.abs(made - wanted).max() <= 2 / 255 / 0.5 + 1e-6  # the resizers round differently


def test_things_of_one_phrase_get_different_boxes_and_masks_that_fit_them(
    tmp_path, weights, photograph, backend, monkeypatch
) -> None:
    near = (5, 9, 24, 40)
    monkeypatch.setattr(backend, "boxes_of", lambda *given: [LEFT, near, RIGHT])
    monkeypatch.setattr(backend, "masks_of", lambda *given: [filled(RIGHT), filled(near)])
    same = [Element(name=name, category="object", phrase="a thing") for name in ("one", "two", "three")]
    found = run(tmp_path, weights, photograph, Elements(elements=tuple(same), source="scene.yaml"))
    assert found.names == ("one", "two")  # `three` has no box left
    assert np.array_equal(found.map.labels == 1, filled(near))
    assert np.array_equal(found.map.labels == 2, filled(RIGHT))


def test_a_mask_elsewhere_is_none_of_the_element(tmp_path, weights, photograph, backend, monkeypatch) -> None:
    monkeypatch.setattr(backend, "masks_of", lambda *given: [np.zeros(SHAPE, bool), filled(RIGHT)])
    found = run(tmp_path, weights, photograph, things(red=LEFT, blue=RIGHT))
    assert found.names == ("blue",)


def test_the_support_needs_no_box(tmp_path, weights, photograph, backend, monkeypatch) -> None:
    asked: list[str] = []
    monkeypatch.setattr(backend, "boxes_of", lambda detector, pixels, phrase, score: asked.append(phrase) or [LEFT])
    monkeypatch.setattr(backend, "masks_of", lambda *given: [filled(LEFT)])
    table = Element(name="table", category="support", phrase="table", interactive=False)
    red = Element(name="red", category="object", phrase="red thing")
    run(tmp_path, weights, photograph, Elements(elements=(table, red), source="scene.yaml"))
    assert asked == ["red thing"]


@pytest.mark.medium
def test_the_self_test_runs(backend, weights, tmp_path) -> None:
    from dextera_build.rule import Context
    from dextera_build.rule.pretrained import Pretrained

    pinned = tuple(f"{name}@{name}" for name in weights)
    found = Pretrained(pinned, lambda entry: weights[entry.partition("@")[0]])
    backend.self_test(Context(backend, scratch=tmp_path, pretrained=found))
