"""Tensors and notes of an unfinished training in one file."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from dextera_build.errors import RuleError
from dextera_build.learning import weights


def write(file: Path, tensors: Mapping[str, Tensor], notes: Mapping[str, Any]) -> None:
    """Write a state atomically.

    Args:
        file: The file.
        tensors: Name -> tensor.
        notes: All else, as JSON has it.

    Raises:
        OSError: The file cannot be written.
    """
    fresh = file.with_suffix(".new")
    fresh.write_bytes(weights.to_bytes(tensors, {"kept": json.dumps(notes)}))
    os.replace(fresh, file)


def read(file: Path) -> tuple[dict[str, Any], dict[str, Tensor]] | None:
    """Notes and tensors of a state; None if there is none that can be read."""
    from safetensors import SafetensorError, safe_open

    try:
        with safe_open(str(file), framework="pt") as opened:
            notes: dict[str, Any] = json.loads((opened.metadata() or {})["kept"])
        return notes, weights.from_bytes(file.read_bytes())
    except (OSError, SafetensorError, RuleError, KeyError, ValueError):
        return None


def under(tensors: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    """The tensors whose names begin with a prefix, without it."""
    return {name.removeprefix(prefix): tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def moments(optimiser: torch.optim.Optimizer) -> dict[str, Tensor]:
    """What an optimiser remembers of each weight, as tensors of a state."""
    every = optimiser.state_dict()["state"].items()
    return {f"moment.{number}.{name}": torch.as_tensor(each) for number, own in every for name, each in own.items()}


def take_moments(optimiser: torch.optim.Optimizer, tensors: Mapping[str, Tensor]) -> None:
    """Give an optimiser the moments of a state."""
    found: dict[int, dict[str, Tensor]] = {}
    for name, tensor in under(tensors, "moment.").items():
        number, moment = name.split(".")
        found.setdefault(int(number), {})[moment] = tensor
    optimiser.load_state_dict(optimiser.state_dict() | {"state": found})
