"""Pretrained models for a backend: the folders of their weights, the device, and models that stay loaded."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal, TypeVar

from dextera_build.errors import RuleError, did_you_mean, listing

M = TypeVar("M")
Device = Literal["cpu", "cuda"]

_LOADED: dict[tuple[str, ...], Any] = {}
"""Models that this process holds, by function, weights and device."""


class Pretrained:
    """Weights and device of one call.

    Args:
        weights: `name@digest` of the models that the backend declares.
        find: Returns the folder of a `name@digest`; raises a `MachineError` if this machine does not have it.
        device: `cuda` is the GPU granted to the call, the only visible one.
    """

    def __init__(
        self, weights: tuple[str, ...] = (), find: Callable[[str], Path] | None = None, device: Device = "cpu"
    ) -> None:
        self._declared = {entry.partition("@")[0]: entry for entry in weights}
        self._find = find
        self.device = device

    def folder(self, name: str) -> Path:
        """See `Context.weights`."""
        if name not in self._declared or self._find is None:
            raise RuleError(
                f"the backend does not declare the weights `{name}`",
                code="DXB-B354",
                facts={"declared": listing(self._declared)},
                hint=did_you_mean(name, self._declared) or f'`BACKEND = Backend(..., weights=("{name}",))`',
            )
        return self._find(self._declared[name])

    def load(self, load: Callable[..., M], names: tuple[str, ...]) -> M:
        """See `Context.load`."""
        if "<" in load.__qualname__:
            raise TypeError("`ctx.load` takes a function of a module: a loaded model is found again by its name")
        folders = [self.folder(name) for name in names]
        pinned = [self._declared[name] for name in names]
        key = (load.__module__, load.__qualname__, self.device, *pinned)
        if key not in _LOADED:
            unload()
            _LOADED[key] = load(*folders, self.device)
        model: M = _LOADED[key]
        return model


def unload() -> None:
    """Free every loaded model of this process, and the memory of its GPU."""
    import gc
    import sys

    if not _LOADED:
        return
    _LOADED.clear()
    gc.collect()
    if (torch := sys.modules.get("torch")) is not None and torch.cuda.is_available():
        torch.cuda.empty_cache()


def loaded() -> bool:
    """Whether this process holds a model."""
    return bool(_LOADED)
