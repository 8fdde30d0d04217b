"""A camera in a thread of its own: it shows the state that was asked for, and holds nobody up."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.deploying.apart import Apart
from dextera_build.policy.observation import Frame, Frames
from dextera_build.sim.runtime.environment import Environment
from tests import task_bundles

WAIT_S = 10.0


class Slow:
    """A camera whose frames wait to be let through; a picture is the position of the first joint."""

    def __init__(self) -> None:
        self.lets, self.made = threading.Semaphore(1), 0

    @contextmanager
    def opens(self, environment: Environment) -> Iterator[Callable[[], Frames]]:
        def look() -> Frames:
            assert self.lets.acquire(timeout=WAIT_S)
            self.made += 1
            return {"workspace": Frame(np.array(environment.measure().joints[:1]))}

        yield look


def begun() -> Environment:
    made = Environment(task_bundles.lift())
    made.begin(made.draw(0))
    return made


def test_a_frame_shows_the_state_of_its_time_and_those_meanwhile_are_left_out() -> None:
    world, camera = begun(), Slow()
    shown: list[float] = []
    seen = threading.Semaphore(0)

    def show(frames: Frames) -> None:
        shown.append(float(np.asarray(frames["workspace"].rgb)[0]))
        seen.release()

    joint = world.bundle.robot.joints[0].name
    place = world.data.joint(f"robot/{joint}")
    with Apart(world, camera.opens) as apart:
        for position in (0.01, 0.02, 0.03):  # the second and third come while the first is made
            place.qpos[0] = position
            apart.ask(show)
        camera.lets.release()
        assert seen.acquire(timeout=WAIT_S)
        for _ in range(100):  # the thread may not have finished with the frame that it has shown
            place.qpos[0] = 0.04
            apart.ask(show)
            camera.lets.release()
            if seen.acquire(timeout=0.1):
                break
    assert shown == pytest.approx([0.01, 0.04])


def test_a_camera_that_fails_is_told_to_who_asks() -> None:
    @contextmanager
    def opens(environment: Environment) -> Iterator[Callable[[], Frames]]:
        raise RuntimeError("no context")
        yield

    with pytest.raises(RuntimeError, match="no context"), Apart(begun(), opens):
        pass
