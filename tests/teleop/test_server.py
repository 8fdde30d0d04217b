"""The server of a session: who is let in, what is read, what is refused."""

from __future__ import annotations

import asyncio
import json
import ssl
import threading
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidStatus

from dextera_build.errors import UsageError
from dextera_build.sim.experts.live_operator import Inbox
from dextera_build.teleop import certificate, protocol, server
from dextera_build.teleop.measure import Measure
from dextera_build.teleop.server import Server
from tests.teleop import pages

Use = Callable[[str, Server, Any], Awaitable[None]]


class Session(SimpleNamespace):
    """Stands in for a simulation."""

    def __init__(self) -> None:
        super().__init__(
            inbox=Inbox(),
            measure=Measure(),
            takes=SimpleNamespace(device=""),
            heading_rad=0.0,
            twin=b"twin",
            wishes=[],
            connected=False,
            camera=False,
        )
        self.over = threading.Event()

    def start(self) -> None:
        """Nothing to run."""

    def is_alive(self) -> bool:
        return not self.over.is_set()

    def wish(self, what: str) -> None:
        self.wishes.append(what)


def served(use: Use, encryption: ssl.SSLContext | None = None) -> None:
    """Run a server, and `use` it: its address (`ws://127.0.0.1:1234/TOKEN/`), itself and its session."""

    async def both() -> None:
        made, session, listens = Server("127.0.0.1", encryption=encryption), Session(), asyncio.Event()
        found: list[int] = []

        def ready(port: int) -> None:
            found.append(port)
            listens.set()

        running = asyncio.create_task(made.serve(session, 0, ready))  # type: ignore[arg-type]
        await asyncio.wait_for(listens.wait(), 10)
        try:
            scheme = "wss" if encryption else "ws"
            await asyncio.wait_for(use(f"{scheme}://127.0.0.1:{found[0]}{made.path()}", made, session), 20)
        finally:
            session.over.set()
            await running

    asyncio.run(both())


async def status(address: str, **options: Any) -> int:
    """The status with which a request is answered that is no web socket's."""
    with pytest.raises(InvalidStatus) as caught:
        async with connect(address, **options):
            pass
    return caught.value.response.status_code


async def answered(address: str, path: bytes) -> bytes:
    """The answer to a request for a path that no client would ask for."""
    host, _, port = address.split("/")[2].partition(":")
    reader, writer = await asyncio.open_connection(host, int(port))
    rest = "Upgrade: websocket\r\nSec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\nSec-WebSocket-Version: 13\r\n\r\n"
    writer.write(b"GET " + path + f" HTTP/1.1\r\nHost: {host}:{port}\r\nConnection: Upgrade\r\n{rest}".encode())
    found = await reader.read(200)
    writer.close()
    return found


async def settled(until: Callable[[], bool]) -> None:
    for _ in range(200):
        if until():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("it never came to that")


async def flood(page: ClientConnection, period_s: float) -> None:
    """Send a message per period, or as fast as it goes, until the connection is closed."""
    for number in range(300):
        await page.send(pages.wrists(0.0, number))
        await asyncio.sleep(period_s)
    await page.recv()


def test_files_need_the_token_and_the_origin():
    async def use(address: str, made: Server, session: Session) -> None:
        root = address.removesuffix(made.path())
        assert await status(root + "/") == 404
        assert await status(root + "/wrong/") == 404
        assert await status(root + "/wrong/socket") == 404
        assert (await answered(address, b"/\xff\xfe/")).startswith(b"HTTP/1.1 404 ")
        assert await status(address) == 200
        assert await status(address + "twin") == 200
        assert await status(address + "main.js") == 200
        assert await status(address + "server.py") == 404
        assert await status(address + "..%2fserver.py") == 404
        assert await status(address + "socket", origin="https://evil.example") == 403
        port = int(root.rpartition(":")[2])
        foreign = f"ws://evil.example:{port}{made.path()}"
        assert await status(foreign, host="127.0.0.1", port=port) == 403
        assert await status(address, additional_headers={"Host": "evil.example"}) == 403
        own = address.removesuffix(made.path()).replace("ws:", "http:")
        async with connect(address + "socket", origin=own) as page:  # type: ignore[arg-type]
            await page.send(json.dumps({"ping": 3}))
            assert json.loads(await page.recv()) == {"pong": 3}

    served(use)


