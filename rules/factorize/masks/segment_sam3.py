"""Masks from the photograph alone: Grounding DINO detects the phrase of an element, SAM 3 segments it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Element, Elements
from dextera_build.geometry.regions import box_of
from dextera_build.learning.vision_input import VisionInput
from dextera_build.rule import Backend, Context, Fraction, Options

from ..measured import Measurements, Workspace
from ..overlap import Box, box_iou

BACKEND = Backend(
    summary="Grounding DINO boxes and SAM 3 masks; nothing measured is read",
    profiles=("gpu",),
    packages=("torch", "transformers"),
    extra="models",
    gpu_gb=6.0,
    cpu=True,
    weights=("grounding_dino", "sam3"),
    licence="Apache-2.0 (Grounding DINO), SAM License (SAM 3)",
)


class Sam3Options(Options):
    """Options of backend `sam3` of factorize.segment."""

    box_score: Fraction = 0.25
    """Minimum score of a box for a phrase."""
    mask_score: Fraction = 0.3
    """Minimum score of a mask for a phrase."""
    mask_probability: Fraction = 0.5
    """Minimum probability of a pixel of a mask."""
    box_overlap: Fraction = 0.3
    """Minimum IoU of a mask's box with the element's box."""


@dataclass(frozen=True)
class Detector:
    """Grounding DINO with its processor."""

    model: Any
    processor: Any


@dataclass(frozen=True)
class Segmenter:
    """SAM 3 with its tokenizer and the data type of its input."""

    model: Any
    tokenizer: Any
    images: VisionInput


def masks(
    ctx: Context,
    photograph: Photograph,
    measured: Measurements[Workspace],
    elements: Elements,
    options: Sam3Options,
) -> dict[str, np.ndarray]:
    """Element -> mask (H, W) bool, in the elements' order; static elements too, because they hide things.

    An element without a box gets the best unassigned detection of Grounding DINO (Liu et al., 2023) for its phrase. Of
    the masks that SAM 3 (Meta, 2025) returns for the phrase, the one whose box has the largest IoU is used.
    """
    pixels = photograph.rgb.pixels
    boxes = _boxes(ctx, pixels, elements, options)
    segmenter, found = ctx.load(load_segmenter, "sam3"), {}
    wanted = [element for element in elements.elements if element.name in boxes]
    sight = None
    for done, element in enumerate(wanted):
        ctx.progress(done, len(wanted), element.name)
        sight = see(segmenter, pixels) if sight is None else sight
        answers = masks_of(segmenter, sight, element.phrase, pixels.shape[:2], options)
        if (mask := _fitting(answers, boxes[element.name], options.box_overlap)) is not None:
            found[element.name] = mask
    return found


def self_test(ctx: Context) -> None:
    """Check that both models answer on a grey picture."""
    grey, options = np.full((64, 64, 3), 128, np.uint8), Sam3Options()
    boxes_of(ctx.load(load_detector, "grounding_dino"), grey, "a mug", options.box_score)
    segmenter = ctx.load(load_segmenter, "sam3")
    masks_of(segmenter, see(segmenter, grey), "a mug", (64, 64), options)


def load_detector(folder: Path, device: str) -> Detector:
    """Load Grounding DINO from a folder of weights."""
    import transformers
    from transformers.models.grounding_dino.image_processing_pil_grounding_dino import GroundingDinoImageProcessorPil

    library: Any = transformers  # partly typed
    images = GroundingDinoImageProcessorPil.from_pretrained(folder)
    processor = library.GroundingDinoProcessor(images, library.AutoTokenizer.from_pretrained(folder))
    model = library.GroundingDinoForObjectDetection.from_pretrained(folder, use_safetensors=True)
    return Detector(model.to(device).eval(), processor)


def load_segmenter(folder: Path, device: str) -> Segmenter:
    """Load SAM 3 from a folder of weights."""
    import transformers

    library: Any = transformers  # partly typed
    return Segmenter(
        library.Sam3Model.from_pretrained(folder, use_safetensors=True).to(device).eval(),
        library.AutoTokenizer.from_pretrained(folder),
        VisionInput.read(folder),
    )


def boxes_of(detector: Detector, pixels: np.ndarray, phrase: str, score: float) -> list[Box]:
    """Boxes detected for a phrase, best first; left, top, right, bottom [px]."""
    import torch

    text = f"{phrase.lower().rstrip('.')}."
    inputs = detector.processor(images=[pixels], text=text, return_tensors="pt").to(detector.model.device)
    with torch.inference_mode():
        outputs = detector.model(**inputs)
    (answer,) = detector.processor.post_process_grounded_object_detection(
        outputs, inputs["input_ids"], threshold=score, text_threshold=score, target_sizes=[pixels.shape[:2]]
    )
    order = torch.argsort(answer["scores"], descending=True, stable=True).tolist()
    height, width = pixels.shape[:2]
    rounded = [[round(float(side)) for side in answer["boxes"][index]] for index in order]
    clipped = [
        (max(0, left), max(0, top), min(width, right), min(height, bottom)) for left, top, right, bottom in rounded
    ]
    return [box for box in clipped if box[0] < box[2] and box[1] < box[3]]


def see(segmenter: Segmenter, pixels: np.ndarray) -> Any:
    """Output of SAM 3 for a picture and all phrases."""
    import torch

    with torch.inference_mode():
        return segmenter.model.get_vision_features(segmenter.images.tensor(pixels).to(segmenter.model.device))


def masks_of(
    segmenter: Segmenter, sight: Any, phrase: str, shape: tuple[int, int], options: Sam3Options
) -> list[np.ndarray]:
    """Masks for a phrase, best first, (H, W) bool; the score is that of the mask times that of the phrase."""
    import torch

    length = segmenter.model.config.text_config.max_position_embeddings
    words = segmenter.tokenizer(
        phrase, return_tensors="pt", padding="max_length", max_length=length, truncation=True
    ).to(segmenter.model.device)
    with torch.inference_mode():
        out = segmenter.model(vision_embeds=sight, input_ids=words["input_ids"], attention_mask=words["attention_mask"])
        scores = (out.pred_logits.sigmoid() * out.presence_logits.sigmoid())[0]
        order = [
            index for index in torch.argsort(scores, descending=True).tolist() if scores[index] > options.mask_score
        ]
        if not order:
            return []
        likely = out.pred_masks[0, order].sigmoid()[None]
        large = torch.nn.functional.interpolate(likely, shape, mode="bilinear", align_corners=False)[0]
    return list((large > options.mask_probability).cpu().numpy())


def _boxes(ctx: Context, pixels: np.ndarray, elements: Elements, options: Sam3Options) -> dict[str, Box]:
    """Element -> box: its own, or the best unassigned one for its phrase."""
    boxes = {element.name: element.box for element in elements.elements if element.box is not None}
    unknown = [element for element in elements.elements if element.box is None and _is_thing(element)]
    if unknown:
        detector = ctx.load(load_detector, "grounding_dino")
        answers: dict[str, list[Box]] = {}
        for element in unknown:
            if element.phrase not in answers:
                answers[element.phrase] = boxes_of(detector, pixels, element.phrase, options.box_score)
            taken = boxes.values()
            free = (box for box in answers[element.phrase] if all(box_iou(box, other) < _SAME for other in taken))
            if (box := next(free, None)) is not None:
                boxes[element.name] = box
    return boxes


_SAME = 0.7
"""Boxes with a larger IoU are the same object."""


def _is_thing(element: Element) -> bool:
    return element.category not in ("support", "room")


def _fitting(answers: list[np.ndarray], box: Box, least: float) -> np.ndarray | None:
    """The mask whose box fits best; None if no overlap is large enough."""
    fits = [(box_iou(box_of(mask), box), -place, mask) for place, mask in enumerate(answers) if mask.any()]
    best = max(fits, key=lambda fit: fit[:2], default=None)
    return best[2] if best is not None and best[0] >= least else None
