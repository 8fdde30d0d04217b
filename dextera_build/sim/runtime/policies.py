"""Load a runnable policy from a checkpoint, or raise one error with the reason."""

from __future__ import annotations

import numpy as np

from dextera_build.artifacts.policy import Checkpoint
from dextera_build.artifacts.task import TaskBundle, View
from dextera_build.policy import contract as contracts
from dextera_build.policy.features import Fields
from dextera_build.policy.layout import of_bundle
from dextera_build.policy.running import Policy, Predict


def load(
    checkpoint: Checkpoint, bundle: TaskBundle, view: View | None = None, *, rate_hz: float | None = None
) -> Policy:
    """Load the policy of a checkpoint, ready to run in a task bundle.

    Args:
        checkpoint: Weights and contract.
        bundle: The world's task; twin, reference or perturbed.
        view: The camera of an image policy.
        rate_hz: Control rate [Hz]; None: the bundle's.

    Raises:
        RuleError: The policy does not fit the bundle, or the weights are corrupt.
    """
    contract = checkpoint.contract
    contracts.check(contract, bundle, rate_hz, view)
    network = {"act": _act, "ppo": _ppo}[contract.algorithm]
    limits = np.array([(joint.lower, joint.upper) for joint in bundle.robot.joints])
    return Policy(contract, of_bundle(bundle, view, rate_hz), network(checkpoint, bundle), limits)


def _act(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """Action chunks predicted by an ACT network [rad]."""
    import torch

    from dextera_build.learning import act, reproducible, weights

    contract = checkpoint.contract
    network = act.of_contract(contract)
    weights.fill(network, weights.from_bytes(checkpoint.weights))
    network.eval()
    mean, scale = (np.array(part, np.float64) for part in (contract.action.mean, contract.action.scale))

    def predict(inputs: Fields) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            tensors = {name: torch.from_numpy(np.ascontiguousarray(field)) for name, field in inputs.items()}
            if "rgb" in tensors:
                tensors["rgb"] = act.pixels(tensors["rgb"])
            chunk: np.ndarray = network(tensors)[0].numpy()
        return chunk.astype(np.float64) * scale + mean

    return predict


def _ppo(checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
    """Joint targets chosen by a PPO network [rad]."""
    import torch

    from dextera_build.learning import ppo, reproducible, weights
    from dextera_build.sim.control.steering import Steering

    contract = checkpoint.contract
    network = ppo.of_contract(contract)
    weights.fill(network, weights.from_bytes(checkpoint.weights))
    network.eval()
    steering = Steering(bundle.robot, contract)

    def predict(inputs: Fields) -> np.ndarray:
        with reproducible.one_thread(), torch.inference_mode():
            decision = ppo.decide(network, steering.numbers(inputs))
        return steering.steered(decision, inputs)

    return predict
