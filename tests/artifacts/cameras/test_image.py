"""PNG of pictures."""

from __future__ import annotations

import io

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.cameras import image


@pytest.mark.parametrize("kind", ["uint8", "uint16", "bool"])
def test_pixels_come_back_at_every_level(kind: str) -> None:
    pixels = np.random.default_rng(0).integers(0, 2 if kind == "bool" else 200, (7, 5)).astype(kind)
    for level in (1, 4):
        back = np.asarray(Pillow.open(io.BytesIO(image.png(pixels, level))))
        assert (back == (pixels * np.uint8(255) if kind == "bool" else pixels)).all()


def test_a_picture_is_encoded_once_and_another_one_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, ...]] = []
    encode = image._encoded

    def counted(pixels: np.ndarray, level: int) -> bytes:
        made.append(pixels.shape)
        return encode(pixels, level)

    monkeypatch.setattr(image, "_encoded", counted)
    monkeypatch.setattr(image, "_ENCODED", {})
    pixels = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
    first = image.png(pixels)
    assert image.png(pixels.copy()) == first
    assert len(made) == 1
    assert image.png(pixels.reshape(5, 4, 3)) != first
    assert image.png(pixels, level=1) is not first
    pixels[0, 0, 0] = 200
    assert image.png(pixels) != first
    assert len(made) == 4
    for number in range(image.MOST_ENCODED):
        image.png(np.full((2, 2), number, np.uint8))
    assert len(image._ENCODED) == image.MOST_ENCODED
    assert image.png(pixels.reshape(5, 4, 3)[::-1]) != first
