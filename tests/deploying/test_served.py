"""A policy on another machine drives a robot as the same policy here does, and its loss ends held."""

from __future__ import annotations

import argparse
import contextlib

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="needs rosbags (extra `ros`)")
pytest.importorskip("websockets", reason="needs websockets (extra `serve`)")
pytest.importorskip("torch", reason="needs torch (extra `learn`)")

from dextera_build.cli.robot import acting
from dextera_build.cli.robot.connected import Connected
from dextera_build.errors import UsageError
from dextera_build.policy.running import Policy
from dextera_build.policy.wire import asked
from dextera_build.policy.wire.said import connected
from dextera_build.sim.runtime import policies as loading
from tests import task_bundles
from tests.deploying.robots import Rig
from tests.policy import policies
from tests.serving import servers

CHECKPOINT = policies.checkpoint(
    policies.contract(task_bundles.lift(), ("joints", "objects", "previous_action"), every=2, forget=0.3)
)


def behind(address: str, rig: Rig) -> Policy:
    """The policy at an address, as `dxb run` loads it."""
    link, said = connected(address, "")
    link.close()
    assert said.promise is not None
    settings = asked.promised(said.promise, address, "", 60.0, 0.5)
    return loading.load(asked, asked.elsewhere(asked.stated(said.promise, said.digest, settings)), rig.bundle)


def moved(rig: Rig, policy: Policy) -> list[np.ndarray]:
    """The targets that were sent."""
    sent: list[np.ndarray] = []
    send = rig.cell.send
    rig.cell.send = lambda targets: sent.append(send(targets)) or sent[-1]  # type: ignore[method-assign, func-returns-value]
    ran = rig.drive(policy, limit_s=1.0)
    assert not ran.faulty, ran.reason
    return sent


@pytest.mark.slow
def test_a_served_policy_drives_as_the_local_one() -> None:
    here, there = Rig(), Rig()
    local = moved(here, policies.load(CHECKPOINT, here.bundle))
    with servers.running(servers.served(CHECKPOINT, there.bundle)) as address:
        served = moved(there, behind(address, there))
    assert len(local) == 20
    assert np.ptp(local, axis=0).max() > 0.01
    assert np.array_equal(local, served)


def test_a_server_that_does_not_state_its_policy_is_refused() -> None:
    with servers.scripted(servers.foreign(lambda data: None)) as address:
        args = argparse.Namespace(replay=None, policy=address, api_key=None, real_time_chunking=False)
        with pytest.raises(UsageError, match="does not state what its policy takes"):
            acting.found(args, Connected(None, None, None, {}, {}))  # type: ignore[arg-type]


def test_a_server_is_not_asked_for_an_answer_that_continues_another() -> None:
    args = argparse.Namespace(replay=None, policy="ws://127.0.0.1:1", api_key=None, real_time_chunking=True)
    with pytest.raises(UsageError, match="not told what its answer has to continue") as raised:
        acting.found(args, Connected(None, None, None, {}, {}))  # type: ignore[arg-type]
    assert "--asynchronous" in str(raised.value.hint)


def test_a_server_that_ends_holds_the_robot() -> None:
    rig = Rig()
    with contextlib.ExitStack() as stack:
        policy = behind(stack.enter_context(servers.running(servers.served(CHECKPOINT, rig.bundle))), rig)
        act, calls = policy.act, [0]

        def until_the_end(observation):
            calls[0] += 1
            if calls[0] == 12:
                stack.close()
            return act(observation)

        policy.act = until_the_end  # type: ignore[method-assign]
        ran = rig.drive(policy)
    assert ran.faulty
    assert "the connection to the policy at" in ran.reason
    assert ran.steps <= 12
    heard = rig.robot.heard.commands
    rig.sleep(1.0)
    assert (rig.robot.heard.commands, rig.robot.heard.after_stop) == (heard, 0)
