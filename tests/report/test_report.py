"""The report as a whole: one valid offline file, escaped, complete, from any log, within its size."""

from __future__ import annotations

import base64
import io
import json
import re
import zlib
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Pillow

from dextera_build.artifacts.cameras.image import Image, png
from dextera_build.artifacts.scenes.scene import Settled, SettleReport
from dextera_build.artifacts.table import Column, Table
from dextera_build.report import build as report
from dextera_build.report import result, sources
from dextera_build.report.run import Node, Run
from dextera_build.runs.events import NodeFinished, RunFinished, RunStarted
from dextera_build.store.entry import ActionResult
from dextera_build.store.store import Store
from tests.report.fabricate import FakeStore, Spec, as_dicts, body, fabricate, specs

VOID = {"br", "col", "hr", "img", "input", "link", "meta"}
EVIL = "<script>alert(1)</script>\"'&"


class Page(HTMLParser):
    """Checks nesting while it reads, and collects what tests ask for."""

    def __init__(self, text: str) -> None:
        super().__init__(convert_charrefs=True)
        self.stack: list[str] = []
        self.tags: list[tuple[str, dict[str, str]]] = []
        self.words: dict[str, list[str]] = {}
        self.feed(text)
        self.close()
        assert self.stack == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len({name for name, _ in attrs}) == len(attrs)
        self.tags.append((tag, {name: value or "" for name, value in attrs}))
        if tag not in VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.stack.pop() == tag

    def handle_data(self, data: str) -> None:
        self.words.setdefault(self.stack[-1] if self.stack else "", []).append(data)

    def all(self, tag: str) -> list[dict[str, str]]:
        return [attributes for name, attributes in self.tags if name == tag]

    @property
    def ids(self) -> list[str]:
        return [attributes["id"] for _, attributes in self.tags if "id" in attributes]


def make(tmp_path: Path, mode: str = "mixed", **more: Any) -> tuple[str, Page]:
    events, store = fabricate(mode, **more)
    out = report.build(events, store, tmp_path / "report.html")
    text = out.read_text()
    return text, Page(text)


@pytest.mark.medium
@pytest.mark.parametrize("mode", ["mixed", "cached", "cold", "failed"])
def test_the_page_is_one_valid_offline_file(tmp_path: Path, mode: str) -> None:
    text, page = make(tmp_path, mode)
    assert max(Counter(page.ids).values()) == 1
    assert "http:" not in text
    assert "https:" not in text
    assert not re.search(r"(src|href)=\"(?!data:|#)", text)
    assert "url(" not in text
    assert "@import" not in text
    for image in page.all("img"):
        assert image["alt"]
    for link in page.all("a"):
        assert link["href"].removeprefix("#") in page.ids
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_what_the_page_holds(tmp_path: Path) -> None:
    text, page = make(tmp_path)
    for words in (
        "twin/laptop_scene",
        "✓ built",
        "2025-10-09 08:53 UTC",
        "24 ran, 11 cached, 3 fetched",
        "settles in 0.4 s, penetration 0.1 mm",
        "Objects against the reference world",
        "boundary F1 with a tolerance of 2 px",
        "✓ passed",
        "1 hinge, 0–131°",
        "Critical path",
        "open3d",
        "dxb build twin/laptop_scene --profile cpu",
    ):
        assert words in text
    assert sum(a.get("class") == "node" for a in page.all("details")) == 38
    assert page.words["h2"] == [
        "Result",
        "Figures",
        "Objects",
        "Numbers",
        "Graph",
        "Timeline",
        "Nodes",
        "Provenance",
        "Make it again",
    ]


def test_the_picture_at_the_top_is_the_image_among_the_results(tmp_path: Path) -> None:
    _, page = make(tmp_path)
    first = page.all("img")[0]
    assert first["alt"] == "the twin's outlines on the photograph of overlay"
    assert int(first["width"]) == 960


@pytest.mark.medium
def test_cached_nodes_keep_their_pictures_lines_and_numbers(tmp_path: Path) -> None:
    text, page = make(tmp_path, "cached")
    cold, _ = make(tmp_path, "cold")
    assert "Nothing ran: every result came from the store." in text
    assert text.count("data:image/webp") == cold.count("data:image/webp") > 20
    assert "revolved, hollow, closed, 4.2 k triangles" in text
    assert "saved 6.0 s" in text
    assert len(page.all("article")) == 4


def test_a_failure_stands_first_with_its_facts_and_what_waits(tmp_path: Path) -> None:
    text, page = make(tmp_path, "failed")
    assert page.words["h2"][0] == "What failed"
    top = text[: text.index('id="result-title"')]
    for words in ("DXB-B201", "214 open edges, 0 allowed", "3,182", "<code>voxel_m</code> to 0.004", "11 nodes wait"):
        assert words in top
    assert "✗ failed" in top


