"""Files of a policy that another project trained, as the weights of a checkpoint: safetensors, never a pickle."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from dextera_build.errors import RuleError


def to_bytes(files: Mapping[str, bytes]) -> bytes:
    """A safetensors file that holds each file as an array of bytes; equal files give equal bytes.

    Args:
        files: Path -> content.
    """
    from safetensors.numpy import save

    return save({name: np.frombuffer(files[name], np.uint8) for name in sorted(files)})


def unpack(weights: bytes, folder: Path) -> None:
    """Write the files below a folder.

    Raises:
        RuleError: The bytes do not come from `to_bytes`.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        found = load(weights)
    except SafetensorError as error:
        raise RuleError("the weights are not a safetensors file", code="DXB-B528", facts={"why": error}) from None
    for name, data in found.items():
        path = (folder / name).resolve()
        if data.dtype != np.uint8 or not path.is_relative_to(folder.resolve()):
            raise RuleError("the weights hold something else than files", code="DXB-B528", facts={"name": name})
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data.tobytes())
