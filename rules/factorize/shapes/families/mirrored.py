"""Free-form bodies: the seen surface, mirrored at a vertical plane of symmetry.

The body is the largest mirror-symmetric solid behind the seen surface and inside the outline of the mask. Three
assumptions complete it. The plane of symmetry is upright, within some 60 degrees of facing the camera, and placed to
explain the view best at a depth similar to the width. Hidden space that may be occupied is occupied, down to the
surface under the object. Missing depth continues the nearest seen surface. A body without such a plane, or with one
along the line of sight, becomes too short or too bulky; a cavity is only as deep as its visible part, and its back is
wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from dextera_build.geometry import solids, transforms
from dextera_build.geometry.solids import Solid

from ..evidence import Evidence
from ..refine import Model
from ..scoring import judge
from .box import upright
from .front import Front, front_of

COST = 0.2
"""Complexity. The copied front always fits; with this cost the body wins only if every parametric family fits badly."""
YAWS_DEG = (0.0, -20.0, 20.0, -40.0, 40.0)
"""Yaws of the plane that are tried, relative to facing the camera [deg]."""
RATIOS = (0.4, 0.6, 0.9, 1.4, 2.1)
"""Ratios of depth to width that are tried."""
CLIMBED = 3
"""Number of the best of these from which a local search starts."""
CLIMBS = ((12.0, 1.25), (6.0, 1.12), (3.0, 1.06))
"""Steps of the local search: yaw [deg] and factor of the ratio."""
STEEPEST_DEG = 62.0
"""Maximum yaw of a plane."""
UNLIKELY = 0.04
"""Cost of a depth e times larger or smaller than the width, relative to an overlap of 1."""
SEARCHED_PX = 90
"""Mask size at which planes are compared [px]."""
SPECK_M = 1e-4
"""Size of the placeholder body if the plane leaves nothing [m]."""


def mirrored(evidence: Evidence) -> tuple[Front, Model] | None:
    """The front, and the model: direction of the plane's normal [rad] and its distance from the origin [m]; or None."""
    front = front_of(evidence)
    if front is None:
        return None
    start = _best_plane(front, _thinned(evidence))
    if start is None:
        return None
    room = np.array([0.25, 0.02])
    model = Model(
        name="mirrored",
        build=lambda p: _built(front, p),
        starts=[start],
        steps=np.array([0.05, 0.003]),
        lower=start - room,
        upper=start + room,
        expected=start,
        spread=np.array([0.2, 0.01]),
        cost=COST,
    )
    return front, model


def finished(front: Front, p: np.ndarray) -> tuple[Solid, np.ndarray]:
    """The body in its own frame, whose plane of symmetry is y = 0, and T_world_object (4, 4)."""
    body = front.body(p, fine=True) or _built(front, p)
    turned = upright(0.0, 0.0, float(p[0]) - np.pi / 2)
    own = body.vertices @ turned[:3, :3]
    middle = np.array([(own[:, 0].min() + own[:, 0].max()) / 2, p[1], own[:, 2].min()])
    return Solid(own - middle, body.faces), transforms.rigid(turned[:3, :3], turned[:3, :3] @ middle)


def _built(front: Front, p: np.ndarray) -> Solid:
    """The coarse body, or a speck that explains nothing if the plane leaves none."""
    return front.body(p) or solids.box((SPECK_M, SPECK_M, SPECK_M), (0.0, 0.0, SPECK_M / 2))


def _thinned(evidence: Evidence) -> Evidence:
    """The view subsampled to about `SEARCHED_PX` pixels along the mask's longer side."""
    step = max(1, round(float(np.ptp(np.argwhere(evidence.mask), axis=0).max()) / SEARCHED_PX))
    k = evidence.k / np.array([[step], [step], [1.0]])
    names = ("mask", "known", "depth", "sigma", "core")
    return replace(evidence, k=k, **{name: getattr(evidence, name)[::step, ::step] for name in names})


def _best_plane(front: Front, evidence: Evidence) -> np.ndarray | None:
    """The likeliest plane: best of a coarse grid with local search; None if no plane leaves a body."""
    marks: dict[tuple[float, float], float] = {}

    def mark(yaw_deg: float, ratio: float) -> float:
        place = round(yaw_deg, 3), round(ratio, 5)
        if place not in marks:
            body = front.body(_plane(evidence, *place)) if abs(place[0]) <= STEEPEST_DEG else None
            unlikely = UNLIKELY * float(np.log(ratio) ** 2)
            marks[place] = -np.inf if body is None else judge(body, evidence).score - unlikely
        return marks[place]

    grid = sorted(((yaw, ratio) for yaw in YAWS_DEG for ratio in RATIOS), key=lambda at: -mark(*at))
    found = [_climbed(mark, *at) for at in grid[:CLIMBED]]
    best = max(found, key=lambda at: mark(*at))
    return _plane(evidence, *best) if np.isfinite(mark(*best)) else None


def _climbed(mark: Callable[[float, float], float], yaw_deg: float, ratio: float) -> tuple[float, float]:
    """Yaw [deg] and ratio at a local optimum of the score."""
    here = yaw_deg, ratio
    for turn, factor in CLIMBS:
        while True:
            yaw, part = here
            near = [(yaw + turn, part), (yaw - turn, part), (yaw, part * factor), (yaw, part / factor)]
            near += [(yaw + turn, part * factor), (yaw - turn, part * factor)]
            near += [(yaw + turn, part / factor), (yaw - turn, part / factor)]
            best = max(near, key=lambda at: mark(*at))
            if not mark(*best) > mark(*here):
                break
            here = best
    return here


def _plane(evidence: Evidence, yaw_deg: float, ratio: float) -> np.ndarray:
    """Direction of the normal [rad] and distance from the origin [m] of a plane half the body's depth behind the front.

    Args:
        evidence: The view.
        yaw_deg: Turn of the plane from facing the camera.
        ratio: Depth over width of the body.
    """
    direction = float(np.arctan2(evidence.forward[1], evidence.forward[0]) + np.deg2rad(yaw_deg))
    normal = np.array([np.cos(direction), np.sin(direction)])
    across = evidence.points[:, :2] @ [-normal[1], normal[0]]
    width = float(np.ptp(np.quantile(across, [0.01, 0.99])))
    near = float(np.quantile(evidence.points[:, :2] @ normal, 0.02))
    return np.array([direction, near + ratio * width / 2])
