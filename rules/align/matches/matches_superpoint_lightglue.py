"""Backend `superpoint_lightglue` of align.matches: SuperPoint with LightGlue, through transformers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import Field

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.cameras.matches import Matches
from dextera_build.rule import Backend, Context, Options

if TYPE_CHECKING:
    from torch import Tensor

    from .matches import MatchesOptions

BACKEND = Backend(
    summary="SuperPoint with LightGlue",
    packages=("pillow", "torch", "transformers"),
    extra="models",
    gpu_gb=2.0,
    cpu=True,
    weights=("lightglue_superpoint",),
    licence="SuperPoint: non-commercial research; LightGlue: Apache-2.0",
)
SIZE = (480, 640)
"""Height and width of the input of the published weights, independent of the picture's shape [px]."""


class SuperpointLightglueOptions(Options):
    """Options of backend `superpoint_lightglue` of align.matches."""

    least_confidence: float = Field(0.1, ge=0.0, le=1.0)
    """Minimum confidence of a pair."""


@dataclass(frozen=True)
class Matcher:
    """Detector and matcher in one model."""

    model: Any


def match(
    ctx: Context, first: Image, second: Image, common: MatchesOptions, options: SuperpointLightglueOptions
) -> Matches:
    """Points of SuperPoint (DeTone et al., 2018), paired by LightGlue (Lindenberger et al., 2023)."""
    return matched(ctx.load(load, "lightglue_superpoint"), first, second, common.points, options.least_confidence)


def self_test(ctx: Context) -> None:
    """Check that the matcher accepts two pictures."""
    grey = Image(pixels=np.random.default_rng(0).integers(0, 255, (96, 128, 3)).astype(np.uint8))
    matched(ctx.load(load, "lightglue_superpoint"), grey, grey, 64, 0.0)


def load(folder: Path, device: str) -> Matcher:
    """Load the model from a folder of weights, which include the detector's."""
    import transformers

    library: Any = transformers  # partly typed
    model = library.LightGlueForKeypointMatching.from_pretrained(folder, use_safetensors=True)
    return Matcher(model.to(device).eval())


def matched(matcher: Matcher, first: Image, second: Image, points: int, least: float) -> Matches:
    """Pairs with a minimum confidence; pixels of both pictures at their original size."""
    import torch

    model = matcher.model
    model.keypoint_detector.keypoint_decoder.max_keypoints = points
    pictures = torch.stack([_tensor(each.pixels) for each in (first, second)])[None].to(model.device)
    with torch.inference_mode():
        said = model(pictures)
    inside = said.mask[0] > 0
    places = [_pixels(said.keypoints[0, side][inside[side]], picture) for side, picture in enumerate((first, second))]
    other = said.matches[0, 0][inside[0]].long().cpu().numpy()
    scores = said.matching_scores[0, 0][inside[0]].float().cpu().numpy()
    kept = (other >= 0) & (other < len(places[1])) & (scores >= least)
    return Matches(
        first=places[0][kept],
        second=places[1][other[kept]],
        confidence=scores[kept].astype(np.float32),
        method="SuperPoint + LightGlue",
    )


def _tensor(pixels: np.ndarray) -> Tensor:
    """Grey values (3, h, w) 0..1 at the model's input size."""
    import torch
    from PIL import Image as Picture

    grey = Picture.fromarray(pixels).convert("L").resize(SIZE[::-1], Picture.Resampling.BILINEAR)
    return torch.from_numpy(np.repeat(np.asarray(grey, np.float32)[None] / 255.0, 3, axis=0))


def _pixels(found: Tensor, picture: Image) -> np.ndarray:
    """Positions (N, 2) in the picture at its original size, with integer pixel centres, from relative positions."""
    height, width = picture.pixels.shape[:2]
    inner = found.double().cpu().numpy() * [SIZE[1], SIZE[0]] + 0.5
    return np.asarray(inner * [width / SIZE[1], height / SIZE[0]] - 0.5)
