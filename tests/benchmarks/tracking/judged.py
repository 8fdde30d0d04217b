"""Tracked poses of a sequence beside the true ones, frame by frame."""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from dextera_build.artifacts.cameras.mask_track import MaskTrack
from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.geometry import lie, metrics, transforms
from dextera_build.tracking.model import Model, State
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker
from tests.benchmarks.tracking.open3d_icp import Icp
from tests.benchmarks.tracking.scene import CAMERA, Actor, Sequence

VISIBLE, HALF = 0.75, 0.3
"""Seen part of an object from which it counts as visible, and from which as half hidden."""
SAMPLES = 400


@dataclass(frozen=True)
class Row:
    """One object in one frame."""

    sequence: str
    name: str
    time: float
    status: str
    seen: float  # part of it that the picture shows
    add: float  # mean distance of its points to the same true ones [m], inf without a pose
    adds: float  # to the nearest true ones [m]
    deviation: np.ndarray  # (6,) twist from the true pose, NaN without a pose
    sigma: np.ndarray  # (6, 6) that was stated
    icp_adds: float  # of Open3D's ICP, which always gives a pose [m]
    joint: float  # error of its joint [rad], NaN without one


@dataclass(frozen=True)
class Times:
    """Processor time per frame [s]."""

    tracker: float
    icp: float


def judge(
    sequence: Sequence,
    frames: Iterable[tuple[RgbdFrame, np.ndarray]],
    icp: bool,
    masks: MaskTrack | None = None,
) -> tuple[list[Row], Times]:
    """Track a sequence from its true first poses, with masks of its actors if there are any."""
    order = {name: number for number, name in enumerate(sequence.actors, 1)}
    actors = {name: actor for name, actor in sequence.actors.items() if actor.tracked}
    models = {name: actor.model() for name, actor in actors.items()}
    points = {name: _points(actor) for name, actor in actors.items()}
    tracker, rivals = Tracker(models, CAMERA.matrix()), {}
    rows: list[Row] = []
    spent, spent_icp, count = 0.0, 0.0, 0
    followed = itertools.repeat(None) if masks is None else masks.every()
    for (frame, labels), shown in zip(frames, followed, strict=False):
        camera = transforms.invert(sequence.camera(frame.stamp))
        truth = {name: State(camera @ a.path(frame.stamp), a.positions(frame.stamp)) for name, a in actors.items()}
        if not count:
            tracker.start(
                {name: each.pose for name, each in truth.items()}, {n: each.joints for n, each in truth.items()}
            )
            rivals = {name: _rival(actors[name], each.pose) for name, each in truth.items()} if icp else {}
        begin = time.process_time()
        given = None if shown is None else {name: shown == order[name] for name in actors}
        found = tracker.step(frame.rgb, frame.depth, frame.stamp, masks=given)
        middle = time.process_time()
        rival = {name: each.step(frame.depth) for name, each in rivals.items()}
        spent, spent_icp, count = spent + middle - begin, spent_icp + time.process_time() - middle, count + 1
        for name in actors:
            seen = _seen(models[name], truth[name], labels == order[name])
            made = _compared(points[name], found[name].pose, truth[name].pose)
            theirs = _compared(points[name], rival.get(name), truth[name].pose)[1]
            rows.append(_row(sequence.name, name, frame.stamp, found[name], truth[name], (seen, *made, theirs)))
    return rows, Times(spent / count, spent_icp / count)


def _row(
    sequence: str, name: str, stamp: float, found: Tracked, truth: State, numbers: tuple[float, float, float, float]
) -> Row:

    seen, add, adds, theirs = numbers
    there = found.pose is not None and found.covariance is not None
    deviation = lie.between(truth.pose, found.pose) if found.pose is not None else np.full(6, np.nan)
    joint = float(np.abs(found.joints - truth.joints).max()) if len(truth.joints) else np.nan
    sigma = found.covariance if there and found.covariance is not None else np.full((6, 6), np.nan)
    return Row(sequence, name, stamp, found.status, seen, add, adds, deviation, sigma, theirs, joint)


def _rival(actor: Actor, start: np.ndarray) -> Icp:
    mesh = next(iter(actor.links.values()))
    return Icp(mesh.vertices, mesh.faces, start, CAMERA.matrix())


def _points(actor: Actor) -> tuple[np.ndarray, np.ndarray]:
    """Points of its first link, and dense ones to which distances are measured."""
    mesh = next(iter(actor.links.values()))
    vertices = mesh.vertices.astype(np.float64)
    return (
        metrics.sample_surface(vertices, mesh.faces, SAMPLES, seed=0),
        metrics.sample_surface(vertices, mesh.faces, 20 * SAMPLES, seed=1),
    )


def _compared(points: tuple[np.ndarray, np.ndarray], pose: np.ndarray | None, truth: np.ndarray) -> tuple[float, float]:
    """ADD (Hinterstoisser et al. 2012) and ADD-S (Hodan et al. 2016) [m]; inf without a pose."""
    if pose is None:
        return np.inf, np.inf
    made, same = transforms.apply(pose, points[0]), transforms.apply(truth, points[0])
    near = metrics.nearest(made, transforms.apply(truth, points[1]))
    return float(np.linalg.norm(made - same, axis=1).mean()), float(near.mean())


def _seen(model: Model, truth: State, shown: np.ndarray) -> float:
    """Part of the object that the picture shows; what is outside the picture is hidden."""
    wide = np.array([[CAMERA.fx, 0, CAMERA.cx + 1000], [0, CAMERA.fy, CAMERA.cy + 1000], [0, 0, 1]])
    cast = model.cast(truth, wide, (2480, 2640), 1500)
    if cast is None:
        return 0.0
    rows, columns = np.nonzero(cast.drawn)
    rows, columns = cast.rows[rows] - 1000, cast.columns[columns] - 1000
    inside = (rows >= 0) & (rows < shown.shape[0]) & (columns >= 0) & (columns < shown.shape[1])
    return float(shown[rows[inside], columns[inside]].sum() / max(len(rows), 1))
