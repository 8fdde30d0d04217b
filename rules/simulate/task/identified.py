"""simulate.identified: a task with the dynamics that recordings of a robot have shown."""

from __future__ import annotations

import math
from typing import Any, Protocol

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.dynamics import DynamicsEstimate
from dextera_build.artifacts.tasks.task import TaskBundle, TaskObject
from dextera_build.policy.layout import embodiment
from dextera_build.rule import Context, rule
from dextera_build.statistics import Z90


class IdentifiedBackend(Protocol):
    """Interface of a backend of simulate.identified."""

    def model(self, ctx: Context, bundle: TaskBundle, dynamics: DynamicsEstimate, options: Any) -> Folder:
        """The model with what was identified."""
        ...


@rule(version=1)
def identified(ctx: Context[IdentifiedBackend], bundle: TaskBundle, dynamics: DynamicsEstimate) -> TaskBundle:
    """Return the same task with what `align.dynamics` identified; poses, goal and starts' ranges do not change.

    Mass and friction of the object become the estimates, and their intervals those of the estimates (90 %), from which
    starts draw. Joints of arms get their stiffness, damping [N m s/rad] and dry friction, the robot its latency [s];
    gains are drawn from a smaller range where the stiffness was identified. What was not identified stays.
    """
    ctx.check(
        bundle.kind == "twin",
        f"dynamics are put into a twin, but this task is in a {bundle.kind} world",
        hint="give the bundle of `simulate.task`, and make the other world of the result",
    )
    ctx.check(
        dynamics.embodiment == embodiment(bundle.robot),
        "the dynamics are those of another robot",
        hint="estimate them with `align.dynamics` and recordings of this robot",
    )
    missing = sorted(set(dynamics.objects) - set(bundle.objects))
    ctx.check(
        not missing, f"the task has no object `{missing[0] if missing else ''}`, of which dynamics were estimated"
    )
    model = ctx.backend.model(ctx, bundle, dynamics, ctx.backend_options)
    shares = dict(bundle.gain_share)
    for name, joint in dynamics.joints.items():
        if joint.stiffness.identified:
            share = min(1.0, joint.stiffness.sigma / joint.stiffness.prior_sigma)
            shares[name] = shares.get(name, 1.0) * share
    count = sum(each.identified for each in dynamics.estimates.values())
    ctx.metric("identified", count)
    ctx.say(f"{dynamics.task}: {count} of {len(dynamics.estimates)} quantities from {dynamics.runs} recordings")
    return bundle.model_copy(
        update={
            "model": model,
            "objects": bundle.objects
            | {name: _known(bundle.objects[name], dynamics, name) for name in dynamics.objects},
            "latency_s": dynamics.latency_s.value if dynamics.latency_s.identified else bundle.latency_s,
            "gain_share": shares,
        }
    )


def _known(thing: TaskObject, dynamics: DynamicsEstimate, name: str) -> TaskObject:
    found, update = dynamics.objects[name], dict[str, Any]()
    if found.mass_kg.identified:
        half = Z90 * found.mass_kg.sigma
        update["mass_scale"] = (math.exp(-half), math.exp(half))
    if found.friction.identified:
        update |= {"friction": found.friction.value, "friction_sigma": found.friction.sigma}
    return thing.model_copy(update=update)
