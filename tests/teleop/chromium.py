"""A page in headless Chromium, driven by its debugging protocol (https://chromedevtools.github.io/devtools-protocol)."""

from __future__ import annotations

import asyncio
import base64
import json
import re
import shutil
import signal
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, NamedTuple

from websockets.asyncio.client import ClientConnection, connect

FLAGS = (
    *("--headless=new", "--no-sandbox", "--remote-debugging-port=0", "--no-first-run", "--mute-audio"),
    *("--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"),
    *("--disable-background-timer-throttling", "--disable-renderer-backgrounding", "--ignore-certificate-errors"),
)


class Screen(NamedTuple):
    """The screen of a page."""

    width: int
    height: int
    touch: bool = False
    """Whether it is that of a phone, with fingers in place of a mouse."""


DESKTOP = Screen(480, 300)


class Page:
    """One page."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket, self._number, self._session = socket, 0, ""
        self.faults: list[str] = []
        """Exceptions that nobody caught, and errors on the console."""

    async def open(self, screen: Screen, script: str = "") -> None:
        """An empty page, in which a script runs before those of every document."""
        target = await self.call("Target.createTarget", url="about:blank")
        attached = await self.call("Target.attachToTarget", targetId=target["targetId"], flatten=True)
        self._session = attached["sessionId"]
        await self.call("Runtime.enable")
        await self.call("Page.enable")
        size = {"width": screen.width, "height": screen.height, "deviceScaleFactor": 1, "mobile": screen.touch}
        await self.call("Emulation.setDeviceMetricsOverride", **size)
        if screen.touch:
            await self.call("Emulation.setTouchEmulationEnabled", enabled=True, maxTouchPoints=2)
        if script:
            await self.call("Page.addScriptToEvaluateOnNewDocument", source=script)

    async def go(self, address: str) -> None:
        """Open an address."""
        await self.call("Page.navigate", url=address)

    async def run(self, script: str) -> Any:
        """The value of an expression, awaited if it is a promise."""
        found = await self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in found:
            raise AssertionError(found["exceptionDetails"])
        return found["result"].get("value")

    async def until(self, script: str, seconds: float = 60.0) -> Any:
        """The value of an expression once it is true."""
        for _ in range(round(seconds / 0.1)):
            value = await self.run(script)
            if value:
                return value
            await asyncio.sleep(0.1)
        raise AssertionError(f"never true: {script}; {self.faults}")

    async def key(self, code: str, *kinds: str) -> None:
        """Press (`keyDown`) and release (`keyUp`) a key; both without `kinds`."""
        for kind in kinds or ("keyDown", "keyUp"):
            await self.call("Input.dispatchKeyEvent", type=kind, code=code, key=code)

    async def touch(self, kind: str, *fingers: tuple[float, float]) -> None:
        """Fingers at places on the screen [pixel]: `touchStart`, `touchMove`, or `touchEnd` without fingers."""
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        await self.call("Input.dispatchTouchEvent", type=kind, touchPoints=points)

    async def picture(self, path: Path) -> None:
        """Write a picture of the page."""
        found = await self.call("Page.captureScreenshot", format="png")
        path.write_bytes(base64.b64decode(found["data"]))

    async def call(self, method: str, **options: Any) -> dict[str, Any]:
        """Call a method of the protocol."""
        self._number += 1
        number = self._number
        words = {"id": number, "method": method, "params": options}
        await self._socket.send(json.dumps(words | ({"sessionId": self._session} if self._session else {})))
        while True:
            answer = json.loads(await asyncio.wait_for(self._socket.recv(), 120))
            if answer.get("method") == "Runtime.exceptionThrown":
                self.faults.append(json.dumps(answer["params"]["exceptionDetails"])[:600])
            if answer.get("method") == "Runtime.consoleAPICalled" and answer["params"]["type"] == "error":
                self.faults.append(json.dumps(answer["params"]["args"])[:600])
            if answer.get("id") == number:
                if "error" in answer:
                    raise AssertionError(f"{method}: {answer['error']}")
                return answer["result"]


@asynccontextmanager
async def chromium(folder: Path, screen: Screen = DESKTOP, script: str = "") -> AsyncIterator[Page]:
    """A browser with an empty profile below `folder`, and a page in it."""
    program = shutil.which("chromium")
    assert program, "`.ci/system browser` installs Chromium"
    process = await asyncio.create_subprocess_exec(
        program,
        *FLAGS,
        f"--user-data-dir={folder / 'profile'}",
        stdout=asyncio.subprocess.DEVNULL,
        stderr=asyncio.subprocess.PIPE,
        start_new_session=True,
    )
    try:
        assert process.stderr
        while not (found := re.search(r"DevTools listening on (\S+)", (await process.stderr.readline()).decode())):
            assert process.returncode is None
        async with connect(found.group(1), max_size=None, compression=None) as socket:
            page = Page(socket)
            await page.open(screen, script)
            yield page
    finally:
        process.send_signal(signal.SIGTERM)
        await process.wait()
