"""The page in 3D in a report: data until its button is pressed, then a frame in the picture's place."""

from __future__ import annotations

import asyncio
import json
import re
from pathlib import Path
from typing import Any

import pytest

from dextera_build.report import build as report
from dextera_build.report import view
from dextera_build.report.document import document
from dextera_build.report.view import View
from tests.report.fabricate import fabricate
from tests.teleop.chromium import Page, Screen, chromium
from tests.view.test_page import written

EVIL = "<script>alert(1)</script><!--<script></body>\\u003c\"'&é"


def test_a_page_is_data_that_no_text_in_it_can_end() -> None:
    made = str(view.held(View(page=EVIL)))
    inside = re.fullmatch(r'<script type="application/json" id="view">(.*)</script>', made, re.DOTALL)
    assert inside is not None
    assert json.loads(inside.group(1)) == EVIL
    assert not re.search(r"</|<!|<script", inside.group(1))
    assert view.held(View()) is None
    assert view.closer(View()) is None


def test_only_a_report_with_a_page_lets_its_player_run() -> None:
    plain, playing = document("a"), document("a", plays=True)
    assert "eval" not in plain
    assert "blob:" not in plain
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', playing)
    assert policy is not None
    assert "&#x27;unsafe-eval&#x27;" in policy.group(1)
    assert policy.group(1).startswith("default-src &#x27;none&#x27;")
    assert "http" not in policy.group(1)


def test_a_large_page_stands_beside_the_report(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(view, "MOST_BYTES", 3)
    assert view.placed("ééé", tmp_path / "r.html") == View(link="r_3d.html")
    assert (tmp_path / "r_3d.html").read_text() == "ééé"
    assert 'href="r_3d.html"' in str(view.closer(View(link="r_3d.html")))
    assert view.placed("abc", tmp_path / "small.html") == View(page="abc")
    assert [path.name for path in tmp_path.iterdir()] == ["r_3d.html"]


@pytest.mark.slow
def test_the_button_turns_the_picture_into_the_page_and_back(tmp_path: Path) -> None:
    """With keys alone, offline, and without a fault; paper shows the picture."""
    events, store = fabricate()
    page = written(tmp_path).read_text()
    bare = report.build(events, store, tmp_path / "bare.html").stat().st_size
    out = report.build(events, store, tmp_path / "r.html", view=View(page=page))
    assert out.stat().st_size < bare + 1.03 * len(page.encode()) + 2000

    async def use() -> dict[str, Any]:
        async with chromium(tmp_path, Screen(1000, 800)) as browser:
            await browser.call("Network.enable")
            await browser.call(
                "Network.emulateNetworkConditions", offline=True, latency=0, downloadThroughput=-1, uploadThroughput=-1
            )
            await browser.go(out.as_uri())
            await browser.until("!!document.getElementById('turn')", 30)
            found = {"before": await browser.run(STATE)}
            await browser.run("document.getElementById('turn').focus()")
            await _enter(browser)
            await browser.until(LOADED, 60)
            found["open"] = await browser.run(STATE)
            await browser.call("Emulation.setEmulatedMedia", media="print")
            found["print"] = await browser.run(STATE)
            await browser.call("Emulation.setEmulatedMedia", media="screen")
            await browser.run("document.getElementById('turn').focus()")  # the emulated print hid it
            await _enter(browser)
            found["after"] = await browser.run(STATE)
            found["faults"] = browser.faults
            return found

    found = asyncio.run(use())
    assert found["faults"] == []
    closed = {"picture": True, "frames": 0, "frame": False, "expanded": "false", "focus": "turn"}
    assert found["before"] == closed | {"focus": ""}
    assert found["open"] == {"picture": False, "frames": 1, "frame": True, "expanded": "true", "focus": "turn"}
    assert found["print"] == found["open"] | {"picture": True, "frame": False}
    assert found["after"] == closed


async def _enter(browser: Page) -> None:
    for kind in ("keyDown", "keyUp"):  # a button is pressed by what the key writes
        options = {"code": "Enter", "key": "Enter", "text": "\r", "windowsVirtualKeyCode": 13}
        await browser.call("Input.dispatchKeyEvent", type=kind, **options)


FRAME = "document.querySelector('#turned iframe')"
LOADED = f"!!({FRAME}?.contentWindow?.__viserMutable?.nodeRefFromName?.['/lap/lid/visual'])"
STATE = f"""(() => ({{
  picture: document.querySelector('.hero').checkVisibility(),
  frames: document.querySelectorAll('iframe').length,
  frame: !!{FRAME} && {FRAME}.checkVisibility(),
  expanded: document.getElementById('turn').getAttribute('aria-expanded'),
  focus: document.activeElement.id,
}}))()"""
