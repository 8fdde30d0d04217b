"""Find the bodies of a scene that would not stay in place, and fix them so that the others rest."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from dextera_build.artifacts.base import Folder
from dextera_build.errors import listing
from dextera_build.sim.model import model as models
from dextera_build.sim.model.fixed_bodies import hold
from dextera_build.sim.worlds.settle import Motion, Run, let_go

OVERLAP_M = 0.001
"""Contacts deeper than this at the start push bodies apart [m]."""
SHALLOW_M = 0.004
"""Bodies that overlap up to this depth are neighbours whose shapes are slightly too large [m]."""

MOVED_M, TURNED_RAD, PRESSED_M = 0.002, 0.02, 0.0004
"""Thresholds above which translation, rotation or penetration of a body that does not rest is reported."""
FALLS_M, MOSTLY = 0.02, 0.8
"""A body falls if it moves down by more than this, and by this fraction of its whole motion [m, 1]."""
TIPS_RAD = 0.17
"""A body that turns farther tips over [rad]."""

Pair = tuple[str, str]


@dataclass
class Steady:
    """A scene in which all free bodies rest."""

    scene: Folder
    """`scene.xml` and its files."""
    held: dict[str, str] = field(default_factory=dict)
    """Fixed body -> reason."""
    apart: dict[Pair, float] = field(default_factory=dict)
    """Overlapping bodies whose collisions are disabled -> depth [m]."""


def steady(scene: Folder, bodies: tuple[str, ...], seconds: float, rests: Callable[[Motion], bool]) -> Steady:
    """Simulate the scene and fix bodies that do not rest, until all others do.

    Collisions of overlapping bodies are disabled. If one is more than 4 mm inside the other, the lighter one is fixed:
    one of them is a part of the other, or a false detection. Of the bodies that still move, the lowest is fixed, and
    the others are tried again, because they may stand on it. Finally each fixed body is tried once more, the heaviest
    first, because what was fixed after it may have pushed it.

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
    for _ in range(2 * len(bodies)):  # each attempt fixes one more body, or disables the collisions of one more pair
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
            found.held[lowest] = _cause(restless[lowest], _touched(found.scene, lowest))
        found.scene = hold(scene, found.held, found.apart)
    _release(scene, bodies, found, lambda trial, free: _all_rest(let_go(trial, free, seconds), rests))
    return found


def _all_rest(run: Run, rests: Callable[[Motion], bool]) -> bool:
    return not run.diverged and all(rests(motion) for motion in run.motions)


def _release(
    scene: Folder, bodies: tuple[str, ...], found: Steady, rest: Callable[[Folder, tuple[str, ...]], bool]
) -> None:
    """Free every fixed body with which all free ones rest too, the heaviest first; not one that is inside another."""
    model = models.compile_folder(scene)
    for name in sorted(found.held, key=lambda name: (-float(model.body_subtreemass[model.body(name).id]), name)):
        if any(name in pair and depth > SHALLOW_M for pair, depth in found.apart.items()):
            continue
        held = {other: why for other, why in found.held.items() if other != name}
        trial = hold(scene, held, found.apart)
        if held and rest(trial, tuple(body for body in bodies if body not in held)):
            found.held, found.scene = held, trial


def _heights(scene: Folder) -> dict[str, float]:
    """Body -> height of its centre of mass at the start [m]."""
    model = models.compile_folder(scene)
    data = models.at_home(model)
    return {model.body(number).name: float(data.xipos[number, 2]) for number in range(1, model.nbody)}


def _cause(motion: Motion, touched: dict[str, float]) -> str:
    """Why a body is fixed: what carries it is missing, hidden or too small, or its shape does not stand.

    Args:
        motion: Its motion.
        touched: What it touches at the start ("" for the static scene) -> depth [m].
    """
    others = [name for name in touched if name]
    inside = max(touched, key=lambda name: touched[name], default="")
    if touched and touched[inside] > OVERLAP_M:
        return f"it is {1000 * touched[inside]:.0f} mm inside {inside or 'the room'}"
    if motion.fall_m > max(FALLS_M, MOSTLY * motion.drift_m):
        return f"nothing carries it: it would fall by {1000 * motion.fall_m:.0f} mm"
    if motion.tilt_rad > TIPS_RAD:
        leans = f"it leans on {listing(others)}" if others else "it leans, or its lower part is hidden"
        return f"it would tip over by {math.degrees(motion.tilt_rad):.0f} deg: {leans}"
    if motion.drift_m > MOVED_M:
        slides = f"it slides off {listing(others)}" if others else "what carries it is hidden"
        return f"it would move by {1000 * motion.drift_m:.0f} mm: {slides}"
    if motion.tilt_rad > TURNED_RAD:
        return f"it would turn by {math.degrees(motion.tilt_rad):.1f} deg"
    pressed = motion.depth_m > PRESSED_M
    return f"it would be {1000 * motion.depth_m:.1f} mm inside another" if pressed else "it would not come to rest"


def _touched(scene: Folder, name: str) -> dict[str, float]:
    """What a body touches at the start, by root body, "" for the static scene -> depth [m]."""
    model = models.compile_folder(scene)
    data = models.at_home(model)
    own = int(model.body(name).id)
    found: dict[str, float] = {}
    for contact in data.contact[: data.ncon]:
        roots = [_root(model, geom) for geom in contact.geom]
        if own in roots:
            other = roots[1 - roots.index(own)]
            label = model.body(other).name if other and other != own else ""
            found[label] = max(found.get(label, 0.0), -float(contact.dist))
    return found


def _moves(motion: Motion) -> bool:
    """Whether a body moves away, rather than being shaken in place by another that does."""
    return motion.drift_m > MOVED_M or motion.tilt_rad > TURNED_RAD


def _overlaps(scene: Folder, bodies: tuple[str, ...]) -> dict[Pair, float]:
    """(heavier, lighter) overlapping bodies -> depth [m], deepest first."""
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
    """The root body of a geom; a fixed body is its own root, although MuJoCo assigns it to the world."""
    return int(model.body_rootid[model.geom_bodyid[geom]])
