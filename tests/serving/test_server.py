"""A policy behind a socket does what it does in this process, bit for bit, and its server refuses what it must."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from dextera_build.artifacts.tasks.policy import Channel, Checkpoint
from dextera_build.artifacts.tasks.task import TaskBundle, WorldKind
from dextera_build.errors import RuleError
from dextera_build.policy.features import Fields
from dextera_build.policy.observation import deployable
from dextera_build.policy.running import Policy, Predict
from dextera_build.policy.wire import promise
from dextera_build.policy.wire.codec import pack, unpack
from dextera_build.policy.wire.link import LARGEST
from dextera_build.serving.served import Served
from dextera_build.serving.server import MOST
from dextera_build.sim.runtime.environment import Environment
from dextera_build.testing import RuleRunner
from tests import episodes, task_bundles
from tests.policy import policies
from tests.serving import servers

BUNDLE = episodes.bundle()
SETTINGS: dict[str, float] = {"every": 2, "forget": 0.3}


@pytest.fixture(scope="module")
def trained() -> Checkpoint:
    """A very small ACT with normalised inputs, which overlap at run time."""
    contract = policies.contract(BUNDLE, **SETTINGS)
    scaled = [
        channel.model_copy(update={"mean": (0.1,) * size, "scale": (0.7,) * size})
        for channel in contract.inputs
        for size in [
            int(np.prod(channel.shape)) // 7 * 9 if channel.encoding == "pose" else int(np.prod(channel.shape))
        ]
    ]
    return policies.checkpoint(contract.model_copy(update={"inputs": tuple(scaled)}))


def behind(address: str, tmp_path: Path, **options: Any) -> Policy:
    """The policy at an address, as evaluations load it."""
    made = RuleRunner(tmp_path).run("learn.served", bundle=BUNDLE, options={"address": address, **options})
    assert isinstance(made, Checkpoint)
    return policies.load(made, BUNDLE)


def test_a_served_policy_acts_as_the_local_one(trained: Checkpoint, tmp_path: Path) -> None:
    local = policies.load(trained, BUNDLE)
    with servers.running(servers.served(trained, BUNDLE)) as address:
        far = behind(address, tmp_path)
        for _ in range(2):
            local.reset()
            far.reset()
            for step in range(7):
                seen = policies.observation(step)
                np.testing.assert_array_equal(far.act(seen), local.act(seen))


def test_a_served_diffusion_policy_draws_the_noise_of_the_local_one(tmp_path: Path) -> None:
    network = {"network": "unet", "horizon": 8, "width": 16, "levels": 2, "layers": 1, "heads": 1, "located": 0}
    settings = {"history": 2, "every": 4, "noise_levels": 20, "denoisings": 2, "seed": 0}
    made = policies.checkpoint(policies.contract(BUNDLE, algorithm="diffusion", **network, **settings))
    local = policies.load(made, BUNDLE)
    with servers.running(servers.served(made, BUNDLE)) as address:
        far = behind(address, tmp_path)
        for _ in range(2):
            local.reset()
            far.reset()
            for step in range(10):
                seen = policies.observation(step)
                np.testing.assert_array_equal(far.act(seen), local.act(seen))


def test_a_policy_of_pictures_is_served(tmp_path: Path) -> None:
    view = episodes.view()
    made = policies.checkpoint(policies.contract(BUNDLE, ("joints", "rgb"), view))
    local = policies.load(made, BUNDLE, view)
    size = (view.camera.height, view.camera.width, 3)
    picture = np.random.default_rng(0).integers(0, 256, size, np.uint8)
    with servers.running(servers.served(made, BUNDLE)) as address:
        options = {"address": address}
        found = RuleRunner(tmp_path).run("learn.served", bundle=BUNDLE, view=view, options=options)
        far = policies.load(found, BUNDLE, view)
        seen = policies.observation(rgb=picture)
        np.testing.assert_array_equal(far.act(seen), local.act(seen))


@pytest.mark.parametrize(
    ("kind", "names"),
    [
        ("twin", ("twin", "reference")),
        ("real", ("twin", "real")),
        ("reference", ("reference",)),
        ("perturbed", ("perturbed", "twin")),
    ],
)
def test_a_policy_that_is_told_its_world_is_served(kind: WorldKind, names: tuple[str, ...], tmp_path: Path) -> None:
    bundle = BUNDLE.model_copy(update={"kind": kind})
    told = Channel(name="world", shape=(len(names),), names=names)
    contract = policies.contract(bundle, **SETTINGS)
    made = policies.checkpoint(contract.model_copy(update={"inputs": (*contract.inputs, told)}))
    with servers.running(servers.served(made, bundle)) as address:
        found = RuleRunner(tmp_path).run("learn.served", bundle=bundle, options={"address": address})
        far, local = policies.load(found, bundle), policies.load(made, bundle)
        for step in range(3):
            seen = policies.observation(step)
            np.testing.assert_array_equal(far.act(seen), local.act(seen))


@pytest.mark.medium
def test_a_policy_that_practised_is_served(tmp_path: Path) -> None:
    bundle = task_bundles.close()
    few = {"steps": 32, "worlds": 2, "rollout": 16, "batch": 16, "width": 16}
    made = RuleRunner(tmp_path).run("learn.ppo", backend="sb3", bundle=bundle, options=few)
    environment = Environment(bundle)
    environment.begin(environment.draw(0))
    seen = deployable(environment.measure(), environment.previous_action, environment.goal)
    with servers.running(servers.served(made, bundle)) as address:
        found = RuleRunner(tmp_path).run("learn.served", bundle=bundle, options={"address": address})
        far, local = policies.load(found, bundle), policies.load(made, bundle)
        np.testing.assert_array_equal(far.act(seen), local.act(seen))


class Recalling:
    """A policy that sees two steps and counts its predictions since the episode began."""

    def predict(self, checkpoint: Checkpoint, bundle: TaskBundle) -> Predict:
        count = 0

        def targets(inputs: Fields, step: int) -> np.ndarray:
            nonlocal count
            count = 0 if step == 0 else count + 1
            before, now = inputs["joints"].reshape(2, -1).astype(np.float64)
            return np.stack([0.5 * before + 0.25 * now + count / 10 + row / 100 for row in range(4)])

        return targets


def test_a_policy_with_a_memory_is_served_step_by_step(tmp_path: Path) -> None:
    made = policies.checkpoint(policies.contract(BUNDLE, history=2, every=3, forget=0.0))
    local = Served(Recalling(), made, "0" * 64, BUNDLE).policy()
    with servers.running(Served(Recalling(), made, "0" * 64, BUNDLE)) as address:
        far = behind(address, tmp_path)
        for _ in range(2):
            local.reset()
            far.reset()
            for step in range(8):
                seen = policies.observation(step)
                np.testing.assert_array_equal(far.act(seen), local.act(seen))
        # A client that sends one step per request is remembered, and one that mixes both is told so.
        connection, said = greeted(address)
        alone = Served(Recalling(), made, "0" * 64, BUNDLE).policy()
        for step in range(3):
            seen = policies.observation(step)
            connection.send(pack({name: seen[name] for name in policies.INPUTS}))
            actions = unpack(connection.recv(timeout=5))["actions"]
            np.testing.assert_array_equal(actions, alone.chunk(seen))
        zero = zeros(said)
        connection.send(pack(zero | {"joints": np.stack([zero["joints"]] * 2)}))
        assert "different numbers of steps" in str(connection.recv(timeout=5))


def greeted(address: str, **more: Any) -> tuple[ClientConnection, promise.Promise]:
    connection = connect(address, compression=None, max_size=None, **more)
    greeting = connection.recv(timeout=5)
    found = promise.read(unpack(greeting)) if isinstance(greeting, bytes) else None
    assert found is not None
    return connection, found


def zeros(said: promise.Promise) -> dict[str, np.ndarray]:
    return {each.name: np.zeros(each.shape, each.dtype) for each in said.inputs}


def test_the_first_message_says_how_to_ask(trained: Checkpoint) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address:
        connection, said = greeted(address)
        with connection:
            assert said.joints == tuple(joint.name for joint in BUNDLE.robot.joints)
            assert (said.horizon, said.every, said.forget) == (4, 2, 0.3)
            assert said.instruction == "lift box"
            assert {each.name: each.unit for each in said.inputs}["objects"] == "m, unit quaternion"
            for asks in range(2):
                connection.send(pack(zeros(said) | {"prompt": "not read"}))
                answer = unpack(connection.recv(timeout=5))
                assert (answer["actions"].shape, answer["actions"].dtype) == ((4, 3), np.float64)
                assert answer["server_timing"]["infer_ms"] > 0
                assert ("prev_total_ms" in answer["server_timing"]) == (asks > 0)
            connection.send(pack({said.reset: True}))
            assert unpack(connection.recv(timeout=5)).keys() == {"server_timing"}


@pytest.mark.parametrize(
    ("spoiled", "text"),
    [
        ({"joints": np.zeros(4, np.float32)}, r"`joints` is \(4,\) float32, the policy takes \(3,\) float32"),
        ({"joints": np.array(["a", "b", "c"])}, "`joints` is"),
        ({"joints": [[1.0], [1.0, 2.0], 3]}, "`joints` is"),
        ({"joints": None}, "a request lacks joints"),
        ({"joints": np.full(3, np.nan, np.float32)}, "the policy was given NaN in `joints`"),
    ],
)
def test_a_wrong_request_is_answered_with_text(trained: Checkpoint, spoiled: dict[str, Any], text: str) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address:
        connection, said = greeted(address)
        request = {key: value for key, value in (zeros(said) | spoiled).items() if value is not None}
        connection.send(pack(request))
        answer = connection.recv(timeout=5)
        assert isinstance(answer, str)
        assert re.search(text, answer)
        with pytest.raises(ConnectionClosed) as closed:
            connection.recv(timeout=5)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1011


@pytest.mark.parametrize("data", [b"\xc1", "text", pack([1, 2])])
def test_what_is_no_request_is_answered_with_text(trained: Checkpoint, data: bytes | str) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address:
        connection, _ = greeted(address)
        connection.send(data)
        answer = connection.recv(timeout=5)
        assert isinstance(answer, str)
        assert "a request is a" in answer


def test_who_has_not_the_key_is_refused(trained: Checkpoint) -> None:
    with servers.running(servers.served(trained, BUNDLE), key="sesame-1") as address:
        for headers in (None, {"Authorization": "Api-Key sesame-2"}, {"Authorization": "sesame-1"}):
            with pytest.raises(InvalidStatus, match="401"):
                greeted(address, additional_headers=headers)
        connection, _ = greeted(address, additional_headers={"Authorization": "Api-Key sesame-1"})
        connection.close()
        assert httpx.get(address.replace("ws", "http") + "/healthz").text == "OK\n"


def test_pages_of_a_browser_are_refused(trained: Checkpoint) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address, pytest.raises(InvalidStatus, match="403"):
        greeted(address, origin="http://127.0.0.1:8000")


def test_a_huge_message_ends_its_connection_alone(trained: Checkpoint) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address:
        (large, _), (other, said) = greeted(address), greeted(address)
        with contextlib.suppress(ConnectionClosed):  # the server may end it before it has all
            large.send(b"\0" * (LARGEST + 1))
        with pytest.raises(ConnectionClosed, match=r"1009|reset|no close frame"):
            large.recv(timeout=5)
        other.send(pack(zeros(said)))
        assert "actions" in unpack(other.recv(timeout=5))
        other.close()


def test_one_client_too_many_is_told_so(trained: Checkpoint) -> None:
    with servers.running(servers.served(trained, BUNDLE)) as address:
        open_ = [greeted(address)[0] for _ in range(MOST)]
        with connect(address) as one_more, pytest.raises(ConnectionClosed, match=f"{MOST} clients are connected"):
            one_more.recv(timeout=5)
        open_.pop().close()
        for connection in open_:
            connection.close()


def test_a_policy_that_does_not_fit_the_task_is_not_served(trained: Checkpoint) -> None:
    other = trained.contract.model_copy(update={"task": "Another", "rate_hz": 50.0})
    with pytest.raises(RuleError, match="another task, another rate"):
        servers.served(trained.model_copy(update={"contract": other}), BUNDLE)
