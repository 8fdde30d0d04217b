"""Reading of a painted mask as untrusted data: white is the object."""

from __future__ import annotations

import io
import warnings

import numpy as np

from dextera_build.rule import Context

MODES = ("1", "L", "LA", "P", "RGB", "RGBA")
"""Pillow's modes of 8 bit pictures, as image editors write them."""
HALF = 128
"""Brightness at and above which a pixel is white."""


def painted(ctx: Context, data: bytes, name: str, shape: tuple[int, int], smallest: int) -> np.ndarray:
    """The mask (H, W) bool in a PNG file: its bright pixels; transparent ones count as black.

    Args:
        ctx: Context for errors, each of which names the file.
        data: The file's bytes.
        name: The file's name.
        shape: Height and width of the photograph [px].
        smallest: A mask with fewer pixels is refused.
    """
    bright = _bright(ctx, data, name, shape)
    count = int(bright.sum())
    if count < smallest:
        ctx.fail(
            f"`{name}` is an empty mask" if not count else f"the mask `{name}` is too small",
            white=f"{count} px, at least {smallest} are needed",
            hint="paint the object white; remove the file to have the mask that was found",
        )
    if bright.all():
        ctx.fail(f"the mask `{name}` is all white", hint="the object is white and everything else is black")
    return bright


def _bright(ctx: Context, data: bytes, name: str, shape: tuple[int, int]) -> np.ndarray:
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            picture = Image.open(io.BytesIO(data), formats=("PNG",))
        if picture.size != shape[::-1]:  # from the header, before anything is decoded
            ctx.fail(
                f"the mask `{name}` is not of the photograph's size",
                mask=f"{picture.size[0]} x {picture.size[1]} px",
                photograph=f"{shape[1]} x {shape[0]} px",
                hint="paint on the file of `dxb new mask`, and export it unscaled and uncropped",
            )
        if picture.mode not in MODES:
            ctx.fail(f"the mask `{name}` is not an 8 bit PNG", mode=picture.mode, hint="export it with 8 bit a channel")
        return _on_black(np.array(picture.convert("RGBA")))
    except UnidentifiedImageError:
        ctx.fail(f"the mask `{name}` is not a PNG image", begins=repr(data[:8]), hint="export it as PNG")
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        ctx.fail(f"the mask `{name}` is too large", decoder=str(error), hint="a mask has the photograph's size")
    except (OSError, SyntaxError, ValueError) as error:
        ctx.fail(f"the mask `{name}` is truncated or damaged", decoder=str(error), hint="export it again")


def _on_black(pixels: np.ndarray) -> np.ndarray:
    """Pixels (H, W) bool of (H, W, 4) uint8 that are bright over a black background."""
    brightness = pixels[..., :3].astype(np.float32).mean(axis=-1) * pixels[..., 3] / 255.0
    return np.asarray(brightness >= HALF)
