"""Find the bodies of a scene that would not stay where they are, and what holds the others at rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from dextera_build.artifacts.base import Folder
from dextera_build.sim.model import model as models
from dextera_build.sim.model.held import hold
from dextera_build.sim.worlds.settle import Motion, let_go

OVERLAP_M = 0.001
"""Deeper contacts at the start push bodies apart."""
SHALLOW_M = 0.004
"""Bodies this deep in each other are neighbours whose shapes are a little too large."""

MOVED_M, TURNED_RAD, PRESSED_M = 0.002, 0.02, 0.0004
"""What is told of a body that does not rest: that it would move, turn or be pressed into another by more than this."""

Pair = tuple[str, str]


@dataclass
class Steady:
    """A scene in which the bodies that are not held rest."""

    scene: Folder
    """`scene.xml` and its files."""
    held: dict[str, str] = field(default_factory=dict)
    """Body that is held -> why."""
    apart: dict[Pair, float] = field(default_factory=dict)
    """Bodies that do not collide, because they are in one place -> by how much [m]."""


def steady(scene: Folder, bodies: tuple[str, ...], seconds: float, rests: Callable[[Motion], bool]) -> Steady:
    """Let the scene go and hold what does not rest, until everything else does.

    Bodies in one place no longer collide. If one is more than 4 mm inside the other, the lighter one is held: one of
    them is a part of the other, or should not be there. Of what still moves, the lowest body is held, and the others
    are tried again: they may stand on it.

    Args:
        scene: `scene.xml` and its files.
        bodies: Root bodies, each with a free joint.
        seconds: Simulated time of an attempt [s].
        rests: Whether a body with this motion rests.

    Raises:
        RuleError: MuJoCo rejects the scene.
    """
    found = Steady(scene)
    heights = _heights(scene)
    for _ in range(2 * len(bodies)):  # each attempt holds one body more, or takes two apart
        free = tuple(name for name in bodies if name not in found.held)
        run = let_go(found.scene, free, seconds)
        restless = {motion.name: motion for motion in run.motions if run.diverged or not rests(motion)}
        if not restless:
            break
        overlapping = {p: depth for p, depth in _overlaps(found.scene, bodies).items() if restless.keys() & set(p)}
        for pair, depth in overlapping.items():
            found.apart[pair] = depth
            if depth > SHALLOW_M and not found.held.keys() & set(pair):
                found.held[pair[1]] = f"it is {1000 * depth:.0f} mm inside {pair[0]}"
        if not overlapping:
            lowest = min(restless, key=lambda name: (not _moves(restless[name]), heights[name], name))
            found.held[lowest] = _moved(restless[lowest])
        found.scene = hold(scene, found.held, found.apart)
    return found


def _heights(scene: Folder) -> dict[str, float]:
    """Body -> height of its centre of mass at the start [m]."""
    model = models.compile_folder(scene)
    data = models.at_home(model)
    return {model.body(number).name: float(data.xipos[number, 2]) for number in range(1, model.nbody)}


def _moved(motion: Motion) -> str:
    if motion.drift_m > MOVED_M:
        return f"it would move by {1000 * motion.drift_m:.0f} mm"
    if motion.tilt_rad > TURNED_RAD:
        return f"it would turn by {motion.tilt_rad:.2f} rad"
    pressed = motion.depth_m > PRESSED_M
    return f"it would be {1000 * motion.depth_m:.1f} mm inside another" if pressed else "it would not come to rest"


def _moves(motion: Motion) -> bool:
    """Whether a body goes elsewhere, and does not tremble in its place under another that does."""
    return motion.drift_m > MOVED_M or motion.tilt_rad > TURNED_RAD


def _overlaps(scene: Folder, bodies: tuple[str, ...]) -> dict[Pair, float]:
    """(heavier, lighter) bodies that are in one place -> depth [m], deepest first."""
    model = models.compile_folder(scene)
    data = models.at_home(model)
    roots = {int(model.body(name).id): name for name in bodies}
    found: dict[Pair, float] = {}
    for contact in data.contact[: data.ncon]:
        ids = sorted({_root(model, geom) for geom in contact.geom}, key=lambda b: -float(model.body_subtreemass[b]))
        if len(ids) == 2 and ids[0] in roots and ids[1] in roots and -contact.dist > OVERLAP_M:
            pair = roots[ids[0]], roots[ids[1]]
            found[pair] = max(found.get(pair, 0.0), -float(contact.dist))
    return dict(sorted(found.items(), key=lambda each: (-each[1], each[0])))


def _root(model: Any, geom: int) -> int:
    """The root body of a geom; a held body is its own root, though MuJoCo counts it to the world."""
    return int(model.body_rootid[model.geom_bodyid[geom]])
