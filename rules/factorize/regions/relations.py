"""Features of surface patches and of their contacts (after Richtsfeld et al. 2012, Stein et al. 2014)."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from dextera_build.geometry import planes

from . import affinities
from .patches import NEIGHBOURS, SPAN, Surfaces, fold, step_limit

CONCAVE_RAD = 0.17
"""Concave creases sharper than this separate two objects [rad]."""
CAVITY_RAD = -0.06
"""Surfaces with a smaller signed bend are inner surfaces [rad]."""
BEND_REACH = 12
"""Distance over which the bend of a surface is measured [px]."""

RELIEF_M = 0.002
"""Distance of points of a flat surface from its plane that is no noise [m]."""
STEP_M = 0.1
"""Larger depth steps across a border carry no further information [m]."""
CONTRAST_LAB = 60.0
"""Larger differences of colour across a border carry no further information [CIE Lab]."""
LOST_LAB = 20.0
"""Largest difference from a group's colour at which pixels without depth are of it [CIE Lab]."""
SAME_COLOUR = 0.8
"""Histogram overlap above which two parts have the same colours."""
EDGE_LAB = 12.0
"""Difference of colour across a border that is no noise [CIE Lab]."""


@dataclass(frozen=True)
class Group:
    """Pixels grouped as one object."""

    pixels: np.ndarray  # (n,) flat indices into the crop
    area_m2: float  # of the seen surface, face on
    top_m: float  # 98 % quantile of the height
    bend: float  # mean signed angle over BEND_REACH, negative for cavities [rad]
    colour: np.ndarray  # (3,) median Lab
    plane: planes.Plane  # least-squares plane, world
    flatness_m: float  # rms about that plane
    middle: np.ndarray  # (3,) mean point, world


@dataclass
class Contact:
    """Contact of two groups along their common image border; stored as sums, so contacts can be added."""

    pairs: int = 0
    meeting: int = 0  # pairs without a depth step
    convex: int = 0  # meeting pairs that are not concave
    turn: float = 0.0  # sum of the signed angles of the meeting pairs [rad]
    step: float = 0.0  # sum of the pairs' depth steps, each at most STEP_M [m]
    contrast: float = 0.0  # sum of the pairs' differences of colour, each at most CONTRAST_LAB [CIE Lab]
    outlined: int = 0  # pairs with a depth step and a difference of colour
    said: np.ndarray = field(default_factory=affinities.nothing, compare=False)  # what `affinities.between` returns

    def add(self, other: Contact) -> None:
        """Add the pixel pairs of another contact."""
        self.pairs += other.pairs
        self.meeting += other.meeting
        self.convex += other.convex
        self.turn += other.turn
        self.step += other.step
        self.contrast += other.contrast
        self.outlined += other.outlined
        self.said = self.said + other.said

    @property
    def convexity(self) -> float:
        """Fraction of the pairs that meet without a step or concavity."""
        return self.convex / max(1, self.pairs)


