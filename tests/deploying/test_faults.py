"""Whatever goes wrong, the robot holds, the reason is told, and no command comes after the stop."""

from __future__ import annotations

import threading
import time
from typing import Literal

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")

from dextera_build.artifacts.robots.cell import Limits
from dextera_build.artifacts.robots.ros_names import Controller, RosNames
from dextera_build.deploying import topics as tables
from dextera_build.deploying.cell import GUARDED, Safety
from dextera_build.deploying.commanders import KEPT, Commanders
from dextera_build.deploying.driving import Clock
from dextera_build.deploying.faults import FAULTS, Fault, FaultKind
from dextera_build.deploying.loopback import Loopback
from dextera_build.deploying.simulated import Simulation
from dextera_build.formats.ros import messages
from dextera_build.policy.running import PolicyFault
from tests.deploying.robots import Line, Rig

TARGETS = np.array([0.1, -0.05, 0.05, 0.04, 0.04])
ASTRAY = "moved away from the targets: positions and commands have different signs, or belong to different joints"
WHY: dict[FaultKind, str] = {
    "joint_states_stop": "no joint states arrived for more than 0.1 s",
    "joint_states_late": "no joint states arrived for more than 0.1 s",
    "joint_states_lost": "no joint states arrived for more than 0.1 s",
    "pictures_stop": "no frame arrived for more than 0.5 s on /workspace/color/image_raw/compressed",
    "pictures_freeze": "`workspace` shows the same picture while the robot moves",
    "poses_stop": "no frame arrived for more than 0.5 s on /tf of box",
    "stamps_jump": "the stamps of `/joint_states` jumped by +3.00 s",
    "stamps_back": "the stamps of `/joint_states` jumped by -3.00 s",
    "nan": "a message of `/joint_states` cannot be used: the position of x is not a finite number",
    "sign_flipped": f"x {ASTRAY}",
    "joint_missing": "a message of `/joint_states` cannot be used: it lacks x; it has left, right, y, z",
    "joint_renamed": "a message of `/joint_states` cannot be used: it lacks x; it has left, right, x_2, y, z",
    "cut": "no joint states arrived for more than 0.1 s",
}


def held(rig: Rig) -> None:
    """Assert that the robot moves no more, and that it was told why."""
    rig.sleep(0.3)
    place = rig.robot.environment.measure().joints
    heard = rig.robot.heard.commands
    rig.sleep(1.0)
    assert rig.robot.environment.measure().joints == pytest.approx(place, abs=2e-3)
    assert rig.robot.heard.commands == heard
    assert rig.robot.heard.after_stop == 0


@pytest.mark.parametrize("kind", FAULTS)
def test_a_fault_of_the_robot_ends_held_and_explained(kind: FaultKind) -> None:
    camera = np.full((24, 32, 3), 90, np.uint8)
    simulation = Simulation(faults=(Fault(kind, at_s=0.5),))
    rig = Rig(simulation=simulation, camera=camera, needed=("objects", "displacement", "rgb"))
    ran = rig.drive(Line(TARGETS))
    assert ran.faulty
    assert ran.reason == f"the guard stopped the robot: {WHY[kind]}"
    assert 10 <= ran.steps <= 30
    held(rig)
    if kind != "cut":
        assert rig.robot.heard.status[-1] == f"stopped: {ran.reason}"


def test_names_that_are_exchanged_in_the_joint_states_end_held_and_explained() -> None:
    rig = Rig()
    told = rig.robot._joints.state
    rig.robot._joints.state = lambda stamp, places: told(stamp, places[[1, 0, 2, 3, 4]])  # type: ignore[method-assign]
    ran = rig.drive(Line(np.array([0.3, -0.3, 0.05, 0.04, 0.04])), limit_s=5.0)
    assert ran.reason.startswith(f"the guard stopped the robot: x, y {ASTRAY}")
    assert np.abs(rig.robot.environment.measure().joints[:2]).max() < 0.1
    held(rig)


def test_a_position_that_jumps_ends_held_and_explained() -> None:
    rig = Rig(simulation=Simulation(faults=(Fault("sign_flipped", at_s=2.0),)))
    ran = rig.drive(Line(np.array([0.4, 0.3, 0.05, 0.04, 0.04])), limit_s=5.0)
    assert "the guard stopped the robot: positions jumped in 0.050 s: x from 0." in ran.reason
    held(rig)


