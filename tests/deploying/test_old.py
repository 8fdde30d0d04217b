"""What was measured long ago is neither recorded nor judged as if it were measured now."""

from __future__ import annotations

import io

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.deploying.faults import Fault, FaultKind
from dextera_build.deploying.simulated import Simulation
from dextera_build.errors import RuleError
from dextera_build.policy import robot_run
from dextera_build.policy.cell import Stopped
from tests.deploying.robots import NEEDED, Lifting, Line, Rig, Shown, Watcher

TARGETS = np.array([0.1, -0.05, 0.05, 0.04, 0.04])
GRAY = np.full((24, 32, 3), 90, np.uint8)


def faulty(*kinds: FaultKind) -> Simulation:
    """A robot in which something stops half a second after the first command."""
    return Simulation(loss=0.0, faults=tuple(Fault(kind, at_s=0.5) for kind in kinds))


def test_poses_of_a_tracker_that_died_are_not_measured_and_show_no_success() -> None:
    rig = Rig(simulation=faulty("poses_stop"), needed=())
    ran = rig.drive(Line(TARGETS), limit_s=3.0)
    assert (ran.faulty, ran.success) == (False, None), ran.reason
    measured = rig.cell.measure()
    assert np.isnan(measured.objects).all()
    assert np.isnan(measured.displacement).all()


@pytest.mark.parametrize(
    ("kind", "needed", "topic"),
    [
        ("poses_stop", NEEDED, "/tf of box"),
        ("pictures_stop", (*NEEDED, "rgb"), "/workspace/color/image_raw/compressed"),
    ],
)
def test_a_demonstration_ends_where_nothing_is_measured_any_more(
    kind: FaultKind, needed: tuple[str, ...], topic: str
) -> None:
    rig = Rig(simulation=faulty(kind), needed=(), camera=GRAY)
    watcher, ended = Watcher(rig, needed), list[str]()

    def step() -> None:
        try:
            watcher.step() if not ended else None
        except Stopped as stopped:
            ended.append(stopped.message)

    rig.drive(Shown(Line(TARGETS), step), limit_s=4.0)
    assert ended == [f"the guard stopped the robot: no frame arrived for more than 0.5 s on {topic}"]
    assert 15 < watcher.made.steps < 25
    made = robot_run.read(io.BytesIO(watcher.closed(ended[0])), "demo.mcap", rig.bundle)
    assert made.complete
    assert made.ended == ended[0]


def test_poses_that_arrive_late_stop_the_run() -> None:
    rig = Rig()
    held: list[tuple[int, bytes]] = []
    publish = rig.robot._transport.publish

    def late(topic, message):
        if topic.name != "/tf" or rig.robot._moving_since < 0:
            publish(topic, message)
            return
        held.append((rig.time, message))
        if rig.time - held[0][0] > 700_000_000:
            publish(topic, held.pop(0)[1])

    rig.robot._transport.publish = late  # type: ignore[method-assign]
    rig.drive(Line(TARGETS), limit_s=0.4)
    rig.sleep(1.0)
    with pytest.raises(Stopped, match=r"the newest frame on /tf of box is 0\.7\d s old, more than 0\.5 s"):
        rig.cell.begin()


def test_an_object_that_is_first_seen_after_the_start_is_not_judged() -> None:
    rig = Rig(needed=())
    rig.robot._simulation = Simulation(tracks=False)
    policy = Lifting()

    def step() -> None:
        if policy.steps == 20:
            rig.robot._simulation = Simulation()

    ran = rig.drive(Shown(policy, step), limit_s=3.0)
    assert (ran.faulty, ran.success, ran.steps) == (False, None, 60), ran.reason
    assert np.isfinite(rig.cell.measure().objects).all()


def test_the_last_picture_of_a_camera_that_died_is_no_picture_of_what_came_later() -> None:
    rig = Rig(simulation=faulty("pictures_stop"), needed=(), camera=GRAY)
    watcher = Watcher(rig)
    topic = rig.cell._topics.pictures["workspace"]
    watcher.transport.subscribe(topic, lambda message, at: watcher.bag.add(topic, at, message))
    rig.sleep(0.2)
    rig.drive(Shown(Line(TARGETS), watcher.step), limit_s=3.0)
    data = watcher.closed("the operator ended it", operator=True)
    run, pictures = robot_run.filmed(io.BytesIO(data), "demo.mcap", rig.bundle)
    assert len(run.sent) > 55
    with pytest.raises(RuleError, match=r"the camera of `demo\.mcap` gave no picture for 0\.5\d s") as caught:
        list(pictures)
    assert caught.value.facts["after"] == "0.43 s of the run"
