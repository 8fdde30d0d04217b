"""demonstrate.gather: merge the shards of a data set."""

from __future__ import annotations

from dextera_build.artifacts.base import Collection
from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.rule import Context, rule

NAMES = ("joint_names", "object_names", "displacement_names", "tip_names", "limb_names")
SAME = ("task", "embodiment", "rate_hz", "world", *NAMES, "terms")
"""Fields that must be equal in all shards."""


AGAIN = "its start is that of another episode"
"""Reason of an episode that is left out because an earlier one has the same seed."""


@rule(version=2)
def gather(ctx: Context, shards: Collection[Episodes]) -> Episodes:
    """Return all episodes of the shards in index order, and the discarded ones.

    Of episodes with the same seed only the first one is kept: a learner would see one start twice, and a trial could
    begin where a policy was trained.
    """
    parts = [shards.items[label] for label in sorted(shards.items)]
    ctx.check(bool(parts), "no shards were given", hint="set `episodes` above 0")
    items: dict[str, Episode] = {}
    failures: dict[str, Episode] = {}
    seeds: set[int] = set()
    for part in parts:
        for field in SAME:
            one, other = getattr(parts[0], field), getattr(part, field)
            ctx.check(one == other, f"the shards differ in `{field}`", first=one, other=other)
        twice = sorted({*items, *failures} & set(part.items))
        ctx.check(not twice, f"two shards hold episode `{twice[0] if twice else ''}`")
        failures |= part.failures
        for name, episode in part.in_order():
            if episode.start.seed in seeds:
                failures[name] = episode.model_copy(update={"success": False, "reason": AGAIN})
            else:
                items[name] = episode
                seeds.add(episode.start.seed)
    attempts = sum(part.attempts for part in parts)
    ctx.metric("episodes", len(items))
    ctx.metric("yield", len(items) / max(1, attempts))
    ctx.say(f"{len(items)} episodes from {attempts} attempts ({100 * len(items) / max(1, attempts):.0f} %)")
    found = parts[0].model_copy(update={"items": items, "failures": failures, "attempts": attempts})
    for reason, count in found.reasons.items():
        ctx.log(f"{count} x {reason}")
    return found
