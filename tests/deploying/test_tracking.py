"""A robot whose objects nobody publishes: the tracker finds them in its pictures, and the policy acts on them."""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import png
from dextera_build.artifacts.robots.ros_names import RosNames
from dextera_build.deploying import photographed
from dextera_build.deploying import topics as tables
from dextera_build.deploying.faults import Fault, FaultKind
from dextera_build.deploying.loopback import Loopback
from dextera_build.deploying.simulated import Simulation
from dextera_build.deploying.topics import beside
from dextera_build.deploying.tracking import Watched
from dextera_build.deploying.transport import SENSOR, Topic
from dextera_build.errors import MachineError
from dextera_build.formats.ros import messages
from dextera_build.geometry import transforms
from dextera_build.policy.observation import Frame
from tests import factories, gate
from tests.deploying.robots import Line
from tests.deploying.watched import Seen, watched
from tests.sim.runtime import cells

TWIN = gate.bundle()
PUSHES = np.array([gate.target(gate.PUSHES)])
NAMES = RosNames(base="arm_base", objects="/tracked", pictures={"workspace": "/eye/image_raw/compressed"})


def seen(*faults: Fault) -> AbstractContextManager[Seen]:
    """The gate's reference world, watched by its cell's camera."""
    return watched(gate.bundle("reference"), TWIN, cells.cell(), NAMES, seed=3, faults=faults)


@pytest.mark.medium
def test_a_policy_gets_the_poses_of_objects_that_only_the_camera_sees() -> None:
    policy = Line(PUSHES)
    with seen() as rig:
        ran = rig.drive(policy, limit_s=4.0)
        truth = rig.robot.environment.measure()
    assert (ran.faulty, ran.success) == (False, True), ran.reason
    assert rig.robot.success
    last = policy.seen[-1]
    assert last["objects"][0][:3] == pytest.approx(truth.objects[0][:3], abs=0.003)
    assert last["displacement"] == pytest.approx(truth.displacement, abs=0.08)  # of a control period before
    assert np.ptp([each["displacement"][0] for each in policy.seen]) > 0.5
    assert rig.tracker is not None
    assert rig.tracker.status == {"case": "tracked"}
    assert rig.robot.heard.after_stop == 0


@pytest.mark.slow
def test_without_pictures_there_are_no_poses_and_the_robot_holds() -> None:
    with seen(Fault("pictures_stop", at_s=0.4)) as rig:
        ran = rig.drive(Line(PUSHES), limit_s=4.0)
        commands = rig.robot.heard.commands
        rig.sleep(0.5)
    assert ran.faulty
    assert "no frame arrived for more than 0.5 s" in ran.reason
    assert (rig.robot.heard.commands, rig.robot.heard.after_stop) == (commands, 0)


@pytest.mark.slow
def test_an_object_that_is_lost_has_no_pose() -> None:
    with seen() as rig:
        rig.sleep(0.3)
        stream = rig.cell.objects["case"]
        assert stream.count > 3
        blank = Frame(np.full((240, 320, 3), 90, np.uint8), np.full((240, 320), 2.0, np.float32))
        assert rig.robot._look is not None
        (camera,) = rig.robot._look()
        rig.robot._look = lambda: {camera: blank}
        rig.sleep(0.8)
        count = stream.count
        rig.sleep(0.5)
        assert rig.tracker is not None
        assert rig.tracker.status == {"case": "lost"}
        assert rig.tracker.why["case"]
        assert stream.count == count


def watching() -> tuple[Seen, Loopback, Watched]:
    rig = Seen(NAMES, bundle=TWIN)
    link = Loopback(rig.bus)
    looking = Watched(link, tables.of_robot(TWIN.robot, NAMES, ("workspace",)), TWIN)
    return rig, Loopback(rig.bus), looking


def info(camera: Camera) -> tuple[Topic, bytes]:
    return Topic("/eye/camera_info", "sensor_msgs/CameraInfo", SENSOR), messages.camera_info(0, "eye", camera)


def publish(rig: Seen, camera: Loopback, size: tuple[int, int], camera_s: float = 0.0, depth_s: float = 0.0) -> None:
    """A black picture and its depth, stamped by the robot's clock; those stamps may be off."""
    topics = tables.of_robot(TWIN.robot, NAMES, ("workspace",))
    (picture,), (depth,) = topics.pictures.values(), topics.depths.values()
    stamp = rig.robot._clock() + round(camera_s * 1e9)
    camera.publish(picture, messages.compressed_image(stamp, "eye", "png", png(np.zeros((*size, 3), np.uint8))))
    camera.publish(depth, messages.depth_image(stamp + round(depth_s * 1e9), "eye", np.zeros(size, np.uint16)))


def test_what_is_missing_is_named() -> None:
    rig, camera, looking = watching()
    rig.sleep(0.1)
    assert looking.missing() == [
        "/eye/image_raw/compressed", "/workspace/aligned_depth_to_color/image_raw", "/eye/camera_info",
    ]  # fmt: skip
    camera.publish(*info(factories.camera(64, 48)))
    assert "/eye/camera_info" not in looking.missing()
    assert looking.camera == factories.camera(64, 48)


