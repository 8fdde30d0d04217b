"""The declared form of array fields (shape, dtype, unit, frame), and checks of arrays against it.

NumPy is imported with the first array, because the import is slow and many rules take no arrays.
"""

from __future__ import annotations

import math
import mmap
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

from dextera_build.artifacts.core.content import Put
from dextera_build.errors import ArtifactError

if TYPE_CHECKING:
    import numpy as np

_BLOCK = 1 << 24
"""Bytes of an array that are checked at a time."""
_NUMBERS = re.compile(r"bool|(u?int|float|complex)[0-9]+|(datetime|timedelta)64\[\w+\]")
"""Full dtype names, as stored; NumPy accepts further spellings, some of them deprecated."""


@dataclass(frozen=True)
class Array:
    """The declared form of an array field, used as `Annotated[np.ndarray, Array("V 3", "float32", unit="m")]`.

    Args:
        shape: Axis sizes separated by spaces: numbers, names that must agree within one artifact, or `*` for any size;
            a trailing `...` allows any number of further axes.
        dtype: NumPy dtype name.
        unit: SI unit, or "" for a pure number.
        frame: The frame that coordinates are expressed in, or "".
        finite: Whether NaN and infinities are refused.
    """

    shape: str
    dtype: str
    unit: str = ""
    frame: str = ""
    finite: bool = True

    def describe(self) -> str:
        """`float32 (V, 3) [m] in object`."""
        unit = f" [{self.unit}]" if self.unit else ""
        frame = f" in {self.frame}" if self.frame else ""
        return f"{self.dtype} ({', '.join(self.shape.split())}){unit}{frame}"


def is_array(value: object) -> TypeGuard[np.ndarray]:
    """Whether `value` is an array; if NumPy is not loaded, there are none."""
    return isinstance(value, getattr(sys.modules.get("numpy"), "ndarray", ()))


def array_bytes(value: np.ndarray) -> bytes:
    """The stored form of an array: its numbers, little-endian, in C order."""
    import numpy as np

    return np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<")).tobytes()


def stored_array(value: np.ndarray, put: Put) -> str:
    """Store the numbers of an array, without a copy if its memory layout is the stored one and `put` supports it."""
    import numpy as np

    view = getattr(put, "view", None)
    if view is None or not value.size:
        return put(array_bytes(value))
    flat = np.ascontiguousarray(value, dtype=value.dtype.newbyteorder("<")).reshape(-1)
    return str(view(flat.view(np.uint8).data))


def array_of(dtype: str, shape: list[int], data: bytes) -> np.ndarray:
    """The array that was stored as `data`.

    Raises:
        ValueError: `dtype` is no numeric type, or the bytes are not such an array.
        TypeError: NumPy has no such dtype.
    """
    import numpy as np

    return np.frombuffer(data, dtype=_dtype(dtype)).reshape(shape).copy()


def mapped_array(dtype: str, shape: list[int], file: Path) -> np.ndarray:
    """The array stored in `file`, memory-mapped, so that only the used parts are read.

    Raises:
        ValueError: `dtype` is no numeric type, or the file does not have the size of such an array.
        TypeError: NumPy has no such dtype.
    """
    import numpy as np

    size = file.stat().st_size
    if size != array_size(dtype, shape):
        raise ValueError(f"{size:,} bytes are not an array of {dtype} {tuple(shape)}")
    return np.asarray(np.memmap(file, _dtype(dtype), "r", shape=tuple(shape)))  # results of a `memmap` are one, too


def array_size(dtype: str, shape: list[int]) -> int:
    """Number of bytes of an array as stored.

    Raises:
        ValueError: `dtype` is no numeric type.
        TypeError: NumPy has no such dtype.
    """
    return _dtype(dtype).itemsize * math.prod(shape)


def _dtype(name: str) -> np.dtype[Any]:
    if not _NUMBERS.fullmatch(name):
        raise ValueError(f"`{name}` is not a numeric dtype")
    import numpy as np

    return np.dtype(name).newbyteorder("<")


def check_array(place: str, name: str, value: np.ndarray, spec: Array, axes: dict[str, tuple[str, int]]) -> None:
    """Raise for an array that does not have the declared form, and make it read-only.

    Args:
        place: The field as shown in messages.
        name: The field.
        value: The array.
        spec: Its form.
        axes: Name of an axis -> (first field with it, size); updated.

    Raises:
        ArtifactError: Its dtype, number of axes, sizes or numbers are wrong.
    """
    import numpy as np

    if value.dtype != np.dtype(spec.dtype):
        raise ArtifactError(f"{place}: dtype is {value.dtype}, but {spec.describe()} is declared", code="DXB-A103")
    wanted = spec.shape.split()
    if wanted[-1:] == ["..."]:
        wanted[-1:] = ["*"] * (value.ndim - len(wanted) + 1)
    if value.ndim != len(wanted):
        raise ArtifactError(f"{place}: shape is {value.shape}, but {spec.describe()} is declared", code="DXB-A104")
    for axis, size in zip(wanted, value.shape, strict=True):
        if axis == "*":
            continue
        first, known = axes.setdefault(axis, (name, int(axis) if axis.isdigit() else size))
        if size != known:
            source = "the type" if axis.isdigit() else first
            raise ArtifactError(f"{place}: axis {axis} is {size}, but {source} says {known}", code="DXB-A105")
    bad = _not_finite(value) if spec.finite and value.dtype.kind == "f" else 0
    if bad:
        raise ArtifactError(f"{place}: {bad:,} of {value.size:,} numbers are not finite", code="DXB-A106")
    value.flags.writeable = False


def _not_finite(value: np.ndarray) -> int:
    """Number of non-finite numbers; a large array is checked in blocks, and memory-mapped pages are released again."""
    import numpy as np

    if value.nbytes <= _BLOCK or not value.flags.c_contiguous:
        return value.size - int(np.isfinite(value).sum())
    flat, step = value.reshape(-1), _BLOCK // value.itemsize
    found, mapped = 0, _mapping(value)
    for first in range(0, value.size, step):
        block = flat[first : first + step]
        found += block.size - int(np.isfinite(block).sum())
        if mapped is not None:
            mapped.madvise(mmap.MADV_DONTNEED)
    return found


def _mapping(value: Any) -> mmap.mmap | None:
    """The read-only memory map of a file that contains an array; its pages can be read again."""
    while value is not None and not isinstance(value, mmap.mmap):
        value = getattr(value, "base", None)
    return value if value is not None and memoryview(value).readonly else None