def test_one_operator_at_a_time_and_the_second_is_told():
    async def use(address: str, made: Server, session: Session) -> None:
        async with connect(address + "socket") as first:
            async with connect(address + "socket") as second:
                with pytest.raises(ConnectionClosed):
                    await second.recv()
                assert (second.close_code, second.close_reason) == (server.BUSY, "another operator is connected")
            await first.send(json.dumps({"ping": 1}))
            assert json.loads(await first.recv()) == {"pong": 1}
        await settled(lambda: not session.connected)
        async with connect(address + "socket") as third:
            await third.send(json.dumps({"ping": 2}))
            assert json.loads(await third.recv()) == {"pong": 2}

    served(use)


async def silent(address: str) -> asyncio.StreamWriter:
    """A web socket whose operator reads nothing, not even a ping."""
    host, _, port = address.split("/")[2].partition(":")
    _, writer = await asyncio.open_connection(host, int(port), limit=1)
    path = "/" + address.split("/", 3)[3]
    head = f"GET {path}socket HTTP/1.1\r\nHost: {host}:{port}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    writer.write(f"{head}Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode())
    return writer


def test_an_operator_that_left_without_a_word_gives_way_to_the_next(monkeypatch: pytest.MonkeyPatch):
    async def use(address: str, made: Server, session: Session) -> None:
        gone = await silent(address)
        await settled(lambda: bool(session.connected))
        made.publish(bytes(50_000))
        async with connect(address + "socket", max_size=None) as second:
            await second.send(json.dumps({"ping": 1}))
            answers = [await second.recv() for _ in range(2)]
            assert '{"pong": 1}' in answers
            assert made._operator is not None
            assert session.connected
        gone.close()
        await settled(lambda: not session.connected)

    monkeypatch.setattr(server, "ANSWER_S", 0.1)
    served(use)


def test_an_operator_that_sends_hands_keeps_its_place_without_reading(monkeypatch: pytest.MonkeyPatch):
    async def use(address: str, made: Server, session: Session) -> None:
        first = await silent(address)
        await settled(lambda: bool(session.connected))

        async def sends() -> None:
            while True:
                # A masked frame of text whose mask is 0.
                first.write(b"\x81\x80" + bytes(4))
                await asyncio.sleep(0.02)

        sending = asyncio.create_task(sends())
        async with connect(address + "socket") as second:
            with pytest.raises(ConnectionClosed):
                await second.recv()
            assert second.close_code == server.BUSY
        sending.cancel()
        first.close()

    monkeypatch.setattr(server, "ANSWER_S", 0.1)
    served(use)


def test_an_operator_that_reads_no_state_has_left(monkeypatch: pytest.MonkeyPatch):
    async def use(address: str, made: Server, session: Session) -> None:
        first = await silent(address)
        await settled(lambda: bool(session.connected))
        made.publish(bytes(30_000_000))
        await settled(lambda: not session.connected)
        first.close()

    monkeypatch.setattr(server, "STUCK_S", 0.1)
    served(use)


def test_bad_frames_are_refused_and_the_session_goes_on():
    async def use(address: str, made: Server, session: Session) -> None:
        async with connect(address + "socket") as page:
            for data, words in (
                (pages.joints(np.full((2, 25, 7), np.nan)), "not finite"),
                (pages.joints(np.zeros((2, 21, 7)), count=21), "21 joints instead of 25"),
                ("[]", "a command is a JSON object"),
                (3000 * "[", "a command is a JSON object"),
                ('{"do": "destroy"}', "a command is `do`"),
            ):
                await page.send(data)
                if isinstance(data, bytes):
                    await settled(lambda: session.inbox._message is not None)
                    assert session.inbox.take(0) is None
                assert words in json.loads(await page.recv())["refused"]
            assert made.refused == 2
            await page.send(pages.joints(pages.opened(), 9))
            await settled(lambda: session.inbox._message is not None)
            assert session.inbox.take(0).number == 9
            await page.send('{"do": "start"}')
            await page.send(json.dumps({"device": "Quest\n 3" + 300 * "x"}))
            await page.send(json.dumps({"way": [5, -1, "x", 7.5], "trip": "no"}))
            await settled(lambda: len(made.whole_way) == 2)
            assert session.wishes == ["start"]
            assert session.takes.device.startswith("Quest 3")
            assert len(session.takes.device) < 160

    served(use)


