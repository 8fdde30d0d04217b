"""learn.served: a policy that another process or machine runs, and that is asked over the network."""

from __future__ import annotations

import json
from typing import Any, Protocol

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.policy import SEEN, Channel, Checkpoint, PolicyContract
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.policy import cameras, instruction
from dextera_build.policy import contract as contracts
from dextera_build.policy.added import listed
from dextera_build.policy.layout import Layout, of_bundle
from dextera_build.policy.wire.asked import Settings, elsewhere, promised, stated
from dextera_build.policy.wire.opening import POSTED
from dextera_build.policy.wire.said import Said
from dextera_build.rule import Context, rule

from .served_options import ServedOptions

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
    views: Collection[View] | None = None,
    terms: Collection[TermSpec] | None = None,
    *,
    options: ServedOptions,
) -> Checkpoint:
    """Return a policy that runs elsewhere: its address, its contract, and the digest of what its server says.

    A server of `dxb serve` states its contract, and is refused if it does not fit the task. Of other servers, the
    options say what they take: channels by their keys, and absolute joint targets [rad] in the order of the robot's
    joints as the answer. `view` is the camera of `rgb`, `views` are several, of `rgb/NAME`.
    """
    said = ctx.backend.asked(ctx, options, ctx.backend_options)
    added, shown = listed(terms), cameras.given(view, views)
    here = of_bundle(bundle, shown, terms=added)
    settings = _settings(ctx, bundle, said, options)
    contract = stated(said.promise, said.digest, settings) if said.promise else _given(here, said, options, settings)
    contracts.check(contract, bundle, views=shown, terms=added)
    inputs = ", ".join(channel.name for channel in contract.inputs)
    steps = f"{settings['every']} of {settings['horizon']} steps"
    ctx.say(f"{said.promise.algorithm if said.promise else 'a policy'} at {options.address}: {inputs}; {steps}")
    return elsewhere(contract)


def _given(here: Layout, said: Said, options: ServedOptions, settings: Settings) -> PolicyContract:
    """The contract that the options and the task give; nothing is normalised, and poses stay quaternions."""
    names = options.inputs or (("rgb",) if options.address.startswith(POSTED) else DEFAULT)
    channels = (contracts.channel(here, name) for name in cameras.spread(names, here.cameras))
    return PolicyContract(
        algorithm="served",
        task=here.task,
        embodiment=here.embodiment,
        inputs=tuple(
            each if each.encoding in SEEN else each.model_copy(update={"encoding": "plain"}) for each in channels
        ),
        action=Channel(name="action", shape=(len(here.joints),), names=here.joints),
        rate_hz=here.rate_hz,
        dataset=said.digest,
        settings=settings,
    )


def _settings(ctx: Context, bundle: TaskBundle, said: Said, options: ServedOptions) -> Settings:
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
    own: Settings = {"every": every, "unnorm_key": options.unnorm_key, "revision": options.revision}
    posted = options.address.startswith(POSTED)
    own["keys"] = json.dumps({**({"rgb": "image"} if posted else {}), **options.keys}, sort_keys=True)
    own["instruction_key"] = options.instruction_key or ("instruction" if posted else "prompt")
    if promise:
        return promised(promise, options.address, options.key_in, options.first_s, options.answer_s) | own
    return own | {
        "address": options.address,
        "horizon": horizon,
        "history": 1,
        "used": every,
        "forget": 0.0,
        "reset": "",
        "instruction": options.instruction or instruction.of_task(bundle.task),
        "key_in": options.key_in,
        "first_s": options.first_s,
        "answer_s": options.answer_s,
    }
