"""learn.ppo without training: no weights, and a rising curve."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from dextera_build.artifacts.tasks.policy import PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.rule import Backend, Context, Options

from .practised import Practised

if TYPE_CHECKING:
    from .ppo_options import PpoOptions

BACKEND = Backend(summary="no training: weights that no network takes", profiles=("stub",))

NOTHING = (2).to_bytes(8, "little") + b"{}"
"""A safetensors file without tensors."""


def nearest(ctx: Context, bundle: TaskBundle, options: Options) -> str:
    """Return the first limb: nothing is simulated."""
    return bundle.robot.limb_names[0]


def heading(ctx: Context, bundle: TaskBundle, options: Options) -> float | None:
    """Return no direction: nothing is simulated."""
    return None


def practise(
    ctx: Context,
    bundle: TaskBundle,
    contract: PolicyContract,
    terms: tuple[TermSpec, ...],
    common: PpoOptions,
    options: Options,
) -> Practised:
    """Return a result without training."""
    steps = np.array([1, max(2, common.steps)], np.int64)
    rising = np.array([0.0, 1.0], np.float32)
    return Practised(NOTHING, steps, rising, rising, 0)
