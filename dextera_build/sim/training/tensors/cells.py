"""NumPy code on tensors: the conditions and values of primitives, which are written once, judge worlds on any device.

In `on_tensors` the name `np` of a primitive's modules calls torch where an argument is a tensor, and NumPy otherwise.
Nothing is copied to the host. Words, such as the reason of a fault, are numbers in a table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from inspect import isfunction
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dextera_build.geometry import lie, transforms
from dextera_build.sim.primitives import base, poses, stages, state
from dextera_build.sim.primitives.base import Primitive

SHARED = (base, poses, stages, state, transforms, lie)
"""Modules that primitives have in common."""
OPERATORS = ("add", "sub", "mul", "truediv", "matmul", "and", "or", "lt", "le", "gt", "ge", "eq", "ne")
"""Operators whose other side may be an array or a tuple of numbers; those up to `or` also with it on the left."""
_words: list[str] = [""]
_known: dict[tuple[Any, ...], Tensor] = {}


class Cells(Tensor):
    """A tensor with the methods of NumPy's arrays that primitives call, whose operators take such arrays."""

    __array_ufunc__ = None  # so that NumPy leaves operators with its arrays to this class

    def any(self, *args: Any, **kwargs: Any) -> Any:
        """Whether any is true; without an axis, True: primitives ask so to skip work, and asking would copy."""
        return super().any(*args, **kwargs) if args or kwargs else True

    def min(self, *args: Any, axis: Any = None, initial: float | None = None, **kwargs: Any) -> Any:
        """The least along `axis`, and of `initial`."""
        if axis is None:
            return super().min(*args, **kwargs)
        return torch.amin(self, axis).clamp(max=initial)

    def transpose(self, *axes: Any) -> Any:
        """Axes in another order."""
        return self.permute(*axes) if len(axes) != 2 else super().transpose(*axes)

    def astype(self, kind: Any) -> Any:
        """The numbers in another type of Python."""
        return self.to({int: torch.int64, float: torch.float32, bool: torch.bool}[kind])


def _taking(name: str) -> Callable[[Cells, Any], Any]:
    plain = getattr(Tensor, name)

    def operator(self: Cells, other: Any) -> Any:
        return plain(self, constant(other, self.device) if isinstance(other, np.ndarray | tuple) else other)

    return operator


for _name in [*(f"__{each}__" for each in OPERATORS), *(f"__r{each}__" for each in OPERATORS[:7])]:
    setattr(Cells, _name, _taking(_name))


class Words:
    """A word for each world.

    Args:
        codes: Their numbers in the table (N,) int64.
    """

    __array_ufunc__ = None
    __hash__ = None  # type: ignore[assignment]

    def __init__(self, codes: Tensor) -> None:
        self.codes = codes

    def __eq__(self, other: object) -> Any:
        return self.codes == code(str(other))

    def __ne__(self, other: object) -> Any:
        return self.codes != code(str(other))


def code(word: str) -> int:
    """The number of a word; 0 for an empty one."""
    if word not in _words:
        _words.append(word)
    return _words.index(word)


def cells(tensor: Tensor) -> Cells:
    """`tensor` with the methods of NumPy's arrays; it shares the memory."""
    return tensor.as_subclass(Cells)


def constant(value: Any, device: torch.device) -> Tensor:
    """An array or a tuple on a device; it stays there, because the same ones come in every step."""
    array = np.asarray(value)
    array = array.astype(np.float32) if array.dtype == np.float64 else array
    key = array.shape, array.dtype.str, array.tobytes(), device
    if key not in _known:
        if len(_known) > 4096:
            _known.clear()
        _known[key] = torch.from_numpy(array.copy()).to(device)
    return cells(_known[key])


@contextmanager
def on_tensors(primitive: Primitive[Any]) -> Iterator[None]:
    """In the block, the functions of a primitive take tensors in place of arrays; arrays give what they always give."""
    # Names of a module, also of one of a project, which is not among `sys.modules`.
    functions = [each for kind in type(primitive).__mro__ for each in vars(kind).values() if isfunction(each)]
    spaces = [*(vars(module) for module in SHARED), *(each.__globals__ for each in functions)]
    changed = {id(each): each for each in spaces if each.get("np") is np}.values()
    for names in changed:
        names["np"] = NUMPY
    try:
        yield
    finally:
        for names in changed:
            names["np"] = np


