"""No user, password or query of an address is left in a text, and no secret that was hidden, however it is spelled."""

from __future__ import annotations

import base64
import json
import urllib.parse
from pathlib import Path

import pytest

from dextera_build import redact as redacting
from dextera_build.redact import hide, hide_address, redact, redact_plain


@pytest.fixture(autouse=True)
def nothing_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(redacting, "_values", {})


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("https://host:8443/x", "https://host:8443/x"),
        ("https://anna:geheim@host:8443/x", "https://***@host:8443/x"),
        ("https://geheim@host/x", "https://***@host/x"),
        ("https://a:gehe@im:d@host/x@y", "https://***@y"),
        ("https://a:gehe/im@host/x", "https://***@host/x"),
        ("https://host/x@y", "https://host/x@y"),
        ("docker://host:5000/name@sha256:00", "docker://host:5000/name@sha256:00"),
        ("https://host/x?token=geheim", "https://host/x?***"),
        ("https://host/x?sig=geheim&b=1:rw", "https://host/x?***:rw"),
        ("https://anna:ge,heim@host/?a=geheim:r", "https://***@host/?***:r"),
        (
            "local:rw,https://a:geheim@h:rw,https://b:geheim@h2?t=geheim:w",
            "local:rw,https://***@h:rw,https://***@h2?***:w",
        ),
        ("--cache=https://a:geheim@host:r", "--cache=https://***@host:r"),
        ("a:geheim@host/x", "***@host/x"),
        ("//a:geheim@host/x", "//***@host/x"),
        ("oci:/a:geheim@host/x", "oci:/***@host/x"),
        ("--from=a:geheim@host", "--from=***@host"),
        ("`https://a:geheim@host/?t=geheim` is not", "`https://***@host/?***` is not"),
        ("is it there? a@b says so: 12", "is it there? a@b says so: 12"),
        ("say/file@0007 and word[a?].x", "say/file@0007 and word[a?].x"),
        ("", ""),
    ],
)
def test_what_is_secret_in_an_address_is_not_shown(text: str, shown: str) -> None:
    assert redact(text) == shown
    assert redact(shown) == shown


ODD = "ab\"c'd\\e é/+ 0123"
"""A secret that every way of writing it changes."""


@pytest.mark.parametrize("value", ["plain-0123456", ODD, 'only "double" 1', "only 'single' 1", "line\nbreak\\'0"])
def test_a_secret_is_removed_however_it_is_spelled(value: str) -> None:
    hide("ODD", value)
    base = [base64.b64encode(f"{user}:{value}:x".encode()).decode() for user in ("a", "bc", "def")]
    url = [urllib.parse.quote(value), urllib.parse.quote(value, safe=""), urllib.parse.quote_plus(value)]
    python = [repr({"A": value}), repr({"A": f"'{value}"}), repr({"A": f'"{value}'}), repr({"A": value.encode()})]
    texts = [value, *python, ascii(value), json.dumps([value]), json.dumps([value], ensure_ascii=False), *url, *base]
    for text in texts:
        shown = redact(f"it says {text}.")
        assert "***" in shown
        for part in ("0123", "double", "single", "break", base64.b64encode(value.encode()).decode()[4:12]):
            assert part not in shown, (text, shown)


def test_secrets_are_removed_from_names_too() -> None:
    hide("KEY", "geheim-0123")
    assert redact_plain({"geheim-0123": [1.0, "a geheim-0123"]}) == {"***": [1.0, "a ***"]}


@pytest.mark.parametrize(
    "address",
    [
        "oci://usr:geheim-0123@host/x",
        "OCI://usr:geheim-0123@host/x.tar",
        "docker://usr:geheim-0123@host:5000/x",
        "oci:usr:geheim-0123@host/x",
        "oci:/usr:geheim-0123@host/x",
        "oci:///usr:geheim-0123@host/x",
        "oci-archive:usr:geheim-0123@host/x",
        "usr:geheim-0123@host/x",
        "//usr:geheim-0123@host/x",
        "./oci://usr:geheim-0123@host/x",
        "https://geheim-0123@host/x",
        "https://usr:geheim%2D0123@host/x",
        "https://host/x?token=geheim-0123",
        "https://host/x?geheim-0123",
    ],
)
def test_the_password_of_an_address_is_removed_from_the_path_it_is_taken_for(address: str) -> None:
    hide_address(address)
    for text in (address, str(Path(address)), str(Path("/tmp/x", address).with_suffix(".tar")), "token geheim-0123"):
        shown = redact(text)
        assert "geheim" not in shown


def test_what_is_no_secret_of_an_address_stays() -> None:
    hide_address("local:rw,https://host-number-1:8443/some/path?region=eu-central-1:rw,/mnt/shared/cache:r")
    assert redact("host-number-1 eu-central-1 /mnt/shared/cache") == "host-number-1 eu-central-1 /mnt/shared/cache"
