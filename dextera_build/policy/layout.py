"""The channels that a task bundle or a data set offers to policies, and the names of their components."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from dextera_build import digest
from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.tasks.episode import Episode, Episodes, Film
from dextera_build.artifacts.tasks.pixels import Pixels
from dextera_build.artifacts.tasks.task import TaskBundle, View, WorldKind
from dextera_build.artifacts.tasks.term import TermSpec
from dextera_build.errors import RuleError, listing
from dextera_build.policy import cameras
from dextera_build.policy.cameras import Shown
from dextera_build.policy.declared import BY_NAME, DECLARED
from dextera_build.policy.terms import EXACT, Declared, Sensor, Term, added

WORLD = "world"
"""Channel that tells a policy the kind of its world, for training on several at once: one of `WORLDS` is 1."""
WORLDS: tuple[WorldKind, ...] = get_args(WorldKind)
"""Components of `WORLD`."""


@dataclass(frozen=True)
class Layout:
    """The inputs and outputs of policies in one world or one data set."""

    task: str
    """Name of the task."""
    embodiment: str
    """Digest of joint names and limits."""
    rate_hz: float
    """Control rate [Hz]."""
    joints: tuple[str, ...]
    """Components of actions, `joints` and `previous_action`."""
    objects: tuple[str, ...]
    """Rows of `objects`."""
    displacement: tuple[str, ...]
    """Components of `displacement`."""
    goal: tuple[str, ...]
    """Components of `goal`."""
    cameras: Mapping[str, Shown] = field(default_factory=dict)
    """Camera -> what it gives; the only one is called `PICTURE`."""
    tips: tuple[str, ...] = ()
    """Fingertips of all limbs."""
    limbs: tuple[str, ...] = ()
    """Limbs of the robot."""
    points: int = 0
    """Number of points on the surface of the task's object."""
    added: tuple[Declared, ...] = ()
    """Terms that do not come with dxb."""
    world: WorldKind = "twin"
    """Kind of the world."""
    worlds: tuple[str, ...] = WORLDS
    """Components of `WORLD`."""
    visual: float = 0.0
    """Fraction of the errors of cameras' calibrations over which starts are spread, see `Reset.visual`."""

    @property
    def seen(self) -> tuple[str, ...]:
        """Channels that the cameras give, those of one term side by side."""
        shown = sorted(self.cameras.items())
        return tuple(
            cameras.channel_of(term, name) for term in cameras.TERMS for name, each in shown if term in each.terms
        )

    def names(self, channel: str) -> tuple[str, ...] | None:
        """Names of the rows of a channel of numbers that policies may see, or None for another channel."""
        if channel == WORLD:
            return self.worlds
        declared = self.channel(channel)
        return None if declared is None else self._rows(declared)

    def channel(self, name: str) -> Declared | None:
        """The declaration of a channel of numbers that policies may see, or None for another channel."""
        found = BY_NAME.get(name) or next((each for each in self.added if each.name == name), None)
        return found if found is not None and found.is_vector else None

    def shape(self, declared: Declared) -> tuple[int, ...]:
        """Shape of one observation of a term of numbers."""
        count = self.points if declared.rows == "points" else len(self._rows(declared))
        return (count, len(declared.parts)) if declared.parts and declared.rows else (count,)

    def terms(
        self, lenses: Mapping[str, Camera] | None = None, sensors: Mapping[str, Sensor] | None = None
    ) -> tuple[Term, ...]:
        """Terms that can be observed or recorded here, without terms that have no component.

        Args:
            lenses: Camera -> intrinsics; each has a picture, depth and a cloud.
            sensors: Name of a term, or `name/camera` -> its sensor; other terms are exact.
        """
        given = sensors or {}
        found = []
        for declared in (*DECLARED, *self.added):
            if declared.rows == "cameras":
                for name, camera in (lenses or {}).items():
                    # Points have the errors of the depth that they are computed from.
                    source = "depth" if declared.name == "cloud" else declared.name
                    sensor = given.get(f"{source}/{name}", given.get(source, EXACT))
                    found.append(self._term(declared, (), _pixels(declared, camera), sensor, name))
                continue
            shape = self.shape(declared)
            if shape[0]:
                found.append(self._term(declared, self._rows(declared), shape, given.get(declared.name, EXACT)))
        return tuple(found)

    def _rows(self, declared: Declared) -> tuple[str, ...]:
        known: dict[str, tuple[str, ...]] = {
            name: getattr(self, name) for name in ("joints", "objects", "displacement", "goal", "tips", "limbs")
        }
        return known.get(declared.rows, ()) if declared.rows else declared.parts

    def _term(
        self, declared: Declared, names: tuple[str, ...], shape: tuple[int, ...], sensor: Sensor, camera: str = ""
    ) -> Term:
        rate = self.rate_hz if sensor.rate_hz is None else min(sensor.rate_hz, self.rate_hz)
        return Term(declared, names, shape, rate, sensor, camera)


