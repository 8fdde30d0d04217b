"""Which patches belong to one object: rules on how their surfaces meet (after Richtsfeld et al. 2012, Stein et al. 2014).

Objects are mostly convex as seen from outside. Patches join where they meet convexly or smoothly and stay apart at
concave creases and depth steps, with four exceptions: slivers, cavities, thin attached parts, and one surface that
shows on both sides of an occluder.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dextera_build.geometry import planes

from .patches import NEIGHBOURS, SPAN, Surfaces, fold, step_limit

CONCAVE_RAD = 0.17
"""A crease that turns inwards more than this separates two objects [rad]."""
SLIVER_M2 = 0.0006
"""Patches below this size are what creases and noise leave over [m^2]."""
PART_M2 = 0.0025
"""Attached parts, such as handles, are smaller than this [m^2]."""


@dataclass
class Group:
    """Patches that are taken for one object, in a crop."""

    mask: np.ndarray  # (h, w) bool
    area_m2: float  # of the seen surface
    top_m: float  # height that 2 % of its pixels exceed
    bend: float  # mean signed angle over a fixed image distance, negative for cavities [rad]
    colour: np.ndarray  # (3,) median Lab
    plane: tuple[np.ndarray, float]  # least-squares plane, world
    flatness_m: float  # rms about that plane


@dataclass
class Contact:
    """How two patches meet along their common border in the image; sums, so that contacts of groups add up."""

    pairs: int = 0
    meeting: int = 0  # pairs without a depth step
    convex: int = 0  # meeting pairs that do not turn inwards
    turn: float = 0.0  # sum of the signed angles of the meeting pairs [rad]

    def add(self, other: Contact) -> None:
        """Take the pixel pairs of another contact in."""
        self.pairs += other.pairs
        self.meeting += other.meeting
        self.convex += other.convex
        self.turn += other.turn

    @property
    def convexity(self) -> float:
        """Part of the pairs that meet without a step and without turning inwards."""
        return self.convex / max(1, self.pairs)


def contacts(s: Surfaces, labels: np.ndarray) -> dict[tuple[int, int], Contact]:
    """Contact of each pair of labels (smaller, larger) whose pixels face one another across at most two spans."""
    found: dict[tuple[int, int], Contact] = {}
    known = np.linalg.norm(s.normal, axis=-1) > 0
    height, width = labels.shape
    for down, right in NEIGHBOURS:
        dv, du = 2 * SPAN * down, 2 * SPAN * right
        rows, columns = np.mgrid[0 : height - dv, max(0, -du) : width - max(0, du)].reshape(2, -1)
        a, b = labels[rows, columns], labels[rows + dv, columns + du]
        pair = (a > 0) & (b > 0) & (a != b) & known[rows, columns] & known[rows + dv, columns + du]
        rows, columns, a, b = rows[pair], columns[pair], a[pair], b[pair]
        angle, step = fold(s, rows, columns, dv, du)
        meets = step < step_limit(s, rows, columns)
        code = np.minimum(a, b).astype(np.int64) * 100000 + np.maximum(a, b)
        order = np.argsort(code, kind="stable")
        keys, starts = np.unique(code[order], return_index=True)
        for key, part in zip(keys.tolist(), np.split(order, starts[1:]), strict=True):
            contact = found.setdefault((key // 100000, key % 100000), Contact())
            gentle = meets[part] & (angle[part] > -CONCAVE_RAD)
            turn = float(angle[part][meets[part]].sum())
            contact.add(Contact(len(part), int(meets[part].sum()), int(gentle.sum()), turn))
    return found


def describe(s: Surfaces, mask: np.ndarray) -> Group:
    """Measures of one group."""
    points = s.points[mask]
    middle = points.mean(axis=0)
    values, vectors = np.linalg.eigh((points - middle).T @ (points - middle) / len(points))
    plane = (vectors[:, 0], -float(vectors[:, 0] @ middle))
    return Group(
        mask=mask,
        area_m2=float(s.pixel_m2[mask].sum()),
        top_m=float(np.quantile(s.height[mask], 0.98)),
        bend=_bend(s, mask),
        colour=np.median(s.lab[mask], axis=0),
        plane=plane,
        flatness_m=float(np.sqrt(max(values[0], 0.0))),
    )


def _bend(s: Surfaces, mask: np.ndarray, reach: int = 12) -> float:
    """Mean signed angle between normals `reach` px apart inside a mask, steps left out [rad]."""
    known = mask & (np.linalg.norm(s.normal, axis=-1) > 0)
    total, count = 0.0, 0
    for down, right in ((0, reach), (reach, 0)):
        rows, columns = np.nonzero(known[: known.shape[0] - down, : known.shape[1] - right])
        both = known[rows + down, columns + right]
        angle, step = fold(s, rows[both], columns[both], down, right)
        meets = step < 2.0 * step_limit(s, rows[both], columns[both])
        total, count = total + float(angle[meets].sum()), count + int(meets.sum())
    return total / count if count else 0.0


def one_plane(s: Surfaces, p: Group, q: Group) -> bool:
    """Whether two patches lie on one plane within the noise, their middles less than 0.35 m apart."""
    noise = 0.003 + 0.0015 * float(np.square(1.0 / np.maximum(s.inverse[p.mask | q.mask], 1e-3)).mean())
    if max(p.flatness_m, q.flatness_m) > 1.5 * noise:
        return False
    ends = s.points[p.mask], s.points[q.mask]
    if np.linalg.norm(ends[0].mean(axis=0) - ends[1].mean(axis=0)) > 0.35:
        return False
    # A common plane is surer than two planes compared: those of small patches tilt with the noise.
    weights = np.concatenate([np.full(len(end), 1.0 / len(end)) for end in ends])
    normal, offset = planes.fit(np.concatenate(ends), weights)
    for end, patch in zip(ends, (p, q), strict=True):
        distance = end @ normal + offset
        turned = abs(float(patch.plane[0] @ normal)) < np.cos(np.radians(12))
        if turned or abs(float(distance.mean())) > noise or float(np.sqrt(np.mean(distance**2))) > 1.5 * noise:
            return False
    return True


def hidden_between(s: Surfaces, p: Group, q: Group, own: np.ndarray, samples: int = 24) -> bool:
    """Whether what lies between two patches in the image is nearer than their common plane, or was not measured.

    Args:
        s: The crop.
        p: One patch.
        q: The other.
        own: (h, w) bool, pixels of both objects; they do not count.
        samples: Lines that are looked along.
    """
    start, end = np.argwhere(p.mask), np.argwhere(q.mask)
    pick = np.linspace(0.1, 0.9, samples)
    start, end = start[(pick * len(start)).astype(int)], end[(pick[::-1] * len(end)).astype(int)]
    fractions = np.linspace(0.0, 1.0, 60)[None, :, None]
    line = np.round(start[:, None] * (1 - fractions) + end[:, None] * fractions).astype(int).reshape(-1, 2)
    rows, columns = line[:, 0], line[:, 1]
    between = ~own[rows, columns]
    if not between.any():
        return False
    rows, columns = rows[between], columns[between]
    mask = p.mask | q.mask
    points, inverse = np.argwhere(mask), s.inverse[mask]
    design = np.column_stack([points, np.ones(len(points))])
    plane = np.linalg.lstsq(design, inverse, rcond=None)[0]
    expected = np.column_stack([rows, columns, np.ones(len(rows))]) @ plane
    measured = s.inverse[rows, columns]
    nearer = s.raised[rows, columns] & (measured > expected)
    return bool(nearer.mean() > 0.6 and s.visible_floor[rows, columns].mean() < 0.15)


def gap(s: Surfaces, small: np.ndarray, large: np.ndarray) -> float:
    """Distance (5 % quantile) of a small mask's points to the nearest points of a large one [m]."""
    from scipy.spatial import cKDTree

    near = cKDTree(s.points[large][::3]).query(s.points[small][::3])[0]
    return float(np.quantile(near, 0.05))