@pytest.mark.parametrize("clock_s", [-3.0, 3.0])
def test_after_a_clock_was_set_frames_begin_anew(clock_s: float) -> None:
    rig, camera, looking = watching()
    camera.publish(*info(factories.camera(64, 48)))

    def shown() -> bool:
        rig.sleep(0.1)
        publish(rig, camera, (48, 64))
        return looking.frame() is not None

    assert shown()
    rig.robot._simulation = Simulation(clock_s=clock_s)
    assert [shown(), shown()] == [True, True]


def test_joint_states_that_cannot_be_used_end_the_tracker() -> None:
    rig, _, looking = watching()
    rig.robot._simulation, rig.robot._moving_since = Simulation(faults=(Fault("nan", at_s=0.05),)), 0
    rig.sleep(0.2)
    with pytest.raises(MachineError, match=r"a message of `/joint_states` cannot be used"):
        looking.frame()


@pytest.mark.parametrize("kind", ["joint_renamed", "joint_states_stop"])
def test_without_joint_states_there_are_no_frames(kind: FaultKind) -> None:
    rig, camera, looking = watching()
    camera.publish(*info(factories.camera(64, 48)))
    rig.robot._simulation, rig.robot._moving_since = Simulation(faults=(Fault(kind, at_s=0.0),)), 0
    rig.sleep(0.2)
    publish(rig, camera, (48, 64))
    assert "/joint_states" in looking.missing()[0]
    assert looking.frame() is None
    rig.robot._simulation = Simulation()
    rig.sleep(0.1)
    publish(rig, camera, (48, 64))
    assert looking.frame() is not None
    rig.robot._simulation = Simulation(faults=(Fault(kind, at_s=0.0),))
    rig.sleep(0.3)
    publish(rig, camera, (48, 64))
    assert looking.frame() is None


@pytest.mark.parametrize(
    ("camera_s", "depth_s", "why"),
    [
        (0.3, 0.0, r"for 5 s, pictures and joint states are 0\.3\d\d s apart"),
        (-0.3, 0.0, r"for 5 s, .* comes 0\.30 s later than /joint_states with the same stamps"),
        (0.0, 0.03, r"for 5 s, a picture and its depth are 0\.030 s apart"),
    ],
)
def test_stamps_that_never_fit_end_the_tracker(camera_s: float, depth_s: float, why: str) -> None:
    rig, camera, looking = watching()
    camera.publish(*info(factories.camera(64, 48)))

    def shown(seconds: float) -> list[bool]:
        found = []
        for _ in range(round(seconds * 10)):
            rig.sleep(0.1)
            publish(rig, camera, (48, 64), camera_s, depth_s)
            found.append(looking.frame() is not None)
        return found

    assert not any(shown(4.0))
    rig.sleep(2.0)
    assert looking.frame() is None, "a camera that is silent is waited for"
    assert not any(shown(4.0))
    with pytest.raises(MachineError, match=why):
        shown(2.0)


def test_intrinsics_that_are_no_numbers_are_refused() -> None:
    _, camera, looking = watching()
    lens = factories.camera(64, 48).model_copy(update={"fx": float("nan")})
    camera.publish(*info(lens))
    with pytest.raises(MachineError, match="no focal length"):
        looking.missing()


def test_a_picture_with_another_size_than_the_intrinsics_is_refused() -> None:
    rig, camera, looking = watching()
    rig.sleep(0.1)
    camera.publish(*info(factories.camera(64, 48)))
    publish(rig, camera, (24, 32))
    with pytest.raises(MachineError, match=r"pictures and depth are 32 x 24 and 32 x 24 px, .* says 64 x 48"):
        looking.frame()


def test_a_photograph_is_shown_as_the_robots_camera_has_it() -> None:
    own = Camera(width=64, height=48, fx=60.0, fy=60.0, cx=31.5, cy=23.5)
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[30:38, 40:52] = 200
    depth = np.full((48, 64), 0.8, np.float32)
    depth[30:38, 40:52] = 0.5
    capture = factories.rgbd(rgb, depth, own)
    other = Camera(width=100, height=80, fx=90.0, fy=90.0, cx=55.5, cy=41.0)
    colours, metres = photographed.pictured(capture, other)
    assert (colours.shape, metres.shape) == ((80, 100, 3), (80, 100))
    middle = (np.array([45.5, 33.5]) - [own.cx, own.cy]) / own.fx * other.fx + [other.cx, other.cy]
    row, column = np.nonzero(metres == np.float32(0.5))
    assert [column.mean(), row.mean()] == pytest.approx(middle, abs=0.6)
    assert colours[round(middle[1]), round(middle[0]), 0] == 200


def test_the_drawing_of_the_twin_shows_its_objects_where_they_were_photographed() -> None:
    cell = cells.cell()
    _, depth = photographed.drawn(TWIN, cell, cell.camera)
    top = np.array([0.0, 0.0, 0.1])
    camera = transforms.apply(transforms.invert(cells.EYE), top[None])[0]
    column, row = np.round(cell.camera.project(camera[None])[0]).astype(int)
    assert depth[row, column] == pytest.approx(camera[2], abs=0.03)


def test_intrinsics_are_beside_the_pictures() -> None:
    assert beside("/workspace/color/image_raw/compressed") == "/workspace/color/camera_info"
    assert beside("/eye/image") == "/eye/camera_info"
