"""Real-time chunking of Diffusion Policy: what each way to join answers does where there are two ways to do something.

`python -m tests.benchmarks.policies.continued`. The policy, its episodes and the runs are those of
`tests/rules/learn/test_real_time_chunking.py`: an obstacle is passed on either side, and nothing observed tells which.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch
from torch import Tensor

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.deploying.continuing import Continuing
from tests.policy.policies import runner
from tests.rules.learn.test_diffusion import learn
from tests.rules.learn.test_real_time_chunking import TRAINING, Ran, Replaced, sides

TRIALS = 40
MOST = 5.0
"""Limit of the guidance's strength, beta of Black et al."""
Told = Callable[[Tensor, int], Tensor]


def guided(told: Told, what: str, share: Tensor, known: Tensor, weights: Tensor) -> Told:
    """As `inpainting.kept`, through the Jacobian of the network: the guidance of Black et al. for levels of noise.

    Divided by sqrt(a) + sqrt(1 - a), a mixture of level a is one of flow matching at time tau = sqrt(a) / (sqrt(a) +
    sqrt(1 - a)).
    """

    def corrected(samples: Tensor, level: int) -> Tensor:
        kept, lost = share[level].sqrt(), (1 - share[level]).sqrt()
        scale = kept + lost
        tau = float(kept / scale)
        with torch.enable_grad():
            mixed = samples.detach().requires_grad_()
            found = told(mixed, level)
            clean = found if what == "sample" else (mixed - lost * found) / kept
            (way,) = torch.autograd.grad(clean, mixed, (weights * (known - clean)).detach())
        strength = min(MOST * (1 - tau), (tau**2 + (1 - tau) ** 2) / tau)
        return (clean + strength * scale * way).detach()

    return corrected


def ran(made: Checkpoint, delay: int, kind: type[Continuing], correct: Any = None) -> list[Ran]:
    """Episodes in which an answer takes `delay` periods, joined as told."""
    module = runner("diffusion")
    # Tensors of inference mode have no derivatives.
    inferring = mock.patch.object(module.torch, "inference_mode", torch.no_grad)
    with inferring, mock.patch.object(module.inpainting, "kept", correct or module.inpainting.kept):
        return [Ran(made, kind(module), delay, number) for number in range(TRIALS)]


def main() -> None:
    """Print the table."""
    print(
        "| network tells | periods of an answer | answers | largest step [rad] | changed sides |\n|---|---|---|---|---|"
    )
    for predicts in ("sample", "noise"):
        with tempfile.TemporaryDirectory() as folder:
            made = learn(Path(folder), sides(32), predicts=predicts, **TRAINING)
        for delay in (1, 3):
            for name, found in {
                "replace one another": ran(made, delay, Replaced),
                "are guided through the network": ran(made, delay, Continuing, guided),
                "continue, as built": ran(made, delay, Continuing),
            }.items():
                step, changed = np.mean([each.jump() for each in found]), sum(each.changes() for each in found)
                print(f"| {predicts} | {delay} | {name} | {step:.3f} | {changed} of {TRIALS} |", flush=True)


if __name__ == "__main__":
    main()
