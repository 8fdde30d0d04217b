"""An object store without a server: its settings, and the errors if it cannot be reached."""

from __future__ import annotations

import socket

import pytest

from dextera_build.errors import UsageError
from dextera_build.remotes.remote import RemoteFault
from dextera_build.remotes.spec import Spec, guarded, open_remote

KEY = "0" * 64


@pytest.fixture
def nowhere(monkeypatch: pytest.MonkeyPatch) -> str:
    """A local address without a server."""
    for name in ("HTTP_PROXY", "http_proxy", "ALL_PROXY", "all_proxy"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "anyone")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"http://127.0.0.1:{free.getsockname()[1]}"


def bucket(endpoint: str, **more: str) -> Spec:
    return Spec("lab", "s3://twins/dxb", "rw", options={"endpoint": endpoint, "region": "us-east-1", **more})


@pytest.mark.parametrize(
    "more", [{}, {"allow_http": "true"}, {"user_agent": "me", "timeout": "5s"}, {"http1_only": "true"}]
)
def test_a_server_that_is_away_is_said_without_the_request(nowhere: str, more: dict[str, str]) -> None:
    remote = open_remote(bucket(nowhere, **more))
    with pytest.raises(RemoteFault) as caught:
        remote.get_entry(KEY)
    assert caught.value.reason == "HTTP error: error sending request: Connection refused"
    remote.close()


def test_a_setting_that_is_none_is_named(nowhere: str) -> None:
    with pytest.raises(UsageError) as caught:
        open_remote(bucket(nowhere, aws_regoin="x"))
    assert "aws_regoin" in caught.value.facts["because"]
    remote = guarded(bucket(nowhere, aws_regoin="x"))
    with pytest.raises(RemoteFault, match="aws_regoin"):
        remote.get_entry(KEY)


@pytest.mark.parametrize("more", [{}, {"allow_http": "true"}])
def test_credentials_do_not_go_to_another_machine_in_the_clear(monkeypatch, nowhere: str, more: dict[str, str]) -> None:
    with pytest.raises(UsageError) as caught:
        open_remote(bucket("http://minio.lab:9000", **more))
    assert caught.value.code == "DXB-U137"
    # An address from the environment is not visible here, so it must use TLS, whatever else is set.
    for name, value in (("AWS_ENDPOINT_URL", nowhere), ("AWS_ALLOW_HTTP", "true")):
        monkeypatch.setenv(name, value)
    remote = open_remote(Spec("lab", "s3://twins/dxb", "rw", options={"region": "us-east-1", **more}))
    with pytest.raises(RemoteFault, match="builder error"):
        remote.get_entry(KEY)
