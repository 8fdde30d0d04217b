"""The address of a session as a QR code in the terminal: a camera reads the address and its token."""

from __future__ import annotations

import pytest

from dextera_build.teleop.live import Opened
from dextera_build.teleop.server import Server
from tests import qr_codes


@pytest.mark.parametrize("address", ["http://127.0.0.1:8012", "https://192.168.1.20:8012", "https://[fe80::1]:65535"])
def test_a_camera_reads_the_address_with_its_token(address: str) -> None:
    # A token is drawn for every session.
    for _ in range(5):
        url = f"{address}{Server('127.0.0.1').path()}"
        assert qr_codes.read("\n".join(Opened(url, "", 8012).lines())) == url


def test_a_terminal_of_eighty_columns_is_wide_enough() -> None:
    url = f"https://a-long-name.of-a-laboratory.example.org:65535{Server('127.0.0.1').path()}"
    lines = Opened(url, "", 65535).code().splitlines()
    assert max(map(len, lines)) <= 80
    assert len(lines) <= 40
