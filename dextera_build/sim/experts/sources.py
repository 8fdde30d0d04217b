"""The choice of demonstrations that an episode is synthesised from."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.geometry import transforms
from dextera_build.geometry.poses import to_matrix
from dextera_build.sim.control.operator import BASE, Part
from dextera_build.sim.experts.acting import acting
from dextera_build.sim.experts.runs import Run, named, runs_of, structure

ALIKE_M, ALIKE_RAD = 0.04, 0.5
"""Maximum distance between the palms of demonstrations with the same grasp [m, rad]."""


@dataclass(frozen=True)
class Source:
    """A demonstration with its runs."""

    name: str
    """Its index among the demonstrations."""
    episode: Episode
    """The demonstration."""
    objects: tuple[str, ...]
    """Bodies of `Episode.objects`."""
    runs: tuple[Run, ...]
    """Runs of its limbs."""
    grasp: int = 0
    """Number of its grasp, 0 for the most common one."""

    def pose(self, frame: str, row: int) -> np.ndarray:
        """T_base_frame (4, 4) at a step."""
        return np.eye(4) if frame == BASE else to_matrix(self.episode.objects[row, self.objects.index(frame)])

    def parts(self, row: int, limbs: Sequence[str]) -> dict[str, Part]:
        """What the limbs that move do at a step, of all `limbs` of the robot."""
        return {
            limb: Part(each.name, each.frame, each.contact)
            for each in self.episode.segments
            for limb in named(each, limbs)
            if each.first <= row < each.last
        }

    def fastest(self, speeds: np.ndarray, rate_hz: float) -> float:
        """Highest speed of a joint, as a multiple of its limit (A,) [rad/s or m/s], at a rate of steps [Hz]."""
        moved = np.abs(np.diff(self.episode.joints, axis=0)) * rate_hz
        return float((moved / speeds).max(initial=0.0))

    @property
    def starts(self) -> list[int]:
        """Steps at which runs begin, in order."""
        return sorted({run.first for run in self.runs})


def sources_of(episodes: Episodes) -> list[Source]:
    """The demonstrations that can take turns: those with the most common structure, by how common their grasp is."""
    found = []
    for name, episode in episodes.in_order():
        runs = tuple(runs_of(episode, episodes.limb_names))
        found.append(Source(name, episode, episodes.object_names, runs))
    kinds = Counter(_kind(source) for source in found)
    most = max(kinds, key=lambda kind: kinds[kind], default=())
    left = [source for source in found if _kind(source) == most]
    grouped: list[Source] = []
    grasp = 0
    while left:
        same = alike([source.episode for source in left], episodes.object_names, episodes.limb_names)
        kept = [source for source in left if any(source.episode is episode for episode in same)]
        grouped += [replace(source, grasp=grasp) for source in kept]
        left = [source for source in left if all(source is not other for other in kept)]
        grasp += 1
    return grouped


def _kind(source: Source) -> tuple[object, ...]:
    turns = tuple(source.starts.index(run.first) for run in source.runs)
    return (structure(source.runs), turns)


def nearest(shown: Sequence[np.ndarray], now: np.ndarray, keep: int, random: np.random.Generator) -> list[int]:
    """Order of demonstrations: one drawn of the `keep` in which a frame was nearest to its pose, others by distance.

    Args:
        shown: Poses (4, 4) of the frame in the demonstrations.
        now: Its current pose (4, 4).
        keep: Number of candidates.
        random: Source of the draw.
    """
    distances = [
        float(np.linalg.norm(pose[:3, 3] - now[:3, 3])) + 0.1 * transforms.angle(pose[:3, :3].T @ now[:3, :3])
        for pose in shown
    ]
    order = np.argsort(distances, kind="stable").tolist()
    drawn = order.pop(int(random.integers(min(max(1, keep), len(order)))))
    return [drawn, *order]


def alike(sources: Sequence[Episode], names: Sequence[str], limbs: Sequence[str] = ()) -> list[Episode]:
    """The largest set of demonstrations with the same grasp.

    Two demonstrations have the same grasp if their palms, at the end of the first contact, have similar poses in the
    contact's frame.

    Args:
        sources: Demonstrations with segments.
        names: Bodies of their `objects`.
        limbs: Limbs of their `hand`.
    """
    holds = [_hold(source, list(names), limbs) for source in sources]
    groups = [[other for other, pose in enumerate(holds) if _near(hold, pose)] for hold in holds]
    largest = max(groups, key=len, default=[])
    return [sources[number] for number in largest]


def _hold(source: Episode, names: list[str], limbs: Sequence[str] = ()) -> np.ndarray:
    touching = [segment for segment in source.segments if segment.contact and segment.frame]
    if not touching:
        return np.eye(4)
    segment = touching[0]
    frame = to_matrix(source.objects[segment.first, names.index(segment.frame)])
    return np.asarray(transforms.invert(frame) @ to_matrix(source.hand[segment.last - 1, acting(source, limbs)[0]]))


def _near(one: np.ndarray, other: np.ndarray) -> bool:
    apart = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    return apart < ALIKE_M and transforms.angle(one[:3, :3].T @ other[:3, :3]) < ALIKE_RAD
