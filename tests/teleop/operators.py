"""An operator for tests and benchmarks: a program that sends the hands of a recording to a session, in real time."""

from __future__ import annotations

import asyncio
import json
import struct
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
from websockets.asyncio.client import ClientConnection

from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.teleop import protocol


def frames(stream: HandStream, first: int, last: int) -> Iterator[tuple[float, bytes]]:
    """Time after the first message [s], and the frame, of messages `first` to `last` - 1 of a stream in the base."""
    for row in range(first, last):
        hand = np.concatenate([stream.positions[row], stream.rotations[row][..., [1, 2, 3, 0]]], axis=-1)
        head = np.full(7, np.nan)
        if stream.head is not None:
            head = stream.head[row, [0, 1, 2, 4, 5, 6, 3]].astype(np.float64)
        facts = (*stream.tracking[row].tolist(), *map(int, stream.clutch[row]), *stream.pinch[row].tolist())
        begin = protocol.HEAD.pack(row, protocol.JOINTS, 25, protocol.BASE, 0.0, *facts, *head.tolist())
        yield float(stream.stamps[row] - stream.stamps[first]), begin + hand.astype("<f4").tobytes()


def opened(stream: HandStream, number: int, seconds: float = 2.4, way_s: float = 1.0) -> tuple[int, int]:
    """First and last message of open hands before a take: `way_s` before it they go to its first posture."""
    begin = stream.stamps[stream.takes[number].first] - way_s
    first, last = np.searchsorted(stream.stamps, [begin - seconds, begin])
    return int(first), int(last)


class Operator:
    """Demonstrates takes over a connection.

    Args:
        page: The connection to a session.
        stream: Hands in the robot's base, with seconds of open hands before every take.
        speed: That of the session.
    """

    def __init__(self, page: ClientConnection, stream: HandStream, speed: float = 1.0) -> None:
        self._page, self._stream, self._speed = page, stream, speed
        self.facts: dict[str, Any] = {}
        """The last state of the session."""
        self.told: list[str] = []
        """What the session told, in order, without repetitions."""

    async def watch(self) -> None:
        """Read states until the session closes the connection."""
        async for data in self._page:
            if isinstance(data, bytes):
                (length,) = struct.unpack_from("<I", data)
                self.facts = json.loads(data[4 : 4 + length])
                if self.facts["told"] not in self.told[-1:]:
                    self.told.append(self.facts["told"])

    async def take(self, number: int) -> None:
        """Hold the hands open, start, and move them as in a take of the stream; return when it is over."""
        take, kept = self._stream.takes[number], self.facts["kept"]
        still = await self._send(*opened(self._stream, number), speed=1.0)
        for _ in range(100):
            if self.facts["phase"] != "ready":
                break
            await self._page.send(still)
            await self._page.send(json.dumps({"do": "start"}))
            await asyncio.sleep(0.1)
        assert self.facts["phase"] == "waiting", self.facts
        last = await self._send(take.first, take.last, speed=self._speed, kept=kept)
        while self.facts["phase"] != "ready":
            await self._page.send(json.dumps({"do": "finish"}))
            await self._page.send(last)
            await asyncio.sleep(0.1)

    async def _send(self, first: int, last: int, *, speed: float, kept: int | None = None) -> bytes:
        """Send messages in their time, until a take is kept beyond `kept`; the last one."""
        began, frame = time.perf_counter(), b""
        for due, frame in frames(self._stream, first, last):
            await asyncio.sleep(max(0.0, began + due / speed - time.perf_counter()))
            await self._page.send(frame)
            if kept is not None and self.facts["kept"] > kept:
                break
        return frame
