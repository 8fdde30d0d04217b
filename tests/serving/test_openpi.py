"""The client of openpi asks a policy that dxb serves; json_numpy reads what dxb sends to OpenVLA's server."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from dextera_build.policy.wire.codec import pack
from dextera_build.policy.wire.posted import Posted
from tests import episodes, readers
from tests.policy import policies
from tests.serving import servers

pytestmark = pytest.mark.slow

BUNDLE = episodes.bundle()


def test_the_client_of_openpi_gets_what_the_policy_gives(tmp_path: Path) -> None:
    trained = policies.checkpoint(policies.contract(BUNDLE))
    served = servers.served(trained, BUNDLE)
    local = served.policy()
    seen = [policies.observation(step) for step in range(5)]
    asked, posted = tmp_path / "asked", tmp_path / "posted"
    asked.write_bytes(pack([{name: one[name] for name in policies.INPUTS} for one in seen]))
    picture = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    answers: list[bytes] = [b"[0.0]"]

    def openvla(data: bytes) -> tuple[int, bytes]:
        posted.write_bytes(data)
        return 200, answers[0]

    with servers.posted(openvla) as address:
        Posted(address).ask({"image": picture, "instruction": "lift box"}, 5.0)
    with servers.running(served, key="sesame-1") as address:
        peer = Path(__file__).with_name("openpi_peer.py")
        said = json.loads(readers.run("openpi", peer, address, "sesame-1", asked, posted))
    assert said["numpy"].startswith("1.")
    np.testing.assert_array_equal(said["chunks"], [local.chunk(one) for one in seen])
    assert "a request lacks" in said["refused"]
    assert said["image"] == [picture.tolist(), "uint8"]
    # What json_numpy writes, as FastAPI sends it: as a map, or as text in JSON if the request was.
    for reply in (said["reply"], json.dumps(said["reply"])):
        answers[0] = reply.encode()
        with servers.posted(openvla) as address:
            np.testing.assert_array_equal(Posted(address).ask({}, 5.0)["actions"], [0.1, -0.2, 0.3])