class _Numpy:
    """The functions of NumPy, those of `_FUNCTIONS` also for tensors."""

    def __getattr__(self, name: str) -> Any:
        theirs, ours = getattr(np, name), _FUNCTIONS.get(name)
        if ours is None:
            return theirs

        def either(*args: Any, **kwargs: Any) -> Any:
            return ours(*args, **kwargs) if _tensors(args) else theirs(*args, **kwargs)

        return either


NUMPY = _Numpy()


def _tensors(args: Sequence[Any]) -> bool:
    """Whether tensors are among the arguments, or in lists of them."""
    return any(isinstance(each, Tensor | Words) or (isinstance(each, list) and _tensors(each)) for each in args)


def _both(function: Callable[[Tensor, Tensor], Tensor]) -> Callable[[Any, Any], Any]:
    """A function of two tensors, one of which may be a number or an array."""

    def called(one: Any, other: Any) -> Any:
        like = one if isinstance(one, Tensor) else other
        kind = like.dtype if like.dtype.is_floating_point else None
        pair = [each if isinstance(each, Tensor) else _like(each, like.device, kind) for each in (one, other)]
        return function(pair[0], pair[1])

    return called


def _like(value: Any, device: torch.device, kind: torch.dtype | None) -> Tensor:
    if isinstance(value, np.ndarray | tuple):
        return constant(value, device)
    return cells(torch.full((), value, dtype=kind, device=device))


def _where(condition: Any, one: Any, other: Any) -> Any:
    device = next(each.device for each in (condition, one, other) if isinstance(each, Tensor))
    if any(isinstance(each, str | Words) or _text(each) for each in (one, other)):
        codes = [_codes(each, device) for each in (one, other)]
        return Words(torch.where(_number(condition, device), codes[0], codes[1]))
    return torch.where(*(_number(each, device) for each in (condition, one, other)))


def _number(value: Any, device: torch.device) -> Any:
    return constant(value, device) if isinstance(value, np.ndarray) else value


def _text(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype.kind == "U"


def _codes(value: Any, device: torch.device) -> Tensor:
    if isinstance(value, Words):
        return value.codes
    if isinstance(value, str):
        return torch.full((), code(value), dtype=torch.int64, device=device)
    return constant(np.array([code(each) for each in value.tolist()], np.int64), device)


def _stack(parts: Sequence[Any]) -> Tensor:
    device = next(each.device for each in parts if isinstance(each, Tensor))
    return cells(torch.stack([_number(each, device) for each in parts]))


def _sum(value: Any, axis: Any = None) -> Any:
    return (_stack(value) if isinstance(value, list) else value).sum(dim=axis)


def _any(value: Any, axis: Any = None) -> Any:
    return (_stack(value) if isinstance(value, list) else value).any(dim=axis)


def _concatenate(parts: Sequence[Any], axis: int = 0) -> Any:
    device = next(each.device for each in parts if isinstance(each, Tensor))
    return torch.cat([_number(each, device) for each in parts], dim=axis)


def _select(conditions: Sequence[Any], choices: Sequence[Any], default: Any) -> Any:
    found = default
    for condition, choice in zip(reversed(conditions), reversed(choices), strict=True):
        found = _where(condition, choice, found)
    return found


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "abs": torch.abs,
    "any": _any,
    "arccos": torch.arccos,
    "arctan2": torch.arctan2,
    "asarray": lambda value: value,
    "concatenate": _concatenate,
    "fmin": _both(torch.fmin),
    "isfinite": torch.isfinite,
    "isnan": torch.isnan,
    "logical_and": _both(torch.logical_and),
    "logical_or": _both(torch.logical_or),
    "max": lambda value, axis: torch.amax(_stack(value), axis),
    "maximum": _both(torch.maximum),
    "min": lambda value, axis: torch.amin(_stack(value), axis),
    "minimum": _both(torch.minimum),
    "select": _select,
    "sqrt": torch.sqrt,
    "sum": _sum,
    "vecdot": _both(lambda one, other: (one * other).sum(-1)),
    "where": _where,
}
