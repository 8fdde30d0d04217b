"""Image and array files of a capture. Headers can be read separately; every error names the file."""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from dextera_build.rule import Context

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG")
"""Accepted formats. Other Pillow readers are disabled, because some run programs, such as Ghostscript for EPS."""


def size(ctx: Context, data: bytes, name: str) -> tuple[int, int]:
    """Width and height [px] from the header of an image file or an NPY file, without decoding pixels."""
    if name.endswith(".npy"):
        header = _array_header(ctx, data, name)
        return header.columns, header.rows
    with opened(ctx, data, name) as picture:
        return picture.size


def pixels(ctx: Context, data: bytes, name: str, mode: str | None = None) -> np.ndarray:
    """Samples of an image file: (H, W) or (H, W, C), in the file's own mode or converted to Pillow's `mode`.

    Args:
        ctx: Context for errors on unreadable files.
        data: The file's bytes.
        name: The file's name, for messages.
        mode: `RGB` converts any image to red, green, blue; None keeps counts and palette indices.
    """
    with opened(ctx, data, name) as picture:
        picture.load()
        return np.array(picture.convert(mode) if mode else picture)


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


def bits_of(ctx: Context, data: bytes, name: str) -> int:
    """Bits per sample of an image file, from its header."""
    with opened(ctx, data, name) as picture:
        return 16 if picture.mode.startswith("I") else 8


def metres(ctx: Context, data: bytes, name: str) -> np.ndarray:
    """The (H, W) float32 numbers of an NPY file."""
    header = _array_header(ctx, data, name)
    needed = header.start + header.rows * header.columns * header.dtype.itemsize
    if len(data) < needed:
        ctx.fail(f"`{name}` is truncated or damaged", size=f"{len(data):,} bytes", needed=f"{needed:,} bytes")
    values = np.frombuffer(data, header.dtype, header.rows * header.columns, header.start)
    with np.errstate(over="ignore"):
        return values.reshape((header.rows, header.columns), order=header.order).astype(np.float32)


class _Header(NamedTuple):
    rows: int
    columns: int
    dtype: np.dtype
    order: Literal["C", "F"]
    start: int
    """Offset of the data [bytes]."""


def _array_header(ctx: Context, data: bytes, name: str) -> _Header:
    stream = io.BytesIO(data)
    try:
        version = np.lib.format.read_magic(stream)
        read = np.lib.format.read_array_header_1_0 if version == (1, 0) else np.lib.format.read_array_header_2_0
        shape, fortran, dtype = read(stream)
    except Exception as error:  # any error of Python's parser on the header text, including MemoryError
        ctx.fail(
            f"`{name}` is not an NPY file",
            size=f"{len(data):,} bytes",
            begins=repr(data[:8]),
            reader=str(error) or type(error).__name__,
            hint=f"write it with `np.save('{name}', depth)`; `np.savez` makes an archive, which is another format",
        )
    if len(shape) != 2 or not all(type(length) is int and length > 0 for length in shape) or dtype.kind != "f":
        ctx.fail(
            f"`{name}` must hold one number of metres per pixel",
            shape=" x ".join(map(str, shape)) or "none",
            dtype=str(dtype),
            hint=f"write `{name}` as (height, width) float32",
        )
    return _Header(*shape, dtype, "F" if fortran else "C", stream.tell())


@contextmanager
def opened(ctx: Context, data: bytes, name: str) -> Iterator[Image]:
    """An image file whose header was read; errors of reading it name the file."""
    from PIL import Image, UnidentifiedImageError

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", Image.DecompressionBombWarning)
            opened = Image.open(io.BytesIO(data), formats=FORMATS)
        with opened:
            yield opened
    except UnidentifiedImageError:
        ctx.fail(
            f"`{name}` is not a PNG or JPEG image",
            size=f"{len(data):,} bytes",
            begins=repr(data[:8]),
            hint=f"save `{name}` as PNG or JPEG; a pointer of Git LFS is replaced by `git lfs pull`",
        )
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        ctx.fail(f"`{name}` is too large", decoder=str(error), hint="resize the photograph before writing the capture")
    except (OSError, SyntaxError, ValueError) as error:
        ctx.fail(
            f"`{name}` is truncated or damaged",
            size=f"{len(data):,} bytes",
            decoder=str(error),
            hint=f"copy `{name}` from the camera again",
        )
