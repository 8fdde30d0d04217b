"""Policies whose answers continue what is carried out meanwhile, for `ahead.Ahead`."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy.continuing import Continues, Plan
from dextera_build.policy.features import Fields
from dextera_build.policy.running import Predict, Runner


class Continuing:
    """Runs a policy so that its answers continue `plan`.

    Args:
        runner: The module `policy.py` of the algorithm that trained it.
    """

    def __init__(self, runner: Runner) -> None:
        self._runner = runner
        self.plan: Plan | None = None
        """What the next answer continues; None: nothing."""

    def predict(self, checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
        """The network of a checkpoint, ready to run in a task bundle.

        Raises:
            RuleError: Its answers cannot continue a plan, or the weights are corrupt.
        """
        made = self._runner.predict(checkpoint, bundle)
        if not isinstance(made, Continues):
            raise RuleError(
                f"answers of a policy of `{checkpoint.contract.algorithm}` cannot continue what is carried out",
                code="DXB-B560",
                facts={"needed": "a policy that draws whole windows from noise, as those of learn.diffusion"},
                hint="`--asynchronous` instead of `--real-time-chunking`: it averages overlapping answers",
            )
        continues = made

        def targets(inputs: Fields, step: int) -> np.ndarray:
            return continues.continued(inputs, step, self.plan)

        return targets
