"""A source that delivers in real time: the newest frame is taken, older ones are dropped, ends and errors arrive."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from dextera_build.artifacts.cameras.rgbd_video import RgbdFrame
from dextera_build.geometry import transforms
from dextera_build.tracking import live
from dextera_build.tracking.tracked_object import Tracked
from dextera_build.tracking.tracker import Tracker
from tests.benchmarks.tracking import things
from tests.benchmarks.tracking.scene import CAMERA, Actor, Sequence, before, frames, standing

RATE = 50.0
BLANK = RgbdFrame(0.0, np.zeros((48, 64, 3), np.uint8), np.zeros((48, 64), np.float32))


class Slow(Tracker):
    """Takes three periods of the camera for a frame."""

    def __init__(self) -> None:
        super().__init__({}, np.eye(3))
        self.moves: list[np.ndarray | None] = []

    def step(self, rgb, depth, stamp, *, masks=None, moved=None, budget_s=None) -> dict[str, Tracked]:
        self.moves.append(moved)
        time.sleep(3 / RATE)
        return {}


def camera(shots: Iterator[RgbdFrame] | None = None, count: int = 30) -> Iterator[RgbdFrame]:
    """Frames at `RATE`, by the clock."""
    begin = time.monotonic()
    for number, shot in enumerate(itertools.islice(shots or itertools.repeat(BLANK), count)):
        time.sleep(max(0.0, begin + number / RATE - time.monotonic()))
        yield replace(shot, stamp=number / RATE)


def test_a_slow_tracker_sees_the_newest_frame_and_not_a_queue():
    seen = list(live.follow(Slow(), camera()))
    stamps = [each.stamp for each in seen]
    assert stamps == sorted(set(stamps))
    assert stamps[-1] == 29 / RATE  # the last frame is never dropped
    assert 5 <= len(seen) <= 16
    assert len(seen) + sum(each.dropped for each in seen) == 30
    # A queue of 30 frames would end 20 x 3 periods late.
    assert np.median([each.delay_s for each in seen]) < 8 / RATE


def test_the_motion_of_the_camera_is_that_between_the_frames_that_were_taken():
    """Frames are dropped between them, so the step of the source is not that of the tracker."""

    def moving() -> Iterator[RgbdFrame]:
        for number in itertools.count():
            yield replace(BLANK, pose=transforms.rigid(np.eye(3), np.array([0.01 * number, 0, 0])))

    tracker = Slow()
    seen = list(live.follow(tracker, camera(moving())))
    ways = np.diff([each.stamp for each in seen]) * RATE * 0.01
    assert [-each[0, 3] for each in tracker.moves[1:]] == pytest.approx(ways)
    assert tracker.moves[0] == pytest.approx(np.eye(4))


def test_an_error_of_the_camera_arrives_after_the_frames_before_it():
    def failing() -> Iterator[RgbdFrame]:
        yield BLANK
        raise OSError("the camera was unplugged")

    found = live.follow(Slow(), failing())
    assert next(found).stamp == 0.0
    with pytest.raises(OSError, match="unplugged"):
        next(found)


def test_leaving_the_loop_stops_the_reading():
    stopped = threading.Event()

    def endless() -> Iterator[RgbdFrame]:
        try:
            yield from camera(count=10**6)
        finally:
            stopped.set()

    for _ in live.follow(Slow(), endless()):
        break
    assert stopped.wait(5.0)


@pytest.mark.slow
def test_a_sliding_box_is_followed_in_real_time():
    """Ten frames a second of a real tracker; the delay is that of its work."""
    box = things.carton((0.10, 0.07, 0.14), 3)

    def path(at: float) -> np.ndarray:
        return standing(-0.06 + 0.1 * at, 0.0, 20)

    made = Sequence("live", {"box": Actor({"base": box}, path)}, lambda at: before(), 0.8, 10.0)
    film = [frame for frame, _ in frames(made)]

    def delivered() -> Iterator[RgbdFrame]:
        begin = time.monotonic()
        for frame in film:
            time.sleep(max(0.0, begin + frame.stamp - time.monotonic()))
            yield frame

    tracker = Tracker({"box": made.actors["box"].model()}, CAMERA.matrix())
    tracker.start({"box": transforms.invert(before()) @ path(0.0)})
    seen = list(live.follow(tracker, delivered(), budget_s=0.05))
    assert len(seen) + sum(each.dropped for each in seen) == len(film)
    for each in seen:
        pose = each.found["box"].pose
        assert pose is not None
        truth = transforms.invert(before()) @ path(each.stamp)
        assert np.linalg.norm(pose[:3, 3] - truth[:3, 3]) < 0.005
