"""What a gRPC server is told of who asks."""

from __future__ import annotations

from typing import Any

import pytest

from dextera_build.errors import StoreError
from dextera_build.store import wire
from dextera_build.store.remotes import action, execution
from dextera_build.store.remotes.reapi import Reapi
from tests.store.remotes.grpc_servers import KEY, connected, scripted

CLEAR = "a secret is not sent over a connection that others can read"
NO_LIST = "`DXB_REMOTE_METADATA` is not a list of names and values"


def test_who_asks_and_for_what_is_said() -> None:
    told = list[dict[str, Any]]()

    def get(request: bytes, context: Any) -> bytes:
        told.append(dict(context.invocation_metadata()))
        return b""

    with scripted({"GetActionResult": get}) as port, connected(port) as remote:
        assert remote.get_action(KEY) == b""
    said = wire.decode(execution.RequestMetadata, told[0][action.METADATA])
    assert (said.tool_details.tool_name, said.action_id) == ("dxb", f"{KEY.hash}/{KEY.size}")
    assert "authorization" not in told[0]


def test_secrets_come_from_the_address_or_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    told = list[dict[str, Any]]()

    def get(request: bytes, context: Any) -> bytes:
        told.append(dict(context.invocation_metadata()))
        return b""

    monkeypatch.setenv("DXB_REMOTE_TOKEN", "abc")
    monkeypatch.setenv("DXB_REMOTE_METADATA", "x-team=robots,X-Site = lab ")
    with scripted({"GetActionResult": get}) as port:
        for secret in ("", "def@", "me:p%40ss@"):
            remote = Reapi(f"{secret}127.0.0.1:{port}", "", tls=False, timeout_s=10)
            remote.get_action(KEY)
            remote.close()
            assert "p%40ss" not in remote.address
    assert [header["authorization"] for header in told] == ["Bearer abc", "Bearer def", "Basic bWU6cEBzcw=="]
    assert [(header["x-team"], header["x-site"]) for header in told] == [("robots", "lab")] * 3


@pytest.mark.parametrize(
    ("variables", "tls", "code", "says"),
    [
        ({"DXB_REMOTE_TOKEN": "abc"}, False, "DXB-S220", CLEAR),
        (
            {"DXB_REMOTE_METADATA": "a=b"},
            False,
            "DXB-S220",
            CLEAR,
        ),
        ({"DXB_REMOTE_TOKEN": "a\nb"}, True, "DXB-S221", "the token holds what no header may hold"),
        ({"DXB_REMOTE_METADATA": "ab"}, True, "DXB-S221", NO_LIST),
        (
            {"DXB_REMOTE_METADATA": "a-bin=b"},
            True,
            "DXB-S221",
            NO_LIST,
        ),
        ({"DXB_REMOTE_CA": "nowhere.pem"}, True, "DXB-S222", "the file that `DXB_REMOTE_CA` names cannot be read"),
    ],
)
def test_what_the_environment_says_wrongly_is_said(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], tls: bool, code: str, says: str
) -> None:
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(StoreError) as caught:
        Reapi("cache.example.org:443", "", tls=tls, timeout_s=1)
    assert (caught.value.code, caught.value.message) == (code, says)
    assert "abc" not in str(caught.value.facts)
    assert caught.value.hint
