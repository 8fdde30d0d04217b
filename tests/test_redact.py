"""No user, password or query of an address is left in a text."""

from __future__ import annotations

import pytest

from dextera_build.redact import redact


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