@pytest.mark.parametrize("for_s", [0.2, 2.0])
def test_a_network_that_returns_moves_nothing(for_s: float) -> None:
    rig = Rig(simulation=Simulation(faults=(Fault("cut", 0.5, for_s),)))
    ran = rig.drive(Line(TARGETS))
    assert ran.reason.endswith("no joint states arrived for more than 0.1 s")
    rig.sleep(for_s)
    with pytest.raises(PolicyFault):
        rig.cell.send(TARGETS)
    held(rig)


def test_a_short_cut_passes() -> None:
    rig = Rig(simulation=Simulation(faults=(Fault("cut", 0.5, 0.08),)))
    assert not rig.drive(Line(TARGETS)).faulty


def died() -> np.ndarray:
    raise PolicyFault("the connection to the policy was lost", code="DXB-B541")


@pytest.mark.parametrize(
    ("then", "why"),
    [
        (died, "the connection to the policy was lost"),
        (lambda: np.full(5, np.nan), "the guard stopped the robot: the target of left, right, x, y and z is not"),
        (lambda: np.zeros(3), "the guard stopped the robot: 3 targets for 5 joints"),
    ],
)
def test_a_policy_that_fails_ends_held_and_explained(then, why) -> None:
    rig = Rig()
    ran = rig.drive(Line(TARGETS, after=10, then=then))
    assert ran.faulty
    assert ran.steps == 10
    assert ran.reason.startswith(why[:40])
    held(rig)


def test_a_robot_that_is_silent_from_the_beginning_is_not_moved() -> None:
    rig = Rig()
    rig.robot.tick = lambda: None  # type: ignore[method-assign]
    ran = rig.drive(Line(TARGETS))
    assert ran.reason.startswith("the guard stopped the robot: nothing arrived on /joint_states")
    assert rig.robot.heard.commands == 0


@pytest.mark.parametrize("kind", ["trajectory", "forward"])
def test_another_program_that_commands_the_robot_stops_the_run(kind: Literal["trajectory", "forward"]) -> None:
    rig = Rig(RosNames(controllers=(Controller(topic="/go", kind=kind),)))
    other, (controller,) = Loopback(rig.bus), rig.cell._topics.controllers

    def commanded() -> np.ndarray:
        other.publish(controller.topic, rig.cell._joints.command(rig.time, controller, np.zeros(5), 50_000_000))
        return TARGETS

    ran = rig.drive(Line(TARGETS, after=10, then=commanded))
    assert (ran.reason, ran.steps) == ("the guard stopped the robot: another program commands /go, too", 10)
    held(rig)


def test_a_palm_that_would_leave_the_workspace_stops_the_run() -> None:
    rig = Rig(safety=Safety(GUARDED.stricter(Limits(workspace_m=((-1.0, -1.0, -1.0), (0.08, 1.0, 1.0))))))
    ran = rig.drive(Line(np.array([0.3, 0.0, 0.05, 0.04, 0.04])), limit_s=5.0)
    assert "the palm of `arm` would leave the workspace: x is not within -1 to 0.08 m" in ran.reason
    assert rig.robot.environment.measure().joints[0] < 0.081
    held(rig)


def test_commands_that_come_back_are_no_others() -> None:
    rig = Rig()
    publish = rig.transport.publish

    def echoed(topic, message):
        publish(topic, message)
        rig.transport.arrived(topic, message)

    rig.transport.publish = echoed  # type: ignore[method-assign]
    assert not rig.drive(Line(TARGETS)).faulty


def test_a_slow_policy_neither_bursts_nor_acts_on_what_was_long_ago() -> None:
    rig = Rig()
    times: list[int] = []
    publish = rig.transport.publish

    def noted(topic, message):
        times.append(rig.time) if topic.name == "/joint_trajectory" else None
        publish(topic, message)

    rig.transport.publish = noted  # type: ignore[method-assign]
    slow = iter([0.3, 0.0, 0.0, 0.0, 0.3, 0.0, 0.0, 0.7])

    def answer() -> np.ndarray:
        rig.sleep(seconds) if (seconds := next(slow)) else None
        return TARGETS

    ran = rig.drive(Line(TARGETS, after=5, then=answer))
    assert ran.reason == "the guard stopped the robot: the policy answered after 0.70 s, later than 0.5 s"
    assert ran.missed == 2
    assert min(np.diff(times)) >= 50_000_000  # answers without delay, so that a whole period lies between them
    held(rig)