def contacts(s: Surfaces, labels: np.ndarray) -> dict[tuple[int, int], Contact]:
    """Contact of each pair of labels (smaller, larger) that are at most two spans apart, or within a reach."""
    found: dict[tuple[int, int], Contact] = {}
    for down, right in NEIGHBOURS:
        rows, columns, dv, du = _pairs(s, labels, 2 * SPAN * down, 2 * SPAN * right)
        a, b = labels[rows, columns], labels[rows + dv, columns + du]
        rows, columns, a, b = (x[a != b] for x in (rows, columns, a, b))
        angle, step = fold(s, rows, columns, dv, du)
        meets = step < step_limit(s, rows, columns)
        colour = np.linalg.norm(s.lab[rows, columns] - s.lab[rows + dv, columns + du], axis=-1)
        edge = ~meets & (colour > EDGE_LAB)
        code = np.minimum(a, b).astype(np.int64) * 100000 + np.maximum(a, b)
        order = np.argsort(code, kind="stable")
        keys, starts = np.unique(code[order], return_index=True)
        for key, part in zip(keys.tolist(), np.split(order, starts)[1:], strict=True):
            gentle = meets[part] & (angle[part] > -CONCAVE_RAD)
            turn = float(angle[part][meets[part]].sum())
            contact = found.setdefault((key // 100000, key % 100000), Contact())
            apart = float(np.minimum(step[part], STEP_M).sum())
            contrast = float(np.minimum(colour[part], CONTRAST_LAB).sum())
            sums = int(meets[part].sum()), int(gentle.sum()), turn, apart, contrast, int(edge[part].sum())
            contact.add(Contact(len(part), *sums))
    for pair, said in s.said(labels).items():
        found.setdefault(pair, Contact()).said = said
    return found


def bends(s: Surfaces, labels: np.ndarray) -> np.ndarray:
    """Mean signed angle (count + 1,) between normals BEND_REACH px apart inside each label, excluding steps [rad]."""
    total, count = np.zeros(labels.max() + 1), np.zeros(labels.max() + 1)
    for down, right in ((0, BEND_REACH), (BEND_REACH, 0)):
        rows, columns, dv, du = _pairs(s, labels, down, right)
        same = labels[rows, columns] == labels[rows + dv, columns + du]
        rows, columns = rows[same], columns[same]
        angle, step = fold(s, rows, columns, dv, du)
        meets = step < 2.0 * step_limit(s, rows, columns)
        own = labels[rows, columns][meets]
        total += np.bincount(own, weights=angle[meets], minlength=len(total))
        count += np.bincount(own, minlength=len(count))
    return np.where(count > 0, total / np.maximum(count, 1), 0.0)


def describe(s: Surfaces, pixels: np.ndarray, bend: float) -> Group:
    """Features of the group with these flat pixel indices."""
    points = s.points.reshape(-1, 3)[pixels]
    normal, offset = planes.fit(points)
    return Group(
        pixels=pixels,
        area_m2=float(s.pixel_m2.ravel()[pixels].sum()),
        top_m=float(np.quantile(s.height.ravel()[pixels], 0.98)),
        bend=bend,
        colour=np.median(s.lab.reshape(-1, 3)[pixels], axis=0),
        plane=(normal, offset),
        flatness_m=float(np.sqrt(np.mean(np.square(points @ normal + offset)))),
        middle=points.mean(axis=0),
    )


def noise(s: Surfaces, pixels: np.ndarray) -> float:
    """Bound of a flat surface's distance from its plane at these pixels [m]: noise, and a little relief."""
    return RELIEF_M + float(planes.depth_sigma(1.0 / s.inverse.ravel()[pixels]).mean())


def is_cavity(s: Surfaces, group: Group) -> bool:
    """Whether a group is concave; in a flat group the bend is noise."""
    return group.bend < CAVITY_RAD and group.flatness_m > 0.6 * noise(s, group.pixels)


def one_plane(s: Surfaces, p: Group, q: Group) -> bool:
    """Whether two patches are coplanar within the noise and their centres less than 0.35 m apart."""
    limit = noise(s, p.pixels)
    if max(p.flatness_m, q.flatness_m) > 1.5 * limit or np.linalg.norm(p.middle - q.middle) > 0.35:
        return False
    # Fitting a common plane is more robust than comparing two: planes of small patches tilt with the noise.
    ends = [s.points.reshape(-1, 3)[g.pixels] for g in (p, q)]
    weights = np.concatenate([np.full(len(end), 1.0 / len(end)) for end in ends])
    normal, offset = planes.fit(np.concatenate(ends), weights)
    for end, patch in zip(ends, (p, q), strict=True):
        distance = end @ normal + offset
        turned = abs(float(patch.plane[0] @ normal)) < np.cos(np.radians(12))
        if turned or abs(float(distance.mean())) > limit or float(np.sqrt(np.mean(distance**2))) > 1.5 * limit:
            return False
    return True


def hidden_between(s: Surfaces, p: Group, q: Group, own: np.ndarray, samples: int = 24) -> bool:
    """Whether the pixels between two patches are nearer than their common plane, or not measured.

    Args:
        s: The crop.
        p: One patch.
        q: The other.
        own: (h, w) bool, pixels of both objects; these are ignored.
        samples: Number of sampled lines.
    """
    line = _between(p, q, own, samples)
    if not len(line):
        return False
    both = np.concatenate([p.pixels, q.pixels])
    design = np.column_stack([*np.divmod(both, own.shape[1]), np.ones(len(both))])
    plane = np.linalg.lstsq(design, s.inverse.ravel()[both], rcond=None)[0]
    expected = np.column_stack([line, np.ones(len(line))]) @ plane
    rows, columns = line.T
    nearer = s.raised[rows, columns] & (s.inverse[rows, columns] > expected)
    return bool(nearer.mean() > 0.6 and s.floor[rows, columns].mean() < 0.15)


def lost_between(s: Surfaces, p: Group, q: Group, own: np.ndarray, samples: int = 24) -> bool:
    """Whether most pixels between two groups have no depth and the colours of one of them; see `hidden_between`."""
    rows, columns = _between(p, q, own, samples).T
    if not len(rows):
        return False
    lost = (s.inverse[rows, columns] == 0) & ~s.floor[rows, columns] & (s.beyond[rows, columns] == 0)
    lab = s.lab[rows, columns]
    alike = np.minimum(*(np.linalg.norm(lab - group.colour, axis=1) for group in (p, q))) < LOST_LAB
    return bool((lost & alike).mean() > 0.6)


def _between(p: Group, q: Group, own: np.ndarray, samples: int) -> np.ndarray:
    """Pixels (n, 2) of lines from one group to the other, without those of `own`."""
    start, end = (np.stack(np.divmod(g.pixels, own.shape[1]), axis=1) for g in (p, q))
    pick = np.linspace(0.1, 0.9, samples)
    start, end = start[(pick * len(start)).astype(int)], end[(pick[::-1] * len(end)).astype(int)]
    fractions = np.linspace(0.0, 1.0, 60)[None, :, None]
    line = np.round(start[:, None] * (1 - fractions) + end[:, None] * fractions).astype(int).reshape(-1, 2)
    return np.asarray(line[~own[line[:, 0], line[:, 1]]])


def likeness(s: Surfaces, p: Group, q: Group) -> float:
    """Intersection, 0..1, of the colour histograms of two groups."""
    return float(np.minimum(colours(s, p), colours(s, q)).sum())


def colours(s: Surfaces, group: Group) -> np.ndarray:
    """Smoothed histogram (5, 8, 8) of a group's CIE Lab, of sum 1."""
    return histogram(s.lab.reshape(-1, 3)[group.pixels])


def histogram(lab: np.ndarray) -> np.ndarray:
    """Smoothed histogram (5, 8, 8), of sum 1, of colours (N, 3) CIE Lab."""
    from scipy import ndimage

    bins = np.clip((lab - [0.0, -60.0, -60.0]) / [20.0, 15.0, 15.0], 0, [4, 7, 7]).astype(int)
    counts = np.bincount(np.ravel_multi_index(tuple(bins.T), (5, 8, 8)), minlength=320).reshape(5, 8, 8)
    smooth = ndimage.gaussian_filter(counts.astype(np.float64), 0.7)
    return np.asarray(smooth / smooth.sum())


def gap(s: Surfaces, small: Group, large: Group) -> float:
    """Distance (5 % quantile) of the smaller group's points to the nearest points of the larger one [m]."""
    from scipy.spatial import cKDTree

    points = s.points.reshape(-1, 3)
    near = cKDTree(points[large.pixels[::3]]).query(points[small.pixels[::3]])[0]
    return float(np.quantile(near, 0.05))


def facets(s: Surfaces, group: Group, most: int = 3, smallest: float = 0.05) -> tuple[tuple[np.ndarray, float], ...]:
    """Dominant surface normals of a group, (3,) world, each with the fraction of pixels within 15 degrees."""
    normal = s.normal.reshape(-1, 3)[group.pixels]
    left = normal[np.linalg.norm(normal, axis=1) > 0]
    count = max(1, len(left))
    found: list[tuple[np.ndarray, float]] = []
    while len(found) < most and len(left) > smallest * count:
        tried = left[np.linspace(0, len(left) - 1, 150).astype(int)]
        near = left @ tried.T > np.cos(np.radians(15))
        best = near[:, int(np.argmax(near.sum(axis=0)))]
        if best.sum() < smallest * count:
            break
        direction = left[best].mean(axis=0)
        found.append((direction / np.linalg.norm(direction), float(best.sum() / count)))
        left = left[left @ found[-1][0] < np.cos(np.radians(25))]
    return tuple(found)


def inward(s: Surfaces, group: Group) -> float:
    """Fraction of a group's pixels whose surface faces the vertical line through the group's centre."""
    points, normal = s.points.reshape(-1, 3)[group.pixels], s.normal.reshape(-1, 3)[group.pixels]
    low, high = np.quantile(points[:, :2], (0.02, 0.98), axis=0)
    from_middle = points[:, :2] - (low + high) / 2
    distance = np.linalg.norm(from_middle, axis=1)
    wall = (np.abs(normal[:, 2]) < 0.85) & (np.linalg.norm(normal, axis=1) > 0)
    wall &= distance > 0.2 * float(np.min(high - low))
    faces = (normal[:, :2] * from_middle).sum(axis=1) < -0.4 * distance
    return float((wall & faces).mean())


def hinged(s: Surfaces, base: Group, lid: Group) -> bool:
    """Whether two flat groups are base and open lid of one object: equally wide along a crease at their edge.

    A box standing on a book fails: the book continues behind the crease, or is wider than the box.
    """
    if min(base.area_m2, lid.area_m2) < 0.008 or max(base.flatness_m, lid.flatness_m) > 0.012:
        return False
    tilt = abs(float(lid.plane[0][2]))
    if abs(float(base.plane[0][2])) < 0.95 or tilt > np.cos(np.radians(20)) or base.top_m > 0.06:
        return False
    points = [s.points.reshape(-1, 3)[g.pixels] for g in (base, lid)]
    crease = np.cross(base.plane[0], lid.plane[0])
    crease /= np.linalg.norm(crease)
    ends = [np.quantile(p @ crease, (0.01, 0.99)) for p in points]
    shared = min(ends[0][1], ends[1][1]) - max(ends[0][0], ends[1][0])
    if shared < 0.8 * (max(ends[0][1], ends[1][1]) - min(ends[0][0], ends[1][0])):
        return False
    outwards = np.cross(crease, [0.0, 0.0, 1.0])
    foot = points[1][points[1][:, 2] < np.quantile(points[1][:, 2], 0.1)]
    side = (points[0] - foot.mean(axis=0)) @ outwards
    return bool(max((side > -0.02).mean(), (side < 0.02).mean()) > 0.95)


def _pairs(s: Surfaces, labels: np.ndarray, down: int, right: int) -> tuple[np.ndarray, np.ndarray, int, int]:
    """Labelled pixels with a normal whose (down, right) neighbour also has both: rows, columns, down, right."""
    known = (labels > 0) & (np.linalg.norm(s.normal, axis=-1) > 0)
    height, width = labels.shape
    here = known[: height - down, max(0, -right) : width - max(0, right)]
    there = known[down:, max(0, right) : width - max(0, -right)]
    rows, columns = np.nonzero(here & there)
    return rows, columns + max(0, -right), down, right
