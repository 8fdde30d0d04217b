"""Pictures of one episode are alike in a film, before a policy and in Gymnasium, with all that was drawn for it."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.artifacts.tasks.episode import Episode, Episodes
from dextera_build.artifacts.tasks.task import Reset, TaskBundle, View
from dextera_build.policy.cameras import PICTURE
from dextera_build.policy.layout import embodiment
from dextera_build.sim.observe import pictures
from dextera_build.sim.runtime.environment import Environment
from dextera_build.sim.runtime.rollout import closed_loop
from dextera_build.sim.training.gym import TaskEnv
from tests import episodes, factories, gate

SEED = 5


def task(visual: float) -> TaskBundle:
    """The gate, with this much of the visual ranges, over within three steps."""
    bundle = gate.bundle()
    spec = bundle.task.model_copy(update={"reset": Reset(dynamics=0.0, visual=visual), "timeout_s": 0.15})
    return bundle.model_copy(update={"task": spec})


def view() -> View:
    """A camera whose pose is known to 10 mm and 0.6 deg."""
    plain = gate.view()
    pose = factories.placed(plain.camera_pose.matrix, "camera")
    return plain.model_copy(update={"camera_pose": pose.model_copy(update={"covariance": np.eye(6) * 1e-4})})


class Watching:
    """A policy that says one target and keeps what it sees."""

    def __init__(self) -> None:
        self.seen: list[np.ndarray] = []

    def reset(self) -> None:
        """Nothing is remembered."""

    def act(self, observation):
        self.seen.append(observation.frames[PICTURE].rgb)
        return np.array([gate.PUSHES])


def watched(bundle: TaskBundle) -> tuple[np.ndarray, Episode]:
    """Pictures (T, H, W, 3) before a policy in a rollout, and the episode that was recorded."""
    environment, policy = Environment(bundle), Watching()
    with pictures.live(environment, {PICTURE: view()}) as look:
        made = closed_loop(environment, policy, environment.draw(SEED), look)
    return np.stack(policy.seen), made


def filmed(bundle: TaskBundle, episode: Episode) -> np.ndarray:
    """Pictures (T, H, W, 3) of a recorded episode."""
    known = episodes.small(1, 3).model_copy(
        update={
            "items": {"0": episode},
            "embodiment": embodiment(bundle.robot),
            "joint_names": tuple(joint.name for joint in bundle.robot.joints),
            "object_names": tuple(bundle.objects),
            "displacement_names": bundle.displacement_names,
        }
    )
    assert isinstance(known, Episodes)
    ((_, frames),) = pictures.film(bundle, known, view(), ("rgb", "depth"))
    assert frames.depth is not None
    assert frames.depth.shape == frames.rgb.shape[:3]
    return frames.rgb


def largest_difference(one: np.ndarray, other: np.ndarray) -> int:
    return int(np.abs(one.astype(int) - other).max())


@pytest.mark.parametrize("visual", [0.0, 1.0])
def test_film_rollout_and_gymnasium_see_the_same(visual):
    bundle = task(visual)
    seen, episode = watched(bundle)
    assert len(seen) == 3
    assert largest_difference(filmed(bundle, episode), seen) <= 2  # recorded poses are single precision
    environment = TaskEnv(bundle, views={PICTURE: view()})
    first, _ = environment.reset(options={"start": episode.start})
    environment.close()
    assert first[f"deployable/rgb/{PICTURE}"].tobytes() == seen[0].tobytes()


def test_a_film_shows_the_robot_on_the_base_that_its_start_has():
    bundle = task(0.0)
    environment, policy = Environment(bundle), Watching()
    start = environment.draw(SEED).model_copy(update={"base_error": (0.02, 0.01, 0.03, 0.0, 0.0, 0.2)})
    with pictures.live(environment, {PICTURE: view()}) as look:
        episode = closed_loop(environment, policy, start, look)
    seen = np.stack(policy.seen)
    assert largest_difference(filmed(bundle, episode), seen) <= 2
    still = episode.model_copy(update={"start": start.model_copy(update={"base_error": (0.0,) * 6})})
    assert largest_difference(filmed(bundle, still), seen) > 50


def test_visual_ranges_move_the_camera_and_change_the_light():
    plain, _ = watched(task(0.0))
    varied, episode = watched(task(1.0))
    assert largest_difference(plain, varied) > 20
    still = filmed(task(0.0), episode.model_copy(update={"start": episode.start.model_copy(update={"seed": SEED + 1})}))
    other = filmed(task(1.0), episode.model_copy(update={"start": episode.start.model_copy(update={"seed": SEED + 1})}))
    assert largest_difference(still, other) > 20


def test_cameras_of_the_world_that_replaces_hardware_stay_where_they_are():
    bundle = task(1.0).model_copy(update={"kind": "reference"})
    environment = Environment(bundle)
    start = environment.draw(SEED)
    plain = start.model_copy(update={"seed": SEED + 1})
    with pictures.live(environment, {PICTURE: view()}) as look:
        environment.begin(start)
        one = look()[PICTURE]
        environment.begin(plain)
        assert look()[PICTURE].rgb.tobytes() == one.rgb.tobytes()
