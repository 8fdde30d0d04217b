"""The contract between a policy and the world that it runs in: made at training, checked at every load."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.policy import SEEN, Channel, Encoding, PolicyContract, ViewSpec
from dextera_build.artifacts.tasks.task import TaskBundle, View
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError, listing
from dextera_build.policy import cameras, viewpoints
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.declared import BY_NAME, DECLARED, HIDDEN, POSE
from dextera_build.policy.layout import WORLD, Layout, of_bundle, of_episodes

VECTORS = tuple(term.name for term in DECLARED if term.is_vector)
"""Vector channels of dxb, in the order of the networks' inputs."""
CHANNELS = (*VECTORS, WORLD, *cameras.TERMS)
"""All channels of dxb that a policy may use, none of them privileged; of several cameras each has its own."""
PRIVILEGED = "privileged"
"""Setting of a contract: the number of privileged inputs, which no robot can give; such a policy can only teach."""
MISSPELLED = 0.8
"""Similarity of an unknown name to a channel of dxb, 0..1, above which it counts as a misspelling."""


def check_inputs(names: tuple[str, ...], known: tuple[str, ...] = CHANNELS) -> None:
    """Raise for inputs that no policy can have, so that a recipe with one is refused before anything is built.

    An unknown name may be that of an added term, unless it looks like a misspelling of a known one; the training
    refuses it if its data lack it.

    Args:
        names: Channels of a policy.
        known: Allowed channels of dxb.

    Raises:
        ValueError: There is none, a duplicate, one that a robot cannot measure, or a misspelled one.
    """
    if not names or len(set(names)) < len(names):
        raise ValueError("`inputs` must name one channel or more, each once")
    for name in names:
        if name in known or (cameras.is_named(name) and cameras.term_of(name) in known):
            continue
        if name not in BY_NAME and not difflib.get_close_matches(name, known, n=1, cutoff=MISSPELLED):
            continue
        why = (
            "is privileged: only a simulator measures it"
            if name in HIDDEN
            else "is no channel that this policy can take"
        )
        raise ValueError(f"`{name}` {why}; `inputs` may name {listing(known)}")


def channel(layout: Layout, name: str, only: tuple[str, ...] | None = None) -> Channel:
    """The channel called `name`, not yet normalised.

    Args:
        layout: Layout of the data.
        name: One of `CHANNELS`, or an added term.
        only: Components that the policy uses, by name; None: all.

    Raises:
        RuleError: `layout` has no such channel.
    """
    names = layout.names(name)
    if name in layout.seen:
        term = cameras.term_of(name)
        shape = layout.cameras[cameras.camera_of(name)].shape(term)
        return Channel(name=name, shape=shape, encoding=cameras.TERMS[term])
    if names is None:
        raise RuleError(
            f"there is no channel `{name}` to learn from",
            code="DXB-B501",
            facts={"channels": listing(offered(layout))},
            hint=_missing(name, layout),
        )
    kept = names if only is None else tuple(part for part in names if part in only)
    declared = layout.channel(name)
    encoding: Encoding = "pose" if declared is not None and declared.parts == POSE else "plain"
    return Channel(name=name, shape=(len(kept), *_parts(layout, name)), names=kept, encoding=encoding)


def _missing(name: str, layout: Layout) -> str | None:
    """What to do if there is no such channel of a camera; None for other channels."""
    if not cameras.is_seen(name):
        return None
    camera = cameras.camera_of(name)
    if layout.cameras and camera not in layout.cameras:
        return f"there is no film of camera `{camera}`: give it in `films`, or leave `{name}` out of `inputs`"
    todo = "give a film" if cameras.term_of(name) == "rgb" else "film with `depth: true` in `demonstrate.film`"
    return f"{todo}, or leave `{name}` out of `inputs`"


def offered(layout: Layout) -> tuple[str, ...]:
    """Names of the channels that `layout` provides."""
    return (*VECTORS, WORLD, *(term.name for term in layout.added), *layout.seen)


def _parts(layout: Layout, name: str) -> tuple[int, ...]:
    """Shape of one row of a channel."""
    declared = layout.channel(name)
    return () if declared is None else layout.shape(declared)[1:]


def check(
    contract: PolicyContract,
    bundle: TaskBundle,
    rate_hz: float | None = None,
    views: Mapping[str, View] | None = None,
    terms: Iterable[TermSpec] = (),
    *,
    teacher: bool = False,
) -> None:
    """Raise for a policy that was trained for another task, robot, rate or camera, or that sees what no robot measures.

    Args:
        contract: Inputs and outputs of the policy.
        bundle: World that it will run in.
        rate_hz: Rate at which it will be called [Hz]; None: the bundle's.
        views: The cameras of its pictures.
        terms: Terms that do not come with dxb.
        teacher: Whether it will teach in a simulation, where it may have privileged inputs.

    Raises:
        RuleError: There are differences; the error lists all of them.
    """
    if not teacher:
        refuse_teacher(contract)
    refuse(differences(contract, of_bundle(bundle, views, rate_hz, terms)))


def refuse_teacher(contract: PolicyContract) -> None:
    """Raise for a policy that sees what only a simulator knows.

    Raises:
        RuleError: It does.
    """
    if contract.settings.get(PRIVILEGED):
        raise RuleError(
            f"the teacher of `{contract.task}` sees the state of the simulator, which no robot measures",
            code="DXB-B518",
            hint="teach a student that sees less: `demonstrate.teach`, then `learn.bc_rnn` or another imitation",
        )


