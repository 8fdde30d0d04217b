"""A run as the engine would record it, made up: forty nodes, four objects, pictures drawn with Pillow."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field

from dextera_build import digest
from dextera_build.errors import RuleError
from dextera_build.runs.events import (
    Event,
    GroupOpened,
    NodeFinished,
    NodeLog,
    NodeProgress,
    NodeStarted,
    RunFinished,
    RunStarted,
)
from tests.report.drawings import LABELS, masks, scene

START = 1_760_000_000.0


@dataclass
class Result:
    """What the action cache knows of one node."""

    output: str
    line: str
    previews: tuple[tuple[str, str], ...]
    metrics: dict[str, tuple[float, str]]
    seconds: float
    log: str
    key_document: str


class Blobs:
    """Digest -> bytes in memory."""

    def __init__(self) -> None:
        self.data: dict[str, bytes] = {}

    def put(self, data: bytes) -> str:
        name = digest.of_bytes(data)
        self.data[name] = data
        return name

    def get(self, name: str) -> bytes:
        return self.data[name]


@dataclass
class Actions:
    """Key -> result in memory."""

    data: dict[str, Result] = field(default_factory=dict)

    def known(self, key: str) -> Result | None:
        return self.data.get(key)


@dataclass
class FakeStore:
    """The two members of a store that the report reads."""

    blobs: Blobs = field(default_factory=Blobs)
    actions: Actions = field(default_factory=Actions)


@dataclass
class Spec:
    """One node to make up."""

    node: str
    rule: str
    backend: str | None
    seconds: float
    line: str
    needs: list[str]
    artifact: str
    pictures: list[str] = field(default_factory=list)
    metrics: dict[str, tuple[float, str]] = field(default_factory=dict)
    options: dict[str, object] = field(default_factory=dict)
    fields: dict[str, object] = field(default_factory=dict)


def specs() -> list[Spec]:
    """The nodes of a twin, in the order in which they finish."""
    root = [
        Spec("capture", "capture.folder", None, 0.42, "960 × 540, depth 98 % valid", [], "Capture", ["photo", "depth"]),
        Spec("support", "align.support", "cpu", 1.31, "plane, 0.8 mm residual", ["capture"], "Support", ["support"]),
        Spec("elements", "factorize.parse", "proposed", 0.22, "4 objects proposed", ["capture", "support"], "Elements"),
        Spec(
            "objects",
            "factorize.segment",
            "cpu",
            3.84,
            "laptop, blue_mug, box, gray_bowl",
            ["capture", "support", "elements"],
            "Segmentation",
            ["masks"],
            {"coverage": (0.973, "")},
        ),
        Spec("background", "background.static", "cpu", 4.2, "1 box, 41 k triangles", ["objects"], "Background"),
    ]
    for number, label in enumerate(LABELS):
        root += body(label, number)
    assets = [f"body[{label}].asset" for label in LABELS]
    root += [
        Spec("scene", "simulate.scene", None, 0.9, "4 bodies, 1 hinge, 2.31 kg", [*assets, "background"], "Scene"),
        Spec("usd", "simulate.usd", None, 0.61, "validates", [*assets, "background"], "Folder"),
        Spec(
            "settle",
            "simulate.settle",
            "cpu",
            2.7,
            "settles in 0.4 s, penetration 0.1 mm",
            ["scene"],
            "SettleReport",
            ["settled"],
            {"drift_max": (0.7, "mm"), "penetration_max": (0.1, "mm"), "energy_end": (2.1e-7, "J")},
            {"seconds": 2.0},
            settle_fields(),
        ),
        Spec("overlay", "evaluate.overlay", "cpu", 1.1, "mask IoU 0.94", ["capture", "scene"], "Image", ["overlay"]),
        Spec("accuracy", "evaluate.objects", None, 1.9, "4 of 4 found", assets, "Table", [], {}, {}, accuracy_fields()),
    ]
    return root


def body(label: str, number: int) -> list[Spec]:
    """The chain of one object."""

    def at(call: str) -> str:
        return f"body[{label}].{call}"

    kind = {"laptop": "two plates", "blue_mug": "revolved, hollow", "box": "box", "gray_bowl": "revolved, hollow"}
    return [
        Spec(
            at("mesh"),
            "factorize.mesh",
            "primitives",
            6.0 + 3 * number,
            f"{kind.get(label, 'box')}, closed, {3 + number}.2 k triangles",
            ["objects"],
            "Shape",
            ["seen", "mesh"],
            {"residual": (0.9 + 0.2 * number, "mm"), "mask_iou": (0.97 - 0.01 * number, ""), "unseen": (0.52, "")},
            {"voxel_m": 0.002, "hypotheses": ["box", "cylinder", "revolved", "extruded", "mirrored"]},
        ),
        Spec(
            at("parts"),
            "factorize.articulate",
            "cpu",
            1.4,
            "1 hinge, 0–131°" if label == "laptop" else "rigid",
            [at("mesh"), "objects"],
            "Body",
            ["parts"] if label == "laptop" else [],
        ),
        Spec(
            at("mass"),
            "factorize.physics",
            None,
            0.1,
            "0.31 kg (0.22–0.41)",
            [at("parts"), "objects"],
            "Physics",
            [],
            {"mass": (0.31 + 0.2 * number, "kg"), "friction": (0.6, "")},
        ),
        Spec(at("pieces"), "factorize.collision", "coacd", 4.4, f"{6 + number} pieces", [at("parts")], "Collision"),
        Spec(at("placed"), "align.object", "cpu", 2.2, "0.8 mm, overlap 0.96", [at("parts")], "Placement", ["placed"]),
        Spec(
            at("asset"),
            "simulate.asset",
            None,
            0.3,
            "scaled 1.004",
            [at("parts"), at("mass"), at("pieces"), at("placed")],
            "Asset",
            ["asset"],
        ),
        Spec(at("urdf"), "simulate.urdf", None, 0.2, "2 links, 1 joint", [at("asset")], "Folder"),
    ]


def settle_fields() -> dict[str, object]:
    """Fields of a SettleReport header."""
    rows = [{"name": n, "drift_m": 0.0004, "tilt_rad": 0.002, "penetration_m": 0.0001, "resting": True} for n in LABELS]
    return {"bodies": [{"$value": row} for row in rows], "seconds": 2.0, "passed": True}


def accuracy_fields() -> dict[str, object]:
    """Fields of a Table header."""

    def column(name: str, unit: str = "", digits: int = 3, better: str = "") -> dict[str, object]:
        return {"$value": {"name": name, "unit": unit, "digits": digits, "better": better}}

    rows = [[n, 0.95 - i * 0.01, 0.61, 4.1 + i, 2.9 + i / 3, True] for i, n in enumerate(LABELS)]
    return {
        "title": "Objects against the reference world",
        "columns": [
            column("object"),
            column("mask IoU", better="higher"),
            column("boundary F1", better="higher"),
            column("depth MAE", "mm", 1, "lower"),
            column("Chamfer-L1", "mm", 1, "lower"),
            column("found"),
        ],
        "rows": [*rows, ["mean of 4", 0.935, 0.61, 5.6, 3.4, None]],
        "notes": ["boundary F1 with a tolerance of 2 px", "missed objects count as 0"],
    }


def picture(kind: str, label: str) -> tuple[str, bytes]:
    """Caption and PNG of a preview."""
    made: dict[str, Callable[[], bytes]] = {
        "photo": lambda: scene(),
        "depth": lambda: scene(wire=True),
        "support": lambda: scene(wire=True),
        "masks": masks,
        "settled": lambda: scene(tint=True),
        "overlay": lambda: scene(tint=True),
        "seen": lambda: scene(only=label),
        "mesh": lambda: scene(only=label, wire=True),
        "parts": lambda: scene(only=label, tint=True),
        "placed": lambda: scene(only=label, tint=True, wire=True),
        "asset": lambda: scene(only=label, wire=True),
    }
    captions = {
        "photo": "photograph, 960 × 540",
        "masks": "4 instances",
        "overlay": "the twin's outlines on the photograph",
    }
    return captions.get(kind, kind), made[kind]()


def publish(store: FakeStore, spec: Spec, outputs: dict[str, str]) -> str:
    """Put one node's result into the store and return its key."""
    label = spec.node.partition("[")[2].partition("]")[0]
    header = {"artifact": spec.artifact, "fields": spec.fields or {"of": spec.node}}
    output = store.blobs.put(digest.canonical(header))
    stage, name = spec.rule.split(".")
    files = [f"rules/{stage}/{name}.py"] + ([f"rules/{stage}/{name}_{spec.backend}.py"] if spec.backend else [])
    document = {
        "schema": 1,
        "rule": spec.rule,
        "version": 1,
        "backend": spec.backend,
        "weights": [],
        "code": {file: {"<module>": digest.of_value(file), name: digest.of_value([file, name])} for file in files},
        "packages": {"numpy": "2.3.3", **({"open3d": "0.20.1"} if spec.backend else {})},
        "options": spec.options,
        "types": {"return": digest.of_value(spec.artifact)},
        "inputs": [[need.rpartition(".")[2], digest.of_value([outputs[need], label])] for need in spec.needs],
        "salt": "",
    }
    raw = digest.canonical(document)
    key = digest.of_bytes(raw)
    previews = tuple((c, store.blobs.put(data)) for c, data in (picture(kind, label) for kind in spec.pictures))
    store.actions.data[key] = Result(
        output=output,
        line=spec.line,
        previews=previews,
        metrics=spec.metrics,
        seconds=spec.seconds,
        log=store.blobs.put(f"{spec.rule}: reading inputs\n{spec.rule}: {spec.line}\n".encode()),
        key_document=store.blobs.put(raw),
    )
    outputs[spec.node] = output
    return key


