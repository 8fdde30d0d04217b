"""What all forms of a data set share: options, refusals, and the names of one step's numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.policy import layout
from dextera_build.policy.terms import Declared
from dextera_build.rule import Context, Options

from . import cameras
from .lerobot_actions import Actions
from .lerobot_features import Feature, features

OBSERVED = "observation."
"""Start of the names of the features that a policy may observe."""


class FormOptions(Options):
    """Options of every form of a data set."""

    instruction: str = ""
    """The task in words, for language-conditioned policies; empty: the task's name, `CloseLaptop` as `close laptop`."""
    camera: str = "workspace"
    """Name of the camera of `film`, which names its pictures; those of `films` have names."""
    licence: str = ""
    """Licence under which you publish the data set, as the Hub spells it (`cc-by-4.0`), for its card; empty: none."""


@dataclass(frozen=True)
class Form:
    """A form of a data set, as its card describes it."""

    title: str
    """`LeRobotDataset v3.0`."""
    place: Callable[[Declared], str]
    """Where this form holds a term, `{}` for a row or the camera; empty: nowhere."""
    load: str
    """Python that opens the folder with the loader that the form is meant for."""
    depth_unit: str = "mm"
    """Unit of its depth."""
    notes: tuple[str, ...] = ()
    """Sentences about what only this form has."""
    header: Mapping[str, object] = field(default_factory=dict)
    """More entries at the head of the card."""


def checked(ctx: Context, episodes: Episodes, given: cameras.Given, options: FormOptions) -> tuple[cameras.Camera, ...]:
    """The cameras of a data set, after a check that it has episodes, and that films fit them and their views.

    Raises:
        RuleError: Something does not fit.
    """
    if not episodes.items:
        ctx.fail("no episode counts", failures=len(episodes.failures), hint="look at their reasons in the episodes")
    return cameras.checked(ctx, episodes, given, options.camera)


def observed(bundle: TaskBundle, episodes: Episodes, actions: Actions) -> dict[str, Feature]:
    """The features that a policy may observe, by their names in forms that keep them apart from actions."""
    found = features(episodes, layout.of_bundle(bundle).goal, actions.spec.names)
    return {name.removeprefix(OBSERVED): each for name, each in found.items() if name.startswith(OBSERVED)}