def test_everything_that_a_user_can_name_is_escaped(tmp_path: Path) -> None:
    nodes = [
        Spec(
            EVIL,
            f"s.{EVIL}",
            EVIL,
            1.0,
            EVIL,
            [],
            "Table",
            ["photo"],
            {EVIL: (1.0, EVIL)},
            {EVIL: EVIL},
            {
                "title": EVIL,
                "columns": [{"$value": {"name": EVIL, "unit": EVIL, "digits": 3, "better": EVIL}}],
                "rows": [[EVIL]],
                "notes": [EVIL],
            },
        ),
        *body("laptop", 0)[:1],
    ]
    nodes[1].needs = [EVIL]
    events, store = fabricate("cold", nodes=nodes)
    raw = [
        {k: (EVIL if k in ("recipe", "run", "profile", "dxb") else v) for k, v in e.items()} for e in as_dicts(events)
    ]
    raw[0]["argv"] = [EVIL]
    text = report.build(raw, store, tmp_path / "r.html", licences={"numpy": EVIL}).read_text()
    page = Page(text)
    assert "<script>alert" not in text
    assert len(page.all("script")) == 1
    assert text.count("&lt;script&gt;alert(1)&lt;/script&gt;") > 20


def test_an_error_with_markup_is_escaped(tmp_path: Path) -> None:
    events = as_dicts(fabricate("failed")[0])
    for event in events:
        if event.get("error"):
            event["error"] = {"message": EVIL, "code": EVIL, "hint": EVIL, "facts": {EVIL: EVIL}, "where": [EVIL, 1, 0]}
    text = report.build(events, fabricate("failed")[1], tmp_path / "r.html").read_text()
    Page(text)
    assert "<script>alert" not in text


@pytest.mark.medium
def test_events_and_their_lines_give_the_same_page(tmp_path: Path) -> None:
    events, store = fabricate("mixed")
    read = [json.loads(event.to_line()) for event in events]
    a = report.build(events, store, tmp_path / "a.html").read_bytes()
    assert report.build(read, store, tmp_path / "b.html").read_bytes() == a


@pytest.mark.medium
def test_a_log_that_ends_in_the_middle(tmp_path: Path) -> None:
    events, store = fabricate("cold")
    names = [event.kind for event in events]
    cut = len(names) - 1 - names[::-1].index("node_started")
    text = report.build(events[: cut + 1], store, tmp_path / "r.html").read_text()
    Page(text)
    assert "- stopped" in text
    assert re.search(r"[12] cancelled</dd>", text)


def test_an_empty_log(tmp_path: Path) -> None:
    text = report.build([], FakeStore(), tmp_path / "r.html").read_text()
    Page(text)
    assert "The event log of this run holds no nodes." in text


def test_a_store_that_lost_everything_still_gives_the_log(tmp_path: Path) -> None:
    events, _ = fabricate("cold")
    text = report.build(events, FakeStore(), tmp_path / "r.html").read_text()
    page = Page(text)
    assert page.all("img") == []
    assert "4 bodies, 1 hinge, 2.31 kg" in text


@pytest.mark.parametrize("kind", ["cut", "postscript", "large"])
def test_a_blob_that_is_no_picture_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str) -> None:
    """Nor is it given to a program: Pillow's reader of PostScript starts Ghostscript."""
    eps = b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 8 6\n%%EndComments\n"
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *_: pytest.fail("Ghostscript was started"))
    events, store = fabricate("cold")
    for name, data in store.blobs.data.items():
        if data.startswith(b"\x89PNG"):
            large = data[:16] + (30_000).to_bytes(4, "big") * 2 + data[24:]
            large = large[:29] + zlib.crc32(large[12:29]).to_bytes(4, "big") + large[33:]
            store.blobs.data[name] = {"cut": data[:200], "postscript": eps, "large": large}[kind]
    assert Page(report.build(events, store, tmp_path / "r.html").read_text()).all("img") == []