def test_a_message_that_is_too_large_closes_the_connection():
    async def use(address: str, made: Server, session: Session) -> None:
        async with connect(address + "socket") as page:
            await page.send(bytes(protocol.LARGEST + 1))
            with pytest.raises(ConnectionClosed):
                await page.recv()
            assert page.close_code == 1009

    served(use)


@pytest.mark.medium
@pytest.mark.parametrize("period_s", [0.0, 0.01])
def test_old_messages_are_dropped_and_a_flood_is_cut(monkeypatch: pytest.MonkeyPatch, period_s: float):
    async def use(address: str, made: Server, session: Session) -> None:
        async with connect(address + "socket") as page:
            for number in range(5):
                await page.send(pages.joints(pages.opened(), number))
            await page.send('{"ping": 1}')
            await page.recv()
            assert session.inbox.dropped == 4
            assert session.inbox.take(0).number == 4
            with pytest.raises(ConnectionClosed):
                await flood(page, period_s)
            assert page.close_code == server.RATE

    monkeypatch.setattr(server, "MOST_HZ", 20.0)
    monkeypatch.setattr(server, "BURST", 30.0)
    served(use)


@pytest.mark.parametrize("rate_hz", [300, 1_000, 20_000])
def test_a_flood_that_lasts_ends_at_any_rate(rate_hz: int):
    allowance, now, sent = server.Allowance(), time.perf_counter(), 0
    while allowance.excess <= server.MOST_HZ:
        sent += 1
        allowance.spend(now + sent / rate_hz)
        assert sent < 10 * rate_hz
    assert sent > server.BURST + server.MOST_HZ


def test_what_waited_in_the_network_comes_at_once_and_is_no_flood():
    allowance, now = server.Allowance(), time.perf_counter()
    for number in range(120 * 60):
        # A headset with 120 Hz; the messages of every other second arrive at its end.
        second, part = divmod(number, 120)
        allowance.spend(now + second + (part / 120 if second % 2 else 1.0))
        assert allowance.excess < server.MOST_HZ / 2


def test_a_state_reaches_the_operator_and_an_unsent_one_is_replaced():
    async def use(address: str, made: Server, session: Session) -> None:
        made.publish(b"0")
        async with connect(address + "socket") as page:
            assert await page.recv() == b"0"
            for text in (b"1", b"2", b"3"):
                made.publish(text)
            assert await page.recv() == b"3"

    served(use)


def test_a_certificate_of_its_own_is_kept_and_a_page_that_does_not_trust_it_is_refused(tmp_path: Path):
    files = certificate.own(tmp_path, "127.0.0.1")
    before = certificate.fingerprint(files[0])
    assert certificate.fingerprint(certificate.own(tmp_path, "127.0.0.1")[0]) == before
    assert len(before.split(":")) == 32
    assert files[1].stat().st_mode & 0o077 == 0

    async def use(address: str, made: Server, session: Session) -> None:
        trusting = ssl.create_default_context(cafile=str(files[0]))
        async with connect(address + "socket", ssl=trusting) as page:
            await page.send('{"ping": 1}')
            assert json.loads(await page.recv()) == {"pong": 1}
        with pytest.raises(ssl.SSLCertVerificationError):
            async with connect(address + "socket", ssl=ssl.create_default_context()):
                pass

    served(use, certificate.context(*files))


def test_a_certificate_that_is_none_is_refused(tmp_path: Path):
    (tmp_path / "a").write_text("no certificate")
    with pytest.raises(UsageError, match="are no certificate and its key") as caught:
        certificate.context(tmp_path / "a", tmp_path / "b")
    assert caught.value.code == "DXB-U331"


def test_a_port_in_use_is_told():
    async def use(address: str, made: Server, session: Session) -> None:
        port = int(address.split(":")[2].split("/")[0])
        with pytest.raises(UsageError, match=f"cannot listen on `127.0.0.1` port {port}"):
            await Server("127.0.0.1").serve(session, port, print)  # type: ignore[arg-type]

    served(use)
