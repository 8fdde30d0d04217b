"""Weights as safetensors bytes, which contain numbers and no executable code; never a pickle."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from torch import Tensor, nn

from dextera_build.errors import RuleError, listing


def to_bytes(tensors: Mapping[str, Tensor], notes: Mapping[str, str] | None = None) -> bytes:
    """Serialize tensors by name as a safetensors file; equal tensors give equal bytes.

    Args:
        tensors: Name -> tensor.
        notes: Plain text stored in the header.
    """
    from safetensors.torch import save

    plain = {name: tensors[name].detach().contiguous() for name in sorted(tensors)}
    return save(plain, metadata=dict(notes) if notes else None)


def from_bytes(data: bytes) -> dict[str, Tensor]:
    """Parse the tensors of a safetensors file.

    Raises:
        RuleError: The bytes are not a safetensors file.
    """
    from safetensors import SafetensorError
    from safetensors.torch import load

    try:
        return load(data)
    except SafetensorError as error:
        raise RuleError("the weights are not a safetensors file", code="DXB-B504", facts={"why": error}) from None


def fill(network: nn.Module, tensors: Mapping[str, Tensor]) -> None:
    """Load weights into a network of the same shape.

    Raises:
        RuleError: Names or shapes differ, or a weight is not finite; the error names them.
    """
    wanted = network.state_dict()
    shapes = [
        f"{name} is {_shape(tensors[name])}, not {_shape(wanted[name])}"
        for name in wanted
        if name in tensors and tensors[name].shape != wanted[name].shape
    ]
    facts = {
        "missing": [name for name in wanted if name not in tensors],
        "unknown": [name for name in tensors if name not in wanted],
        "other shapes": shapes,
        "not finite": [name for name in wanted if name in tensors and not bool(torch.isfinite(tensors[name]).all())],
    }
    if any(facts.values()):
        raise RuleError(
            "the weights do not fit the network that the contract describes",
            code="DXB-B505",
            facts={name: listing(parts, most=4) for name, parts in facts.items() if parts},
        )
    network.load_state_dict(dict(tensors))


def _shape(tensor: Tensor) -> str:
    return " x ".join(str(size) for size in tensor.shape) or "a number"