def hinged(s: Surfaces, base: Group, lid: Group) -> bool:
    """Whether two flat groups are the base and the open lid of one thing: equally wide along a crease at their edge.

    A box that stands on a book fails: the book goes on behind the crease, or is wider than the box.
    """
    if min(base.area_m2, lid.area_m2) < 0.008 or max(base.flatness_m, lid.flatness_m) > 0.008:
        return False
    tilt = abs(float(lid.plane[0][2]))
    if abs(float(base.plane[0][2])) < 0.95 or tilt > np.cos(np.radians(20)) or base.top_m > 0.06:
        return False
    crease = np.cross(base.plane[0], lid.plane[0])
    crease /= np.linalg.norm(crease)
    ends = [np.quantile(s.points[g.mask] @ crease, (0.01, 0.99)) for g in (base, lid)]
    shared = min(ends[0][1], ends[1][1]) - max(ends[0][0], ends[1][0])
    if shared < 0.8 * (max(ends[0][1], ends[1][1]) - min(ends[0][0], ends[1][0])):
        return False
    outwards = np.cross(crease, [0.0, 0.0, 1.0])
    points = s.points[base.mask]
    foot = s.points[lid.mask][s.height[lid.mask] < np.quantile(s.height[lid.mask], 0.1)]
    side = (points - foot.mean(axis=0)) @ outwards
    return bool(max((side > -0.02).mean(), (side < 0.02).mean()) > 0.95)