@pytest.mark.slow
def test_the_limit_is_kept_by_coarser_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    full = len(make(tmp_path)[0].encode())
    monkeypatch.setattr(report, "LIMIT", full * 2 // 3)
    text, page = make(tmp_path)
    assert len(text.encode()) <= full * 2 // 3
    assert len(page.all("img")) > 20


@pytest.mark.slow
def test_large_noisy_pictures_of_many_objects_stay_below_five_megabytes(tmp_path: Path) -> None:
    events, store = fabricate("cold")
    noise = np.random.default_rng(0).integers(0, 256, (540, 960, 3), dtype=np.uint8)
    for number, (name, data) in enumerate(list(store.blobs.data.items())):
        if data.startswith(b"\x89PNG"):
            store.blobs.data[name] = png(np.roll(noise, number * 7, axis=0))
    out = report.build(events, store, tmp_path / "r.html")
    assert out.stat().st_size < 5_000_000
    assert "<img" in out.read_text()


def test_many_copies_are_folded_in_the_graph_and_listed_below(tmp_path: Path) -> None:
    nodes = specs()[:4] + [spec for i in range(30) for spec in body(f"thing_{i}", 1)]
    for spec in nodes:
        spec.pictures = []
    text, page = make(tmp_path, "cold", nodes=nodes)
    assert "14 more copies are not drawn" in text
    assert sum(a.get("class") == "node" for a in page.all("details")) == 4 + 30 * 7


@pytest.mark.medium
def test_only_known_licences_are_shown(tmp_path: Path) -> None:
    events, store = fabricate("cold")
    plain = report.build(events, store, tmp_path / "a.html").read_text()
    known = {"factorize.mesh:primitives": "Apache-2.0", "open3d": "MIT"}
    text = report.build(events, store, tmp_path / "b.html", licences=known).read_text()
    assert "licence" not in plain
    assert "MIT" in text
    assert "Apache-2.0" in text


def test_real_artifacts_in_a_real_store(tmp_path: Path) -> None:
    store = Store(tmp_path / "cache")
    pixels = np.zeros((40, 60, 3), np.uint8)
    pixels[:, :30] = (200, 30, 30)
    table = Table(
        title="Sizes",
        columns=(Column(name="object"), Column(name="height", unit="mm", digits=1, better="lower")),
        rows=(("box", 212.04), ("mug", None)),
        notes=("measured with a caliper",),
    )
    one = Settled(name="box", drift_m=0.00042, tilt_rad=0.001, penetration_m=0.0, resting=True)
    settled = SettleReport(bodies=(one,), seconds=2.0, energy_j=np.zeros(3), passed=False)
    values = {"overlay": Image(pixels=pixels), "sizes": table, "settle": settled}
    events: list[Any] = [RunStarted(0.0, "0001", "twin/x", ["overlay"], "cpu", "0.1", 3, 0)]
    for number, (node, value) in enumerate(values.items()):
        output = value.encode(store.blobs.put)
        key = store.blobs.put(b'{"rule": "a.b", "version": 3, "options": {"voxel_m": 0.002}, "salt": "%d"}' % number)
        log = store.blobs.put(b"hello from the log\n")
        store.actions.put(key, ActionResult(output, f"said {node}", (), {"n": (2.0, "mm")}, 1.5, log, key))
        events.append(NodeFinished(1.0, node, "a.b", None, "cached", key, output, 0.0))
    events.append(RunFinished(1.0, True, 1.0, {"cached": 3}, 4.5))
    text = report.build(events, store, tmp_path / "r.html").read_text()
    page = Page(text)
    for words in ("Sizes", "212.0", "measured with a caliper", "✗ did not pass", "0.00042", "hello from the log"):
        assert words in text
    image = page.all("img")[0]
    with Pillow.open(io.BytesIO(base64.b64decode(image["src"].partition(",")[2]))) as shown:
        assert shown.size == (60, 40)
        red, green, _ = shown.convert("RGB").getpixel((10, 20))  # type: ignore[misc]
    assert red > 150 > green


def test_the_title_says_what_assets_were_made_from_and_warns_of_an_unknown_scale():
    def node(number: int, artifact: str, **fields: str) -> Node:
        made = Node(number, f"n{number}", "a.b", None, "ran", None, None, 0.0, 1.0)
        made.artifact, made.fields = artifact, fields
        return made

    assets = [node(1, "Asset", asset_source="rgb"), node(2, "Asset", asset_source="rgbd")]
    known = result.title(Run(nodes=[*assets, node(3, "Scene", scale="size")]))
    assert "<dt>assets made from</dt><dd>rgb and rgbd</dd>" in known
    assert "scale unknown" not in known
    unknown = result.title(Run(nodes=[assets[0], node(3, "Scene", scale="unknown")]))
    assert '<span class="verdict warn">scale unknown</span>' in unknown
    assert "<dt>assets made from</dt><dd>rgb</dd>" in unknown
    assert "assets made from" not in result.title(Run())


def test_the_title_counts_the_warnings_of_rules():
    def node(number: int, line: str) -> Node:
        return Node(number, f"n{number}", "a.b", None, "ran", None, None, 0.0, 1.0, line=line)

    doubted = result.title(Run(nodes=[node(1, "well; warning: one; warning: two"), node(2, "warning: three")]))
    assert '<span class="verdict warn">3 warnings</span>' in doubted
    assert "warning" not in result.title(Run(nodes=[node(1, "well")]))


def test_the_version_of_a_type_is_not_part_of_its_name():
    store = FakeStore()
    stored = store.blobs.put(json.dumps({"artifact": "Scene@3", "fields": {"scale": "unknown"}}).encode())
    assert sources.header(store, stored) == ("Scene", {"scale": "unknown"})
