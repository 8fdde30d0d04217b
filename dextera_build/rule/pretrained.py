"""Pretrained models for a backend: the folders of their weights, the device, and models that stay loaded."""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Protocol, TypeVar

from dextera_build.errors import MachineError, RuleError, did_you_mean, listing
from dextera_build.rule.options import Options

M = TypeVar("M")
Device = Literal["cpu", "cuda"]
_MORE_GPU = "raise `gpu_gb` of the backend so that fewer calls share the GPU, or take a smaller model or input"
_MORE_MEMORY = "build with `--jobs 1`, raise `memory_gb` of the rule, or take a smaller model or input"


class _Key(NamedTuple):
    function: str
    device: str
    weights: tuple[str, ...]


class Program(Protocol):
    """Answers `Context.outside`; see `rule.outside`."""

    def ask(
        self,
        function: str,
        returns: Any,
        inputs: Mapping[str, Any],
        *,
        options: Options,
        weights: Mapping[str, Path],
        device: Device,
        scratch: Callable[[], Path],
        emit: Callable[[str, Mapping[str, object]], None],
    ) -> tuple[Any, str, dict[str, tuple[float, str]]]:
        """The output of a function, its line and its metrics."""
        ...


_LOADED: dict[_Key, Any] = {}
"""Models that this process holds."""


class Pretrained:
    """Weights, device and program of one call.

    Args:
        weights: `name@digest` of the models that the backend declares.
        find: Returns the folder of a `name@digest`; raises a `MachineError` if this machine does not have it.
        device: `cuda` is the GPU granted to the call, the only visible one.
        program: Program of `Context.outside`; None for a backend without a program.
        others: Returns the module of a backend that this one uses, with that backend's default options.
    """

    def __init__(
        self,
        weights: tuple[str, ...] = (),
        find: Callable[[str], Path] | None = None,
        device: Device = "cpu",
        program: Program | None = None,
        others: Callable[[str], tuple[Any, Options]] | None = None,
    ) -> None:
        self._declared = {entry.partition("@")[0]: entry for entry in weights}
        self._find = find
        self.device = device
        self.program = program
        self.others = others

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

    def folders(self) -> dict[str, Path]:
        """Model -> folder, of all models that the backend declares."""
        return {name: self.folder(name) for name in self._declared}

    def load(self, load: Callable[..., M], names: tuple[str, ...]) -> M:
        """See `Context.load`."""
        if "<" in load.__qualname__:
            raise TypeError("`ctx.load` takes a function of a module: a loaded model is found again by its name")
        folders = [self.folder(name) for name in names]
        pinned = [self._declared[name] for name in names]
        key = _Key(f"{load.__module__}:{load.__qualname__}", self.device, tuple(pinned))
        if key not in _LOADED:
            _LOADED[key] = load(*folders, self.device)
        model: M = _LOADED[key]
        return model


def unload(but: tuple[str, ...] = ()) -> None:
    """Free the models of this process, and the memory of its GPU.

    Args:
        but: Weights, as `name@digest`, whose models stay.
    """
    gone = [key for key in _LOADED if not set(key.weights) <= set(but)]
    if not gone:
        return
    for key in gone:
        del _LOADED[key]
    gc.collect()
    if (torch := sys.modules.get("torch")) is not None and torch.cuda.is_available():
        torch.cuda.empty_cache()


def out_of_memory(error: BaseException, device: Device) -> MachineError | None:
    """The error to show for an exception of exhausted memory; None for any other.

    numpy and Python raise `MemoryError`, torch an `OutOfMemoryError` for a GPU and a `RuntimeError` for the CPU.
    """
    text = (str(error) or type(error).__name__).splitlines()[0]
    gpu = type(error).__name__ == "OutOfMemoryError"
    if not gpu and not isinstance(error, MemoryError) and "DefaultCPUAllocator" not in text:
        return None
    return MachineError(
        "the GPU has too little memory for the backend" if gpu else "the machine's memory is used up",
        code="DXB-E389",
        facts={"device": device, "it says": text},
        hint=_MORE_GPU if gpu else _MORE_MEMORY,
    )
