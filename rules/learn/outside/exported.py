"""What a policy of another project learns from: an exported data set, and how its features are observed in a task."""

from __future__ import annotations

import json
from typing import Any, NamedTuple

from dextera_build import digest
from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Channel
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.errors import RuleError, listing
from dextera_build.policy import contract as contracts
from dextera_build.policy.cameras import PICTURE, Shown, given
from dextera_build.policy.layout import Layout, of_bundle
from dextera_build.policy.terms import Term

OBSERVED = "observation."
PICTURES = ("video", "image")


class Observed(NamedTuple):
    """Inputs of a policy, by the features of the data set that it learns from."""

    channels: tuple[Channel, ...]
    """Inputs, neither encoded nor normalised: the other project does that itself."""
    features: dict[str, list[str]]
    """Feature -> the inputs that make it up, in order."""


def check(bundle: TaskBundle, about: dict[str, Any]) -> None:
    """Raise for a data set of another task, robot, rate or kind of action.

    Args:
        bundle: The task.
        about: `meta/dextera.json` of the data set.

    Raises:
        RuleError: There are differences; the error lists all of them.
    """
    here = of_bundle(bundle)
    action = about["action"]
    pairs = {
        "another task": (about["task"]["name"], here.task),
        "another robot": (about["embodiment"][:12], here.embodiment[:12]),
        "another rate": (f"{action['rate_hz']:g} Hz", f"{here.rate_hz:g} Hz"),
        "another kind of action": (action["kind"], "joint"),
    }
    found = {
        name: f"the data set has {there}, {'policies need' if 'action' in name else 'the bundle has'} {wanted}"
        for name, (there, wanted) in pairs.items()
        if there != wanted
    }
    if found:
        raise RuleError(
            f"the data set does not fit the task bundle: {', '.join(found)}",
            code="DXB-B503",
            facts=found,
            hint="export the episodes of this bundle, whose task has `action: joint`",
        )


def described(data: Folder, name: str = "meta/dextera.json") -> dict[str, Any]:
    """A document of an exported data set.

    Raises:
        RuleError: The folder is no such data set.
    """
    if name not in data.files:
        raise RuleError(
            f"the data set has no `{name}`",
            code="DXB-B529",
            facts={"files": listing(data.files, most=4) or "none"},
            hint="`data` is a node of demonstrate.lerobot",
        )
    found: dict[str, Any] = json.loads(data.files[name])
    return found


def digest_of(data: Folder) -> str:
    """Digest of names and contents of all files."""
    return digest.of_value([[name, digest.of_bytes(data.files[name])] for name in sorted(data.files)])


def observed(bundle: TaskBundle, data: Folder, view: View | None) -> Observed:
    """The inputs of a policy that learns from all observations of a LeRobot data set.

    Args:
        bundle: The task that the policy runs in.
        data: The data set, of version v2.1 or v3.0.
        view: The camera of its pictures.

    Raises:
        RuleError: The data set has an observation that this task does not give.
    """
    check(bundle, described(data))
    features = described(data, "meta/info.json")["features"]
    here = of_bundle(bundle, given(view))
    vectors = _vectors(here)
    channels: list[Channel] = []
    made: dict[str, list[str]] = {}
    for name, facts in features.items():
        if not name.startswith(OBSERVED):
            continue
        if facts["dtype"] in PICTURES:
            channel = _picture(here, name, facts, channels)
            channels.append(channel)
            made[name] = [channel.name]
            continue
        terms = vectors.get(name, [])
        names = [part for term in terms for part in term.components]
        if names != list(facts["names"] or ()):
            raise _other(name, listing(facts["names"] or (), most=6), listing(names, most=6) or "nothing")
        channels += [_plain(here, term) for term in terms]
        made[name] = [term.declared.name for term in terms]
    return Observed(tuple(channels), made)


def _vectors(here: Layout) -> dict[str, list[Term]]:
    """Feature -> the terms that make it up."""
    found: dict[str, list[Term]] = {}
    for term in here.terms():
        if term.feature.startswith(OBSERVED) and term.declared.is_vector:
            found.setdefault(term.feature, []).append(term)
    return found


def _plain(here: Layout, term: Term) -> Channel:
    return contracts.channel(here, term.declared.name).model_copy(update={"encoding": "plain"})


def _picture(here: Layout, name: str, facts: dict[str, Any], known: list[Channel]) -> Channel:
    height, width = facts["shape"][:2]
    if (facts.get("info") or {}).get("is_depth_map"):
        raise _other(name, "depth", "colours alone, for these trainers")
    if any(channel.encoding == "picture" for channel in known):
        raise _other(name, "a second camera", "one")
    shown, wanted = here.cameras.get(PICTURE), Shown(height, width)
    if shown != wanted:
        raise _other(name, wanted.size, "no view" if shown is None else shown.size)
    return contracts.channel(here, "rgb")


def _other(name: str, wanted: str, has: str) -> RuleError:
    return RuleError(
        f"the data set has `{name}`, which this task does not give",
        code="DXB-B530",
        facts={"data set": wanted, "task": has},
        hint="export from this task, give the `view` of its film, or export without what is not observed",
    )
