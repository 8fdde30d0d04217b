"""demonstrate.mixture: several episode sets of one task, in fixed proportions."""

from __future__ import annotations

import numpy as np
from pydantic import Field, PositiveInt

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.mixture import Mixture
from dextera_build.errors import listing
from dextera_build.rule import Context, Options, rule

from . import gather

OWN = ("world", "tip_names")
"""Fields in which sets may differ: their worlds, and fingertips, which a cell does not measure."""
SAME = tuple(field for field in gather.SAME if field not in OWN)
"""Fields that must be equal in all sets."""


class MixtureOptions(Options):
    """Options of demonstrate.mixture."""

    weights: dict[str, PositiveInt] = Field(default_factory=dict)
    """Label -> its share of every batch, relative to the others; a label without one: 1."""


@rule(version=1, packages=("numpy",))
def mixture(ctx: Context, sets: Collection[Episodes], *, options: MixtureOptions | None = None) -> Mixture:
    """Return the sets with the number of samples that each has in a batch, and statistics of their actions [rad].

    Sets keep their own worlds, so that a policy may be told which one a sample is from (input `world`). A learner
    normalises with the same weights, whatever the sizes of the sets.
    """
    options = options or MixtureOptions()
    parts = dict(sets.items)
    unknown = sorted(options.weights.keys() - parts.keys())
    ctx.check(not unknown, f"there is no set `{unknown[0] if unknown else ''}` to weigh", sets=listing(parts))
    ctx.check(bool(parts), "no sets were given", hint="sets: {twin: $episodes, reference: $recorded}")
    empty = [label for label, part in parts.items() if not part.items]
    ctx.check(
        not empty, f"the set `{empty[0] if empty else ''}` has no episode", hint="look at why its attempts failed"
    )
    first = next(iter(parts))
    for label, part in parts.items():
        for field in SAME:
            one, other = getattr(parts[first], field), getattr(part, field)
            ctx.check(one == other, f"the sets `{first}` and `{label}` differ in `{field}`", first=one, other=other)
    weights = {label: options.weights.get(label, 1) for label in parts}
    actions = {label: np.concatenate([one.action for one in part.items.values()]) for label, part in parts.items()}
    for label, part in parts.items():
        steps, share = len(actions[label]), 100 * weights[label] / sum(weights.values())
        ctx.log(f"{label}: {part.world} world, {len(part.items)} episodes, {steps:,} steps, {share:.0f} % of a batch")
    ctx.say(" : ".join(f"{weights[label]} {label}" for label in parts))
    return Mixture(
        parts=parts,
        weights=weights,
        action_mean={label: each.mean(axis=0, dtype=np.float64) for label, each in actions.items()},
        action_sigma={label: each.std(axis=0, dtype=np.float64) for label, each in actions.items()},
    )