def _pixels(declared: Declared, camera: Camera) -> tuple[int, ...]:
    size = (camera.height, camera.width)
    return size if declared.name == "depth" else (*size, 3)


def embodiment(robot: RobotModel) -> str:
    """Digest of a robot's action space: names of its joints, in order, and their limits [rad or m]."""
    return digest.of_value([[joint.name, float(joint.lower), float(joint.upper)] for joint in robot.joints])


def of_bundle(
    bundle: TaskBundle,
    views: Mapping[str, View] | None = None,
    rate_hz: float | None = None,
    terms: Iterable[TermSpec] = (),
) -> Layout:
    """The layout of a task bundle, seen through cameras, at its own rate or at `rate_hz`, with added terms.

    Raises:
        RuleError: Two terms have the same name.
    """
    task = bundle.task
    points = {name: len(thing.points) for name, thing in bundle.objects.items()}
    return Layout(
        task=task.name,
        embodiment=embodiment(bundle.robot),
        rate_hz=task.control_hz if rate_hz is None else rate_hz,
        joints=tuple(joint.name for joint in bundle.robot.joints),
        objects=tuple(bundle.objects),
        displacement=bundle.displacement_names,
        goal=task.goal.names,
        cameras=cameras.sizes(views or {}),
        tips=bundle.robot.tips,
        limbs=bundle.robot.limb_names,
        points=points.get(task.object, 0),
        added=_added(terms),
        world=bundle.kind,
        visual=task.reset.visual,
    )


def of_episodes(episodes: Episodes, goal: tuple[str, ...], films: Mapping[str, Film | Pixels] | None = None) -> Layout:
    """The layout of a data set with the films of its cameras; only the task has the components of its goal, `goal`."""
    shown = {
        name: Shown(film.height, film.width, bool(film.depth), cameras.stated(film.view) if film.view else None)
        for name, film in (films or {}).items()
    }
    return Layout(
        task=episodes.task,
        embodiment=episodes.embodiment,
        rate_hz=episodes.rate_hz,
        joints=episodes.joint_names,
        objects=episodes.object_names,
        displacement=episodes.displacement_names,
        goal=goal,
        cameras=shown,
        tips=episodes.tip_names,
        limbs=episodes.limb_names,
        added=_added(episodes.terms.values()),
        world=episodes.world,
    )


def world_flag(world: WorldKind) -> np.ndarray:
    """The value (W,) float32 of channel `WORLD` in a world."""
    return np.array([float(name == world) for name in WORLDS], np.float32)


def gathered(
    bundle: TaskBundle,
    items: Mapping[str, Episode],
    failures: Mapping[str, Episode],
    attempts: int,
    terms: Iterable[TermSpec] = (),
) -> Episodes:
    """Episodes of a task bundle with the names of the components of their arrays.

    Args:
        bundle: Their task.
        items: Index -> accepted episode.
        failures: Index -> discarded episode.
        attempts: Number of attempts behind both.
        terms: Terms that do not come with dxb.
    """
    here = of_bundle(bundle)
    return Episodes(
        items=dict(items),
        failures=dict(failures),
        attempts=attempts,
        task=here.task,
        embodiment=here.embodiment,
        rate_hz=here.rate_hz,
        joint_names=here.joints,
        object_names=here.objects,
        displacement_names=here.displacement,
        tip_names=bundle.robot.tips,
        limb_names=bundle.robot.limb_names,
        world=bundle.kind,
        terms={term.term: term for term in terms},
    )


def _added(specs: Iterable[TermSpec]) -> tuple[Declared, ...]:
    found: dict[str, Declared] = {}
    for spec in specs:
        if spec.term in found or spec.term in BY_NAME:
            raise RuleError(
                f"two terms are called `{spec.term}`",
                code="DXB-B391",
                facts={"terms of dxb": listing(BY_NAME, most=40)},
                hint="rename the added term, and the file of its rule",
            )
        found[spec.term] = added(spec)
    return tuple(found.values())
