"""learn.served: a policy that another process or machine runs, and that is asked over the network."""

from __future__ import annotations

import json
from typing import Any, Protocol

import numpy as np

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.policy import Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import contract as contracts
from dextera_build.policy import instruction
from dextera_build.policy.added import listed
from dextera_build.policy.layout import Layout, of_bundle
from dextera_build.policy.wire.opening import POSTED
from dextera_build.policy.wire.promise import Promise
from dextera_build.rule import Context, rule

from .said import Said
from .served_options import ServedOptions

NO_WEIGHTS = (2).to_bytes(8, "little") + b"{}"
"""A safetensors file without tensors."""
DEFAULT = ("joints", "objects", "displacement", "goal")
"""Inputs of a policy that states none."""


class ServedBackend(Protocol):
    """Interface of a backend of learn.served."""

    def asked(self, ctx: Context, common: ServedOptions, options: Any) -> Said:
        """What the server at the address says."""
        ...


@rule(version=1, packages=("numpy",))
def served(
    ctx: Context[ServedBackend],
    bundle: TaskBundle,
    view: View | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: ServedOptions,
) -> Checkpoint:
    """Return a policy that runs elsewhere: its address, its contract, and the digest of what its server says.

    A server of `dxb serve` states its contract, and is refused if it does not fit the task. Of other servers, the
    options say what they take: channels by their keys, and absolute joint targets [rad] in the order of the robot's
    joints as the answer. `view` is the camera of `rgb`.
    """
    said = ctx.backend.asked(ctx, options, ctx.backend_options)
    added = listed(terms)
    here = of_bundle(bundle, view, terms=added)
    contract = _stated(said.promise) if said.promise else _given(here, options)
    settings = _settings(ctx, bundle, said, options)
    contract = contract.model_copy(update={"settings": settings, "dataset": said.digest})
    contracts.check(contract, bundle, view=view, terms=added)
    inputs = ", ".join(channel.name for channel in contract.inputs)
    steps = f"{settings['every']} of {settings['horizon']} steps"
    ctx.say(f"{said.promise.algorithm if said.promise else 'a policy'} at {options.address}: {inputs}; {steps}")
    return Checkpoint(
        weights=NO_WEIGHTS,
        contract=contract,
        steps=np.zeros(0, np.int64),
        curve=np.zeros(0, np.float32),
        curve_name="trained elsewhere",
    )


def _stated(promise: Promise) -> PolicyContract:
    """The contract that a server of dxb states."""
    return PolicyContract(
        algorithm="served",
        task=promise.task,
        embodiment=promise.embodiment,
        inputs=tuple(each.channel() for each in promise.inputs),
        action=Channel(name="action", shape=(len(promise.joints),), names=promise.joints),
        rate_hz=promise.rate_hz,
        dataset="",
        settings={},
    )


def _given(here: Layout, options: ServedOptions) -> PolicyContract:
    """The contract that the options and the task give; nothing is normalised, and poses stay quaternions."""
    names = options.inputs or (("rgb",) if options.address.startswith(POSTED) else DEFAULT)
    channels = (contracts.channel(here, name) for name in names)
    return PolicyContract(
        algorithm="served",
        task=here.task,
        embodiment=here.embodiment,
        inputs=tuple(
            each if each.encoding == "picture" else each.model_copy(update={"encoding": "plain"}) for each in channels
        ),
        action=Channel(name="action", shape=(len(here.joints),), names=here.joints),
        rate_hz=here.rate_hz,
        dataset="",
        settings={},
    )


def _settings(
    ctx: Context, bundle: TaskBundle, said: Said, options: ServedOptions
) -> dict[str, float | int | str | bool]:
    """What `policy.py` needs; of overlapping answers of other servers, the newest counts alone."""
    promise = said.promise
    horizon = promise.horizon if promise else options.horizon or 1
    if options.horizon not in (0, horizon):
        ctx.fail(
            f"the answers of this server have {horizon} steps", horizon=options.horizon, hint="leave out `horizon`"
        )
    every = options.every or (promise.every if promise else horizon)
    if every > horizon:
        ctx.fail(f"an answer has {horizon} steps, fewer than are to be carried out", every=every)
    posted = options.address.startswith(POSTED)
    words = options.instruction or instruction.of_task(bundle.task)
    return {
        "address": options.address,
        "horizon": horizon,
        "every": every,
        "history": promise.history if promise else 1,
        "used": horizon if promise else every,
        "forget": promise.forget if promise else 0.0,
        "reset": promise.reset if promise else "",
        "keys": json.dumps({**({"rgb": "image"} if posted else {}), **options.keys}, sort_keys=True),
        "instruction": "" if promise else words,
        "instruction_key": options.instruction_key or ("instruction" if posted else "prompt"),
        "unnorm_key": options.unnorm_key,
        "key_in": options.key_in,
        "first_s": options.first_s,
        "answer_s": options.answer_s,
        "revision": options.revision,
    }
