"""Decoding of image files in a capture, with errors that name the file."""

from __future__ import annotations

import io

import numpy as np

from dextera_build.rule import Context


def pixels(ctx: Context, data: bytes, name: str, mode: str | None = None) -> np.ndarray:
    """Samples of an image file: (H, W) or (H, W, C), in the file's own mode or converted to Pillow's `mode`.

    Args:
        ctx: Reports a file that cannot be read.
        data: The file's bytes.
        name: Its name, for messages.
        mode: `RGB` turns any picture into red, green, blue; None keeps counts and palette indices as they are.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(io.BytesIO(data)) as picture:
            picture.load()
            return np.array(picture.convert(mode) if mode else picture)
    except UnidentifiedImageError:
        ctx.fail(
            f"`{name}` is not an image",
            size=f"{len(data):,} bytes",
            begins=repr(data[:8]),
            hint=f"check that `{name}` is a PNG or JPEG file and not a pointer of Git LFS",
        )
    except (OSError, SyntaxError, ValueError) as error:
        ctx.fail(
            f"`{name}` is truncated or damaged",
            size=f"{len(data):,} bytes",
            decoder=str(error),
            hint=f"copy `{name}` from the camera again",
        )


def counts(ctx: Context, data: bytes, name: str) -> np.ndarray:
    """The (H, W) integers of a single-channel image file: depth counts, instance labels."""
    values = pixels(ctx, data, name)
    if values.ndim != 2 or values.dtype.kind not in "uib":
        ctx.fail(
            f"`{name}` must have one channel of whole numbers",
            shape=" x ".join(str(n) for n in values.shape),
            dtype=str(values.dtype),
            hint=f"write `{name}` as an 8 or 16 bit grey PNG",
        )
    return values.astype(np.int64)