def test_the_operator_stops_it() -> None:
    rig = Rig()

    def pressed() -> np.ndarray:
        raise KeyboardInterrupt

    ran = rig.drive(Line(TARGETS, after=10, then=pressed))
    assert ran.reason == "the guard stopped the robot: the operator stopped it"
    held(rig)


def test_a_key_that_is_pressed_while_the_policy_thinks_stops_it() -> None:
    rig, halt = Rig(), threading.Event()

    def pressed() -> np.ndarray:
        halt.set()
        return TARGETS

    ran = rig.drive(Line(TARGETS, after=10, then=pressed), halt=halt)
    assert (ran.reason, ran.steps) == ("the guard stopped the robot: the operator stopped it", 10)
    held(rig)
    assert rig.robot.heard.commands == 10


def test_an_error_in_a_policy_is_told_to_the_robot() -> None:
    rig = Rig()

    def broken() -> np.ndarray:
        raise ZeroDivisionError("by zero")

    with pytest.raises(ZeroDivisionError):
        rig.drive(Line(TARGETS, after=10, then=broken))
    assert rig.robot.heard.status[-1] == "stopped: ZeroDivisionError: by zero"
    held(rig)


def test_a_command_that_comes_when_its_time_is_over_is_refused() -> None:
    rig = Rig(simulation=Simulation(clock_s=2.0))
    late: list[bytes] = []
    publish = rig.transport.publish
    cut = False

    def held_back(topic, message):
        late.append(message) if cut else publish(topic, message)

    rig.transport.publish = held_back  # type: ignore[method-assign]
    rig.cell.begin()
    rig.cell.send(TARGETS)
    cut = True
    rig.cell.send(TARGETS)
    rig.sleep(0.5)
    publish(rig.cell._topics.controllers[0].topic, late[0])
    assert (rig.robot.heard.commands, rig.robot.heard.expired) == (2, 1)


@pytest.mark.parametrize("delay_s", [0.01, 0.03, 0.06])
def test_a_delay_that_was_measured_is_no_reason_to_refuse_commands(delay_s: float) -> None:
    rig = Rig(needed=())
    rig.bus.delay_s = delay_s
    rig.sleep(0.3)
    assert rig.cell.probe() == pytest.approx(2 * delay_s)
    ran = rig.drive(Line(TARGETS), limit_s=3.0)
    rig.sleep(0.3)
    assert (ran.faulty, ran.steps) == (False, 60), ran.reason
    assert (rig.robot.heard.commands, rig.robot.heard.expired) == (60, 0)
    assert rig.robot.environment.measure().joints == pytest.approx(TARGETS, abs=3e-3)


def test_a_robot_that_refuses_all_commands_is_told_to_not_follow() -> None:
    rig = Rig(needed=())
    rig.bus.delay_s = 0.03
    rig.sleep(0.3)
    ran = rig.drive(Line(TARGETS), limit_s=10.0)
    rig.sleep(0.1)
    assert ran.reason.startswith("the guard stopped the robot: the robot does not follow: z did not move in 1 s")
    assert rig.robot.heard.expired == rig.robot.heard.commands == ran.steps < 60
    held(rig)


def test_an_arm_that_is_blocked_is_told_once_its_targets_are_far_beyond() -> None:
    rig = Rig(needed=())
    told = rig.robot._joints.state
    stops = np.array([0.08, np.inf, np.inf, np.inf, np.inf])
    rig.robot._joints.state = lambda stamp, places: told(stamp, np.minimum(places, stops))  # type: ignore[method-assign]
    near = rig.drive(Line(np.array([0.2, -0.05, 0.05, 0.04, 0.04])), limit_s=6.0)
    assert not near.faulty, near.reason
    far = rig.drive(Line(np.array([0.4, -0.05, 0.05, 0.04, 0.04])), limit_s=6.0)
    assert "the robot does not follow: x did not move in 1 s" in far.reason