def refuse(found: Mapping[str, str]) -> None:
    """Raise for `differences`, if there are any.

    Raises:
        RuleError: There are; the error lists all of them.
    """
    if found:
        raise RuleError(
            f"the policy does not fit the task bundle: {', '.join(found)}",
            code="DXB-B502",
            facts=found,
            hint="train a policy for this bundle, or choose the bundle that it was trained for",
        )


def check_data(bundle: TaskBundle, episodes: Episodes) -> None:
    """Raise for a data set that was not recorded in this task with this robot.

    Raises:
        RuleError: There are differences; the error lists all of them.
    """
    here = of_bundle(bundle)
    there = of_episodes(episodes, here.goal)
    found: dict[str, str] = {}
    _compare(found, "another task", there.task, here.task)
    _compare_actions(found, there.joints, there.embodiment, here)
    _compare(found, "another rate", f"{there.rate_hz:g} Hz", f"{here.rate_hz:g} Hz")
    for name in ("objects", "displacement"):
        _compare(found, f"other `{name}`", _listed(there.names(name) or ()), _listed(here.names(name) or ()))
    if found:
        raise RuleError(
            f"the data set does not fit the task bundle: {', '.join(found)}",
            code="DXB-B503",
            facts={name: text.replace("the policy has", "the data set has") for name, text in found.items()},
            hint="record or synthesise demonstrations in this bundle",
        )


def differences(contract: PolicyContract, here: Layout) -> dict[str, str]:
    """Differences between a contract and a bundle: name of the difference -> both sides."""
    found: dict[str, str] = {}
    _compare(found, "another task", contract.task, here.task)
    _compare_actions(found, contract.action.names, contract.embodiment, here)
    _compare(found, "another rate", f"{contract.rate_hz:g} Hz", f"{here.rate_hz:g} Hz")
    for wanted in contract.inputs:
        if wanted.encoding in SEEN:
            _compare_view(found, wanted, here, contract.views)
        elif wanted.name == WORLD:
            if here.world not in wanted.names:
                found["another world"] = f"the policy knows {listing(wanted.names)}, the bundle is {here.world}"
        else:
            _compare_channel(found, wanted, here)
    return found


def _compare(found: dict[str, str], what: str, policy: str, world: str) -> None:
    if policy != world:
        found[what] = f"the policy has {policy}, the bundle has {world}"


def _compare_actions(found: dict[str, str], names: tuple[str, ...], digest: str, here: Layout) -> None:
    if digest == here.embodiment and names == here.joints:
        return
    if sorted(names) == sorted(here.joints) and names != here.joints:
        place = next(n for n, pair in enumerate(zip(names, here.joints, strict=True)) if pair[0] != pair[1])
        found["actions in another order"] = (
            f"component {place} is `{names[place]}` for the policy, `{here.joints[place]}` in the bundle"
        )
    elif names != here.joints:
        found["other actions"] = f"the policy has {_listed(names)}, the bundle has {_listed(here.joints)}"
    if digest != here.embodiment:
        why = "; the names agree, the limits do not" if names == here.joints else ""
        found["another embodiment"] = f"the policy has {digest[:12]}, the bundle has {here.embodiment[:12]}{why}"


def _compare_channel(found: dict[str, str], wanted: Channel, here: Layout) -> None:
    names = here.names(wanted.name)
    if names is None:
        found[f"no channel `{wanted.name}`"] = f"the bundle has {listing(offered(here))}"
        return
    lost = [part for part in wanted.names if part not in names]
    if wanted.name in ("joints", "previous_action") and wanted.names != here.joints:
        found[f"other `{wanted.name}`"] = f"the policy has {_listed(wanted.names)}, the bundle has {_listed(names)}"
    elif wanted.shape[1:] != _parts(here, wanted.name):
        found[f"other components of `{wanted.name}`"] = (
            f"the policy has {wanted.shape[1:]}, the bundle has {_parts(here, wanted.name)}"
        )
    elif lost and len(wanted.names) != len(names):
        found[f"another size of `{wanted.name}`"] = (
            f"the policy has {_listed(wanted.names)}, the bundle has {_listed(names)}"
        )
    elif lost:
        found[f"other `{wanted.name}`"] = f"the bundle has no {listing(lost)}, but {listing(names)}"


def _compare_view(found: dict[str, str], wanted: Channel, here: Layout, views: Mapping[str, ViewSpec]) -> None:
    """Compare what a camera gives; only the camera of a policy with several has a name."""
    term, camera = cameras.term_of(wanted.name), cameras.camera_of(wanted.name)
    named = wanted.name != term
    size = cameras.shown_in(wanted).size
    shown = here.cameras.get(camera)
    if shown is None:
        names = listing(sorted(here.cameras))
        there = f"cameras are {names}" if here.cameras.keys() != {PICTURE} else "only camera has no name"
        what = f"no camera `{camera}`" if named else "no view"
        found[what] = f"the policy looks at {size}" + (f", the bundle's {there}" if here.cameras else "")
    elif shown.size != size:
        what = f"camera `{camera}` of another size" if named else "a view of another size"
        found[what] = f"the policy has {size}, the bundle has {shown.size}"
    elif term not in shown.terms:
        found[f"no `{wanted.name}`"] = f"the camera gives {listing(shown.terms)}"
    elif camera in views and shown.view is not None:
        what = f"camera `{camera}`" if named else "the camera"
        apart = viewpoints.differences(views[camera], shown.view, here.visual)
        found |= {f"{what} {difference}": both for difference, both in apart.items()}


def _listed(names: tuple[str, ...]) -> str:
    """Names in order, abbreviated, with their number."""
    shown = ", ".join(names[:6]) + (", ..." if len(names) > 6 else "")
    return f"{len(names)} ({shown})" if names else "none"
