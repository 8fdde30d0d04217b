"""Runs policies that other projects trained, in the environments of these projects."""

from __future__ import annotations

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.errors import RuleError
from dextera_build.policy.running import Predict

from .lerobot_policy import Lerobot


def predict(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """The policy of a checkpoint, in a process that ends with it.

    Raises:
        RuleError: It runs on a GPU, which its project's own server has.
        MachineError: The environment of its project is missing here.
    """
    program = str(checkpoint.contract.settings["program"])
    if program == "lerobot":
        return Lerobot(checkpoint)
    raise RuleError(
        f"a policy of `learn.{program}` is run by that project's own server",
        code="DXB-B531",
        facts={"base model": str(checkpoint.contract.settings["base"])[:12]},
        hint="`learn.files` gives its files; serve them as docs/other_trainers.md says, and ask by `learn.served`",
    )
