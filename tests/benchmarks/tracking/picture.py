"""The picture of docs/tracking.md: `python -m tests.benchmarks.tracking.picture FILE`.

A printed carton is carried past a box with a lid, a hand reaches in, and the camera moves; all shapes are our own.
Outlines are green where a pose is tracked and orange where it is predicted.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from PIL import Image as Pillow

from dextera_build.geometry import metrics, transforms
from dextera_build.tracking.model import Model, State
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker
from tests.benchmarks.tracking import things
from tests.benchmarks.tracking.scene import CAMERA, Actor, Sequence, before, frames, standing

SHOWN = (0, 14, 24, 34, 44)
COLOURS = {"tracked": (40, 220, 80), "predicted": (255, 160, 30)}


def _carried(time: float) -> np.ndarray:
    pose = standing(-0.22 + 0.10 * time, -0.05, 20 + 25 * time)
    pose[2, 3] = 0.06 * min(time, 1.0)
    return pose


def _reaching(time: float) -> np.ndarray:
    place = np.array([0.16 - 0.02 * time, 0.0, 0.17 + 0.25 * abs(time - 2.4)])
    return transforms.rigid(np.eye(3), place) @ things.turned((1, 0, 0), 35.0)


def sequence() -> Sequence:
    """What is shown."""
    links, joints = things.chest()
    opening = np.radians(75)
    actors = {
        "carton": Actor({"base": things.carton((0.08, 0.05, 0.13), 3)}, _carried),
        "chest": Actor(
            links, lambda time: standing(0.13, 0.02, -15), joints, lambda time: np.array([opening * min(time / 2, 1.0)])
        ),
        "hand": Actor({"base": things.hand()}, _reaching, tracked=False),
    }
    return Sequence("picture", actors, lambda time: before(0.72, 38, 9 * time - 10), 3.0, 15.0)


def main(target: Path) -> None:
    """Track and draw."""
    made = sequence()
    models = {name: actor.model() for name, actor in made.actors.items() if actor.tracked}
    tracker, drawn = Tracker(models, CAMERA.matrix()), []
    camera = transforms.invert(made.camera(0.0))
    tracker.start({name: camera @ made.actors[name].path(0.0) for name in models})
    for number, (frame, _) in enumerate(frames(made)):
        found = tracker.step(frame.rgb, frame.depth, frame.stamp)
        if number in SHOWN:
            pixels = frame.rgb.copy()
            for name, each in found.items():
                _outline(pixels, models[name], each)
            drawn.append(pixels[40:440:2, 70:590:2])
    target.parent.mkdir(parents=True, exist_ok=True)
    Pillow.fromarray(np.hstack(drawn)).save(target, quality=85)


def _outline(pixels: np.ndarray, model: Model, found: Tracked) -> None:
    if found.pose is None:
        return
    cast = model.cast(State(found.pose, found.joints), CAMERA.matrix(), pixels.shape, rays=10**6)
    if cast is None:
        return
    label = np.full(pixels.shape[:2], -1)
    label[np.ix_(cast.rows, cast.columns)] = cast.link
    for link in range(len(model.links)):
        edge = metrics.boundary(label == link)
        pixels[edge | np.roll(edge, 1, axis=0) | np.roll(edge, 1, axis=1)] = COLOURS[found.status]


if __name__ == "__main__":
    main(Path(sys.argv[1]))