def fabricate(mode: str = "mixed", workers: int = 2, nodes: list[Spec] | None = None) -> tuple[list[Event], FakeStore]:
    """Events and store of a run: `mixed` (some cached), `cached` (all of it), `cold`, or `failed` (the box's mesh)."""
    store = FakeStore()
    outputs: dict[str, str] = {}
    clock = [START + 0.2] * workers
    ended: dict[str, float] = {}
    bad = "body[box].mesh" if mode == "failed" else ""
    broken: set[str] = set()
    events: list[Event] = []
    nodes = specs() if nodes is None else nodes
    counts: dict[str, int] = {}
    for spec in nodes:
        blocked = sorted({bad for need in spec.needs if need in broken})
        cached = mode == "cached" or (mode == "mixed" and spec.node in ("capture", "support", "elements", "objects"))
        cached = cached or (mode == "mixed" and "[blue_mug]" in spec.node)
        slot = clock.index(min(clock))
        began = max([clock[slot], *(ended.get(need, START) for need in spec.needs)])
        if blocked or spec.node == bad:
            status = "waits" if blocked else "failed"
            broken.add(spec.node)
            events += finish(spec, status, None, None, began, blocked)
            clock[slot] = began + (0.0 if blocked else spec.seconds)
        else:
            key = publish(store, spec, outputs)
            status = "cached" if cached else ("fetched" if mode == "mixed" and spec.rule.endswith("urdf") else "ran")
            events += finish(spec, status, key, outputs[spec.node], began, [])
            clock[slot] = began + (0.0 if cached else spec.seconds)
        ended[spec.node] = clock[slot]
        counts[status] = counts.get(status, 0) + 1
        if spec.node == "objects":
            labels = list(dict.fromkeys(s.node.partition("[")[2].partition("]")[0] for s in nodes if "[" in s.node))
            events.append(GroupOpened(time=ended["objects"], group="body", labels=labels))
    events.sort(key=lambda event: event.time)
    first = RunStarted(
        time=START,
        run="0142",
        recipe="twin/laptop_scene",
        targets=["scene", "usd", "overlay"],
        profile="cpu",
        dxb="0.1.0",
        calls=len({s.node.rpartition(".")[2] for s in nodes}),
        groups=1,
        argv=["build", "twin/laptop_scene", "--profile", "cpu"],
    )
    seconds = max(clock) - START
    saved = 1260.0 if mode == "cached" else 74.0 if mode == "mixed" else 0.0
    last = RunFinished(time=max(clock), ok=not broken, seconds=seconds, counts=counts, saved_seconds=saved)
    return [first, *events, last], store


