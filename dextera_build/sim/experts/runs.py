"""A demonstration as runs of its limbs, which are adapted one by one (Isaac Lab Mimic's subtasks of an effector).

Constraints between limbs follow from the demonstration. *Sequential*: all limbs share one clock, so that what began
after something else had ended begins after it again. *Coordinated*: limbs that a segment names together share one
transform of its frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dextera_build.artifacts.tasks.episode import Episode, Segment


@dataclass(frozen=True)
class Run:
    """A limb's free motion, and the motion in a frame to which it leads; planned at its first step."""

    limb: str
    """The limb."""
    first: int
    """First step."""
    enters: int
    """First step in the frame."""
    last: int
    """One past the last step."""
    frame: str = ""
    """See `Segment.frame`; empty: free motion at the end of a demonstration."""
    limbs: tuple[str, ...] = ()
    """Limbs that share the transform of the frame."""
    holds: bool = False
    """Whether the hand holds something at the first step already."""


def runs_of(episode: Episode, limbs: Sequence[str]) -> list[Run]:
    """The runs of all limbs, by their first step.

    Args:
        episode: A demonstration.
        limbs: Limbs of `Episode.hand`.
    """
    found: list[Run] = []
    for limb in limbs:
        own = [segment for segment in episode.segments if limb in named(segment, limbs)]
        found += _of_limb(limb, sorted(own, key=lambda each: each.first), limbs)
    return sorted(found, key=lambda run: run.first)


def named(segment: Segment, limbs: Sequence[str]) -> tuple[str, ...]:
    """Limbs of a segment; the first limb if it names none."""
    return segment.limbs or tuple(limbs[:1])


def structure(runs: Sequence[Run]) -> tuple[tuple[str, str, tuple[str, ...]], ...]:
    """What demonstrations have in common that can take turns: frames and limbs, in order."""
    return tuple((run.limb, run.frame, run.limbs) for run in runs)


def _of_limb(limb: str, segments: Sequence[Segment], limbs: Sequence[str]) -> list[Run]:
    found: list[Run] = []
    free: list[Segment] = []
    held = False
    for segment in segments:
        if not segment.frame:
            free.append(segment)
            continue
        last = found[-1] if found else None
        if not free and last is not None and (last.frame, last.last) == (segment.frame, segment.first):
            # At the object, the object moves with the hand: keep the frame.
            shared = last.limbs if len(last.limbs) > 1 else named(segment, limbs)
            found[-1] = replace(last, last=segment.last, limbs=shared)
        else:
            first = free[0].first if free else segment.first
            holds = free[0].contact if free else held
            found.append(Run(limb, first, segment.first, segment.last, segment.frame, named(segment, limbs), holds))
        free, held = [], segment.contact
    if free:
        found.append(Run(limb, free[0].first, free[-1].last, free[-1].last))
    return found
