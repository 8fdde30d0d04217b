"""learn.served: whatever a server does, a trial fails with one clear reason, and nothing waits for ever."""

from __future__ import annotations

import base64
import gc
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from websockets.sync.server import ServerConnection

from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.errors import MachineError, RuleError
from dextera_build.policy.running import Policy, PolicyFault
from dextera_build.policy.wire import link
from dextera_build.policy.wire.codec import pack, unpack
from dextera_build.policy.wire.said import connected
from dextera_build.testing import RuleRunner
from tests import episodes, readers
from tests.policy import policies
from tests.serving import servers

BUNDLE = episodes.bundle()
CHUNK = np.arange(12.0).reshape(4, 3) / 100


def checkpoint(tmp_path: Path, address: str, backend: str = "network", **options: Any) -> Checkpoint:
    view = {"view": options.pop("view")} if "view" in options else {}
    made = RuleRunner(tmp_path).run(
        "learn.served", backend=backend, bundle=BUNDLE, options={"address": address} | options, **view
    )
    assert isinstance(made, Checkpoint)
    return made


def policy(tmp_path: Path, address: str, **options: Any) -> Policy:
    return policies.load(checkpoint(tmp_path, address, **options), BUNDLE, options.get("view"))


def actions(chunk: object) -> Callable[[bytes], bytes]:
    return lambda data: pack({"actions": chunk})


def test_a_foreign_policy_is_asked_by_its_own_keys(tmp_path: Path) -> None:
    """As openpi's example for a robot: nested names, a prompt, several steps of which some are carried out."""
    asked: list[dict[str, Any]] = []

    def answer(data: bytes) -> bytes:
        asked.append(unpack(data))
        return pack({"actions": CHUNK.astype(np.float32) + len(asked), "server_timing": {"infer_ms": 1.0}})

    options: dict[str, Any] = {
        "inputs": ("joints", "objects", "rgb"),
        "keys": {"joints": "observation/state", "rgb": "observation/image"},
        "horizon": 4,
        "every": 3,
        "view": episodes.view(),
    }
    with servers.scripted(servers.foreign(answer, {"reset_pose": [0.0]})) as address:
        far = policy(tmp_path, address, **options)
        picture = np.zeros((48, 64, 3), np.uint8)
        acted = [far.act(policies.observation(step, rgb=picture)) for step in range(5)]
    seen = policies.observation(0, rgb=picture)
    assert asked[0].keys() == {"observation/state", "objects", "observation/image", "prompt"}
    assert asked[0]["prompt"] == "lift box"
    np.testing.assert_array_equal(asked[0]["observation/state"], seen["joints"])
    np.testing.assert_array_equal(asked[0]["objects"], seen["objects"])
    assert (asked[0]["observation/image"].shape, asked[0]["observation/image"].dtype) == ((48, 64, 3), np.uint8)
    limits = np.array([(joint.lower, joint.upper) for joint in BUNDLE.robot.joints])
    expected = np.concatenate([CHUNK[:3] + 1, CHUNK[:2] + 2]).clip(limits[:, 0], limits[:, 1])
    np.testing.assert_allclose(acted, expected, atol=1e-6)
    assert len(asked) == 2


@pytest.mark.slow
def test_messages_of_openpi_itself_are_read(tmp_path: Path) -> None:
    """A server packs its answers with openpi's own functions, and unpacks what is asked of it."""
    options = {"keys": {"joints": "observation/state", "rgb": "observation/image"}, "horizon": 3, "every": 2}
    with readers.started("openpi", Path(readers.__file__).parent / "serving" / "openpi_server_peer.py") as peer:
        assert peer.stdout is not None
        try:
            address = peer.stdout.readline().strip()
            far = policy(tmp_path, address, view=episodes.view(), inputs=("joints", "rgb"), **options)
            seen = [policies.observation(step, rgb=np.zeros((48, 64, 3), np.uint8)) for step in range(3)]
            acted = [far.act(one) for one in seen]
            asked = json.loads(peer.stdout.readline())
            with pytest.raises(PolicyFault, match="answered with an error: KeyError: 'observation/state'"):
                policy(tmp_path, address, inputs=("objects",)).act(seen[0])
        finally:
            peer.kill()
    limits = np.array([(joint.lower, joint.upper) for joint in BUNDLE.robot.joints])
    expected = np.array([seen[0]["joints"], 2 * seen[0]["joints"], seen[2]["joints"]])
    np.testing.assert_allclose(acted, expected.clip(limits[:, 0], limits[:, 1]), atol=1e-6)
    assert asked["observation/image"] == ["uint8", 48, 64, 3]
    assert asked["observation/state"] == ["float32", len(BUNDLE.robot.joints)]


