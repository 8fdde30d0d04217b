"""Contracts and checkpoints of the hand-made task, without a training."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.code.companions import beside
from dextera_build.code.loader import Library
from dextera_build.policy import contract as contracts
from dextera_build.policy import layout
from dextera_build.policy.cameras import PICTURE, given
from dextera_build.policy.observation import DeployableObservation, Frame, Measurement, deployable
from dextera_build.policy.running import Policy
from tests import episodes

INPUTS = ("joints", "objects", "displacement", "goal")


def runner(algorithm: str = "act") -> Any:
    """The module `policy.py` of an algorithm, which has its `network`."""
    return beside(Library().find(f"learn.{algorithm}"), "policy").module


def load(
    checkpoint: Checkpoint,
    bundle: TaskBundle,
    view: View | None = None,
    *,
    views: Mapping[str, View] | None = None,
    **more: float,
) -> Policy:
    """`sim.runtime.policies.load` with the module of the checkpoint's algorithm."""
    from dextera_build.sim.runtime import policies

    return policies.load(runner(checkpoint.contract.algorithm), checkpoint, bundle, views or given(view), **more)


def contract(
    bundle: TaskBundle,
    inputs: tuple[str, ...] = INPUTS,
    view: View | None = None,
    *,
    views: Mapping[str, View] | None = None,
    algorithm: str = "act",
    **settings: float | str,
) -> PolicyContract:
    """A contract for `bundle` with a very small network; its actions are not normalised."""
    here = layout.of_bundle(bundle, views or given(view))
    count = len(here.joints)
    return PolicyContract(
        algorithm=algorithm,
        task=here.task,
        embodiment=here.embodiment,
        inputs=tuple(contracts.channel(here, name) for name in inputs),
        action=Channel(name="action", shape=(count,), names=here.joints, mean=(0.0,) * count, scale=(1.0,) * count),
        rate_hz=here.rate_hz,
        dataset="0" * 64,
        settings={"chunk": 4, "width": 16, "heads": 2, "latent": 2} | settings,
        views={name: shown.view for name, shown in here.cameras.items() if shown.view is not None},
    )


def checkpoint(made: PolicyContract, seed: int = 0) -> Checkpoint:
    """Untrained weights for a contract."""
    from dextera_build.learning import weights

    data = weights.to_bytes(runner(made.algorithm).network.of_contract(made, seed).state_dict())
    return Checkpoint(
        weights=data,
        contract=made,
        steps=np.array([1], np.int64),
        curve=np.array([1.0], np.float32),
        curve_name="L1 loss",
    )


def observation(step: int = 0, rgb: np.ndarray | None = None, **fields: np.ndarray) -> DeployableObservation:
    """What the policy would see at one step of a hand-made episode, with a picture or without."""
    one = episodes.episode()
    frames = {} if rgb is None else {PICTURE: Frame(rgb=rgb)}
    seen = {"joints": one.joints[step], "objects": one.objects[step], "displacement": one.displacement[step]}
    return deployable(Measurement(**(seen | fields), frames=frames), one.start.ctrl, one.goal)