@pytest.mark.parametrize("off_s", [0.5, 0.95])
def test_after_commands_that_were_not_obeyed_no_joint_jumps_far(off_s: float) -> None:
    rig = Rig(needed=())
    obey, speeds, ahead = rig.robot._obey, list[float](), list[float]()
    off = range(30, 30 + round(20 * off_s))
    policy = Line(np.array([0.55, 0.5, 0.3, 0.04, 0.04]))
    rig.robot._obey = lambda: (  # type: ignore[method-assign]
        rig.robot._waiting.clear() if len(policy.seen) in off else obey()
    )
    before = rig.robot.environment.measure().joints

    def step() -> np.ndarray:
        nonlocal before
        joints = rig.robot.environment.measure().joints
        speeds.append(20 * float(np.abs(joints - before)[:3].max()))
        ahead.append(float(np.abs(rig.cell.previous_action - joints)[:3].max()))
        before = joints
        return policy.targets

    policy.after, policy.then = 0, step
    ran = rig.drive(policy, limit_s=4.0)
    assert not ran.faulty, ran.reason
    assert max(speeds[: off[0]]) < 0.31
    # 0.3 m/s for 0.25 s and a control period, after which commands are obeyed again.
    assert max(ahead) <= 0.3 * 0.3 + 1e-9
    assert max(speeds) < 0.9
    assert rig.robot.environment.measure().joints[0] == pytest.approx(0.55, abs=0.01)


@pytest.mark.parametrize("at_s", [0.0, 0.6, 0.8])
def test_a_flipped_sign_shows_although_targets_wait_for_their_joints(at_s: float) -> None:
    rig = Rig(simulation=Simulation(faults=(Fault("sign_flipped", at_s=at_s),)), needed=())
    ran = rig.drive(Line(np.array([0.5, 0.0, 0.0, 0.04, 0.04])), limit_s=6.0)
    assert f"x {ASTRAY}" in ran.reason
    held(rig)


def test_the_clock_of_this_machine_that_is_set_back_stops_the_run_at_once() -> None:
    rig, set_back = Rig(needed=()), [0]
    rig.bus.now = lambda: rig.time - set_back[0]

    def step() -> np.ndarray:
        set_back[0] = 30 * 10**9
        return TARGETS

    ran = rig.drive(Line(TARGETS, after=10, then=step))
    assert "the stamps of `/joint_states` jumped by -29.99 s" in ran.reason
    assert ran.steps <= 12
    assert Clock().now is time.monotonic_ns, "or else the loop would sleep for these 30 s"


def test_an_error_while_messages_are_received_ends_held_and_explained() -> None:
    rig = Rig(needed=())

    def step() -> np.ndarray:
        rig.transport.fault = "a message could not be taken: RuntimeError: it changed"
        return TARGETS

    ran = rig.drive(Line(TARGETS, after=10, then=step))
    assert ran.reason == f"the guard stopped the robot: {rig.transport.fault}"
    held(rig)


def test_transforms_of_others_are_not_looked_at() -> None:
    rig = Rig()
    other = Loopback(rig.bus)

    def step() -> np.ndarray:
        edges = [("base", "camera_link", np.zeros(7))]
        other.publish(tables.offered(rig.cell._topics.objects), messages.transforms(rig.time, edges))
        return TARGETS

    assert not rig.drive(Line(TARGETS, after=10, then=step)).faulty


def test_commands_are_looked_up_while_others_are_noted() -> None:
    rig = Rig()
    (controller,) = rig.cell._topics.controllers
    known = Commanders(Loopback(rig.bus), rig.cell._topics, rig.cell._joints)
    commands = [rig.cell._joints.command(at, controller, np.full(5, 1e-4 * at), 50_000_000) for at in range(1, 1200)]
    for command in commands[:900]:
        known.sends(controller, command)
    ended, failed = threading.Event(), list[BaseException]()

    def listen() -> None:
        try:
            while not ended.is_set():
                known._heard(controller, commands[899], 0)
        except RuntimeError as error:
            failed.append(error)

    thread = threading.Thread(target=listen)
    thread.start()
    for command in commands[900:]:
        known.sends(controller, command)
        time.sleep(0.0005)
    ended.set()
    thread.join()
    assert (failed, known.fault) == ([], "")
    assert len(known._own) == KEPT