FAULTS: dict[str, tuple[Callable[[bytes], bytes | str | None], str, str]] = {
    "another number of joints": (actions(np.zeros((1, 7))), "DXB-B543", "has 7 numbers a step, the robot has 3 joints"),
    "another horizon": (actions(np.zeros((50, 3))), "DXB-B543", "has 50 steps, 1 were expected"),
    "three axes": (actions(np.zeros((1, 1, 3))), "DXB-B543", "holds no table of numbers"),
    "words": (actions(["left", "right", "up"]), "DXB-B543", "holds no table of numbers"),
    "rows of two lengths": (actions([[1.0], [1.0, 2.0]]), "DXB-B543", "holds no table of numbers"),
    "no actions": (lambda data: pack({"action": 1}), "DXB-B543", "has no `actions`"),
    "no map": (lambda data: pack([1.0, 2.0]), "DXB-B543", "is no map"),
    "no message": (lambda data: b"\xc1", "DXB-B543", "is no message"),
    "not finite": (actions(np.full((1, 3), np.nan)), "DXB-B511", "the policy gave NaN at step 0"),
    "an error": (
        lambda data: "Traceback (most recent call last):\n  File \"a.py\", line 1\nKeyError: 'observation/image'\n",
        "DXB-B542",
        "answered with an error: KeyError: 'observation/image'",
    ),
    "an end": (lambda data: None, "DXB-B541", "was lost"),
    "too much": (lambda data: b"\0" * (link.LARGEST + 1), "DXB-B544", "an answer of the policy"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_of_an_answer_has_its_message(fault: str, tmp_path: Path) -> None:
    answer, code, text = FAULTS[fault]
    with servers.scripted(servers.foreign(answer)) as address:
        far = policy(tmp_path, address)
        with pytest.raises(PolicyFault, match=text) as caught:
            far.act(policies.observation())
        assert caught.value.code == code
        assert code == "DXB-B511" or address in caught.value.message
        assert code == "DXB-B511" or caught.value.hint or caught.value.facts


def test_a_server_that_does_not_answer_is_left_after_its_limit(tmp_path: Path) -> None:
    def silent(data: bytes) -> bytes:
        time.sleep(0.5)
        return b""

    with servers.scripted(servers.foreign(silent)) as address:
        far = policy(tmp_path, address, first_s=0.1)
        began = time.perf_counter()
        with pytest.raises(PolicyFault, match=r"gave no answer in 0\.1 s") as caught:
            far.act(policies.observation())
        assert caught.value.code == "DXB-B540"
        assert time.perf_counter() - began < 2.0  # closing takes up to one


def test_a_server_that_does_not_read_is_left_after_its_limit(tmp_path: Path) -> None:
    """More than the kernel's buffers hold, and nobody takes it out."""

    def deaf(connection: ServerConnection) -> None:
        connection.send(pack({}))
        time.sleep(1.5)

    with servers.scripted(deaf) as address:
        opened = connected(address, "")[0]
        with pytest.raises(PolicyFault) as caught:
            opened.ask({"rgb": np.zeros(2**25, np.uint8)}, 0.1)
        assert caught.value.code in ("DXB-B540", "DXB-B541")


def test_the_next_trial_connects_anew(tmp_path: Path) -> None:
    answers = iter([None, pack({"actions": np.zeros((1, 3))}), None])
    with servers.scripted(servers.foreign(lambda data: next(answers))) as address:
        far = policy(tmp_path, address)
        with pytest.raises(PolicyFault):
            far.act(policies.observation())
        far.reset()
        assert far.act(policies.observation()).tolist() == [0.0, 0.0, 0.0]
        with pytest.raises(PolicyFault, match="was lost"):
            far.act(policies.observation())
    far.reset()
    with pytest.raises(MachineError, match="no policy can be asked at") as caught:  # trials are not run without it
        far.act(policies.observation())
    assert caught.value.code == "DXB-E328"


def test_the_connection_ends_with_the_policy(tmp_path: Path) -> None:
    left: list[bool] = []

    def converse(connection: ServerConnection) -> None:
        connection.send(pack({}))
        left.extend(isinstance(data, str) for data in connection)
        left.append(True)

    with servers.scripted(converse) as address:
        far = policy(tmp_path, address)
        before = len(left)  # the rule itself has connected and left
        del far
        gc.collect()
        for _ in range(100):
            if len(left) > before:
                break
            time.sleep(0.01)
        assert len(left) == before + 1


@pytest.mark.parametrize(
    ("converse", "reason"),
    [
        (lambda connection: None, "no close frame|1000|OK"),
        (lambda connection: connection.send("busy"), "busy"),
        (lambda connection: connection.send(b"\xc1"), "metadata are no message"),
    ],
)
def test_a_server_that_says_nothing_is_one_clear_error(
    converse: Callable[[ServerConnection], None], reason: str, tmp_path: Path
) -> None:
    with servers.scripted(converse) as address, pytest.raises(MachineError) as caught:
        checkpoint(tmp_path, address)
    assert caught.value.code == "DXB-E328"
    assert any(part in caught.value.facts["reason"] for part in reason.split("|"))


@pytest.mark.parametrize(
    "address", ["ws://127.0.0.1:9", "ws://nowhere.invalid:8000", "ws://:0", "http://127.0.0.1:9/act"]
)
def test_an_address_where_nothing_listens_is_one_clear_error(address: str, tmp_path: Path) -> None:
    with pytest.raises(MachineError, match="no policy can be asked at") as caught:
        checkpoint(tmp_path, address)
    assert "dxb serve" in str(caught.value.hint)


def test_a_key_is_taken_from_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = policies.checkpoint(policies.contract(BUNDLE))
    with servers.running(servers.served(trained, BUNDLE), key="sesame-1") as address:
        for value, text in (("", "is empty"), ("sesame-2", "no policy can be asked")):
            monkeypatch.setenv("POLICY_KEY", value)
            with pytest.raises(MachineError, match=text):
                checkpoint(tmp_path, address, key_in="POLICY_KEY")
        with pytest.raises(MachineError, match="no policy can be asked") as caught:
            checkpoint(tmp_path, address)
        assert caught.value.facts["reason"] == "it asks for a key"
        monkeypatch.setenv("POLICY_KEY", "sesame-1")
        assert "sesame" not in str(checkpoint(tmp_path, address, key_in="POLICY_KEY").contract)


def test_another_policy_at_the_address_is_refused(tmp_path: Path) -> None:
    with servers.scripted(servers.foreign(actions(CHUNK), {"weights": "new"})) as address:
        made = checkpoint(tmp_path, address)
        older = made.contract.model_copy(update={"dataset": "1" * 64})
        with pytest.raises(RuleError, match="another policy answers at") as caught:
            policies.load(made.model_copy(update={"contract": older}), BUNDLE)
        assert caught.value.code == "DXB-B545"


def test_a_served_policy_of_another_task_is_refused_when_it_is_built(tmp_path: Path) -> None:
    trained = policies.checkpoint(policies.contract(BUNDLE))
    served = servers.served(trained, BUNDLE)
    served.promise = served.promise.model_copy(update={"joints": ("a", "b", "c"), "rate_hz": 50.0})
    with servers.running(served) as address, pytest.raises(RuleError, match="other actions, another rate"):
        checkpoint(tmp_path, address)


def test_what_a_server_states_may_be_executed_in_another_rhythm(tmp_path: Path) -> None:
    trained = policies.checkpoint(policies.contract(BUNDLE, every=1, forget=0.5))
    with servers.running(servers.served(trained, BUNDLE)) as address:
        settings = checkpoint(tmp_path, address, every=4).contract.settings
        assert (settings["every"], settings["horizon"], settings["forget"]) == (4, 4, 0.5)
        for wrong in ({"every": 5}, {"horizon": 3}):
            with pytest.raises(RuleError, match="4 steps"):
                checkpoint(tmp_path, address, **wrong)


@pytest.mark.parametrize(
    "options",
    [
        {"address": "127.0.0.1:8000"},
        {"address": "ws://me:secret@127.0.0.1:9"},
        {"inputs": ("contact",)},
        {"horizon": 2, "every": 3},
        {"answer_s": 0.0},
    ],
)
def test_options_that_cannot_hold_are_refused(options: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises((ValidationError, RuleError, ValueError)):
        checkpoint(tmp_path, **({"address": "ws://127.0.0.1:9"} | options))


def test_without_a_server_the_stub_gives_the_contract_of_the_options(tmp_path: Path) -> None:
    made = checkpoint(tmp_path, "ws://127.0.0.1:9", backend="stub", horizon=8)
    assert [channel.name for channel in made.contract.inputs] == ["joints", "objects", "displacement", "goal"]
    assert made.contract.settings["every"] == 8


# OpenVLA. Its weights were not run: these are the forms of answer that the code of its server writes, as json_numpy 2.1
# encodes them.
VECTOR = np.array([0.1, -0.2, 0.3])
ENCODED = {"__numpy__": base64.b64encode(VECTOR.tobytes()).decode(), "dtype": "<f8", "shape": [3]}


@pytest.mark.parametrize(
    "reply",
    [VECTOR.tolist(), ENCODED, json.dumps(ENCODED), json.dumps(VECTOR.tolist()), [VECTOR.tolist()]],
    ids=["list", "json_numpy", "json_numpy in text", "list in text", "chunk of one"],
)
def test_an_openvla_server_is_asked_with_one_picture_and_the_instruction(reply: object, tmp_path: Path) -> None:
    asked: list[dict[str, Any]] = []

    def answer(data: bytes) -> tuple[int, bytes]:
        asked.append(json.loads(data))
        return 200, json.dumps(reply).encode()

    view = episodes.view()
    picture = np.random.default_rng(1).integers(0, 256, (48, 64, 3), np.uint8)
    with servers.posted(answer) as address:
        far = policy(tmp_path, address, view=view, unnorm_key="lift_box")
        np.testing.assert_array_equal(far.act(policies.observation(rgb=picture)), VECTOR)
    (request,) = asked
    assert request.keys() == {"image", "instruction", "unnorm_key"}
    assert (request["instruction"], request["unnorm_key"]) == ("lift box", "lift_box")
    assert (request["image"]["dtype"], request["image"]["shape"]) == ("|u1", [48, 64, 3])
    assert base64.b64decode(request["image"]["__numpy__"]) == picture.tobytes()


@pytest.mark.parametrize(
    ("status", "body", "code", "text"),
    [
        (200, b'"error"', "DXB-B542", "answered with an error: error"),
        (500, b"Internal Server Error", "DXB-B542", "HTTP status 500"),
        (422, b'{"detail": "field required"}', "DXB-B542", "field required"),
        (200, b"<html>", "DXB-B543", "is no JSON"),
        (200, b"null", "DXB-B543", "has no `actions`"),
        (200, b"[0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 1.0]", "DXB-B543", "has 7 numbers a step"),
        (200, b"[NaN, 0, 0]", "DXB-B511", "NaN"),
        (200, json.dumps(ENCODED | {"shape": [9]}).encode(), "DXB-B543", "is no array"),
        (200, json.dumps(ENCODED | {"dtype": "|O"}).encode(), "DXB-B543", "is no array"),
    ],
)
def test_every_fault_of_an_openvla_server_has_its_message(
    status: int, body: bytes, code: str, text: str, tmp_path: Path
) -> None:
    view = episodes.view()
    with servers.posted(lambda data: (status, body)) as address:
        far = policy(tmp_path, address, view=view)
        with pytest.raises(PolicyFault, match=text) as caught:
            far.act(policies.observation(rgb=np.zeros((48, 64, 3), np.uint8)))
        assert caught.value.code == code


def test_an_openvla_server_that_does_not_answer_is_left_after_its_limit(tmp_path: Path) -> None:
    def slow(data: bytes) -> tuple[int, bytes]:
        time.sleep(0.4)
        return 200, b"[0, 0, 0]"

    with servers.posted(slow) as address:
        far = policy(tmp_path, address, view=episodes.view(), first_s=0.1)
        with pytest.raises(PolicyFault, match=r"gave no answer in 0\.1 s"):
            far.act(policies.observation(rgb=np.zeros((48, 64, 3), np.uint8)))
