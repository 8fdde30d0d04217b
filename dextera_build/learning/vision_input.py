"""Input of vision models: photographs resized and normalised by the processor settings stored with the weights."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class VisionInput:
    """Settings of an image processor of transformers, including that of SAM 3, whose own class needs torchvision."""

    size: tuple[int, int]
    """Height and width of the model's input [px]."""
    mean: tuple[float, ...]
    """Mean of red, green and blue, 0..1."""
    std: tuple[float, ...]
    """Standard deviation of red, green and blue, 0..1."""

    @classmethod
    def read(cls, folder: Path, kind: str = "image_processor") -> VisionInput:
        """Read the settings of processor `kind` in a folder of weights, or of its image processor."""
        names = ("processor_config.json", "preprocessor_config.json")
        said = json.loads(next(folder / name for name in names if (folder / name).is_file()).read_text())
        said = said.get(kind) or said.get("image_processor") or said
        size = (said["size"]["height"], said["size"]["width"])
        return cls(size, tuple(said["image_mean"]), tuple(said["image_std"]))

    def tensor(self, pixels: np.ndarray) -> Tensor:
        """Pixels (H, W, 3) uint8 as (1, 3, h, w) float32: resized without keeping the aspect ratio, and normalised."""
        import torch

        image = torch.from_numpy(pixels.transpose(2, 0, 1).copy())[None].float()
        image = torch.nn.functional.interpolate(image, self.size, mode="bilinear", antialias=True).round().clamp(0, 255)
        mean, std = (torch.tensor(numbers).view(1, 3, 1, 1) for numbers in (self.mean, self.std))
        return (image / 255.0 - mean) / std
