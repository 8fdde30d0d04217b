"""learn.bc_rnn with torch on a GPU."""

from __future__ import annotations

from dextera_build.rule import Backend

from .bc_rnn_torch import train

__all__ = ["BACKEND", "train"]

BACKEND = Backend(
    summary="torch on a GPU; resumes after an interruption",
    packages=("torch", "safetensors"),
    extra="learn",
    gpu_gb=4.0,
)