def finish(
    spec: Spec, status: str, key: str | None, output: str | None, began: float, blocked: list[str]
) -> list[Event]:
    """The events of one node."""
    error = None
    if status == "failed":
        error = RuleError(
            "214 open edges, 0 allowed",
            code="DXB-B201",
            facts={"triangles": "3,182", "voxel_m": "0.002"},
            hint="raise `voxel_m` to 0.004",
        )
    took = spec.seconds if status in ("ran", "fetched", "failed") else 0.0
    done = NodeFinished(
        time=began + took,
        node=spec.node,
        rule=spec.rule,
        backend=spec.backend,
        status=status,  # type: ignore[arg-type]
        key=key,
        output=output,
        seconds=took,
        line="" if status in ("failed", "waits") else spec.line,
        error=error,
        blocked_by=blocked,
        depends_on=spec.needs,
    )
    if status not in ("ran", "failed"):
        return [done]
    start = NodeStarted(
        time=began, node=spec.node, rule=spec.rule, backend=spec.backend, key=key or "0" * 64, last_seconds=took * 1.1
    )
    middle: list[Event] = []
    if took > 2:
        middle.append(NodeProgress(time=began + took / 2, node=spec.node, done=2, total=5, what="hypotheses"))
        middle.append(NodeLog(time=began + took / 2, node=spec.node, text="revolved scores 0.93"))
    return [start, *middle, done]


def as_dicts(events: list[Event]) -> list[dict[str, object]]:
    """The events as they come back from `events.jsonl`."""
    return [json.loads(event.to_line()) for event in events]
