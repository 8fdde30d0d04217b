"""Load a runnable policy from a checkpoint, or raise one error with the reason."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import contract as contracts
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.running import Policy, Runner


def load(
    runner: Runner,
    checkpoint: Checkpoint,
    bundle: TaskBundle,
    views: Mapping[str, View] | None = None,
    *,
    rate_hz: float | None = None,
    terms: Collection[TermSpec] = (),
) -> Policy:
    """Load the policy of a checkpoint, ready to run in a task bundle.

    Args:
        runner: The module `policy.py` of the algorithm that trained it.
        checkpoint: Weights and contract.
        bundle: The world's task; twin, reference or perturbed.
        views: The cameras of an image policy; the only one is called `PICTURE`.
        rate_hz: Control rate [Hz]; None: the bundle's.
        terms: Terms of observations that do not come with dxb.

    Raises:
        RuleError: The policy does not fit the bundle, or the weights are corrupt.
    """
    contract = checkpoint.contract
    contracts.check(contract, bundle, rate_hz, views, terms)
    limits = np.array([(joint.lower, joint.upper) for joint in bundle.robot.joints])
    return Policy(contract, of_bundle(bundle, views, rate_hz, terms), runner.predict(checkpoint, bundle), limits)
