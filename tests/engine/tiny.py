"""A runner with rules of one line, and short ways to write graphs: what the engine is tested with."""

from __future__ import annotations

import contextlib
import ctypes
import functools
import hashlib
import json
import os
import signal
import sys
import time
import zlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.engine.graph import Address, Call, Fixed, Gather, Graph, Group, Input, Item, Leaf, Output, RuleFacts
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.remote_results import Remotes
from dextera_build.engine.run import RunResult, build
from dextera_build.errors import Place, RuleError
from dextera_build.runs.events import Event, NodeFinished
from dextera_build.store.questions import Look, Recording
from dextera_build.store.store import Store
from tests.engine.inline import Emit, InlineExecutor

RUNNER = "tests.engine.tiny:run_task"
HERE = Place("recipe.yaml", 1, 1)


def run_task(task: Mapping[str, Any], emit: Emit) -> dict[str, Any]:
    """Carry out `options.do`, and note in the file `$TINY_TRACE` that it ran."""
    options, store = task["options"], _store(task["store"])
    if trace := os.environ.get("TINY_TRACE"):
        with open(trace, "a") as file:
            file.write(f"{options['name']}\n")
    for name in sorted(task["inputs"]):
        _read_all(store, task["inputs"][name])
    _misbehave(options, emit)
    if options["do"] == "await":
        _await(Path(options["value"]))
    reply = {"line": f"{options['do']} done", "previews": [], "metrics": {"size": (1.0, "")}}
    if options["do"] == "read":
        asked = Recording(Look(Path(options["value"]["folder"]), store.leaves, store.root))
        seen = follow(
            options["value"]["start"], asked.exists, lambda name: _text(store, asked.digest_of(name)), asked.glob
        )
        output = store.blobs.put(text_header(seen))
        return {**reply, "output": output, "reads": asked.steps}
    return {**reply, "output": store.blobs.put(_output(options, task["inputs"], store))}


def follow(
    start: object, exists: Callable[[str], bool], text: Callable[[str], str], names: Callable[[str], list[str]]
) -> str:
    """What a call finds that reads by itself: each file leads to the next, and in the end all of them are listed."""
    told = [str(start)]
    name = f"leaf{zlib.crc32(str(start).encode()) % 4}"
    for _ in range(3):
        if not exists(name):
            told.append(f"no {name}")
            break
        told.append(text(name))
        name = f"leaf{len(told[-1]) % 4}"
    return "; ".join([*told, *(names("leaf*") if len(told) % 2 else ())])


def _text(store: Store, file: str) -> str:
    return store.blobs.get(_direct(store, file)[1][0]).decode()


@functools.cache
def _store(root: str) -> Store:
    return Store(Path(root))


def text_header(text: str, blob: str | None = None) -> bytes:
    """The header of an artifact with one text, and one blob."""
    fields: dict[str, Any] = {"text": text}
    if blob is not None:
        fields["data"] = {"$bytes": [blob, 1]}
    return digest.canonical({"artifact": "Text", "fields": fields})


def _output(options: Mapping[str, Any], inputs: Mapping[str, str], store: Store) -> bytes:
    do, value = options["do"], options["value"]
    seen = hashlib.sha256(json.dumps([value, inputs], sort_keys=True).encode()).hexdigest()
    if do == "const":
        return text_header(str(value))
    if do == "pick":  # few different outputs: often equal to the one before
        return text_header(str(int(seen, 16) % 2))
    if do == "items":
        parts = {label: {"$ref": store.blobs.put(text_header(text))} for label, text in value.items()}
        return digest.canonical({"artifact": "Many", "fields": {"items": {"$map": parts}}})
    if do == "labels":  # opened by what it reads: two or three items
        count = 2 + int(seen, 16) % 2
        parts = {f"i{n}": {"$ref": store.blobs.put(text_header(f"{seen[:4]}{n}"))} for n in range(count)}
        return digest.canonical({"artifact": "Many", "fields": {"items": {"$map": parts}}})
    if do == "noted":
        note = {"$ref": store.blobs.put(text_header(value))} if value else None
        return digest.canonical({"artifact": "Noted", "fields": {"note": note}})
    if do == "dice":  # what no key tells of
        return text_header(seen + Path(os.environ["TINY_DICE"]).read_text())
    if do == "blob":
        return text_header(seen, store.blobs.put(seen.encode()))
    return text_header(seen)


def _misbehave(options: Mapping[str, Any], emit: Emit) -> None:
    do, value = options["do"], options["value"]
    if do == "fail":
        raise RuleError("no such luck", code="DXB-B202", facts={"value": value}, hint="try again")
    if do == "crash":
        raise ValueError(f"bad {value}")
    if do == "kill":
        print("about to die", flush=True)
        os.kill(os.getpid(), signal.SIGKILL)
    if do in _ENDS:
        _ENDS[do](value)
    if do == "print":
        print(value)
        os.write(2, b"and to stderr\n")
    if do == "tell":
        emit("progress", {"done": 1, "total": 2, "what": "halves"})
        emit("log", {"text": value})
    if do == "sleep":
        time.sleep(float(value))
    if do == "edit":
        Path(value).write_text("edited")


def _junk(text: str) -> None:
    """Write to every socket of this process."""
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(OSError):
            if os.readlink(f"/proc/self/fd/{name}").startswith("socket:"):
                os.write(int(name), text.encode("latin-1") + b"\n")


_ENDS: Mapping[str, Callable[[Any], object]] = {
    "segfault": lambda value: ctypes.string_at(0),
    "exit": lambda value: sys.exit(int(value)),
    "junk": _junk,
}


def _await(file: Path) -> None:
    deadline = time.monotonic() + 120
    while not file.exists():
        assert time.monotonic() < deadline, "nobody came"
        time.sleep(0.01)


def _read_all(store: Store, header: str) -> None:
    refs, blobs = _direct(store, header)
    for blob in blobs:
        store.blobs.get(blob)
    for ref in refs:
        _read_all(store, ref)


def _direct(store: Store, header: str) -> tuple[list[str], list[str]]:
    from dextera_build.store.headers import closure

    return closure(store.blobs.get(header))


def facts(version: int = 1, **changes: Any) -> RuleFacts:
    """A rule; keywords replace fields."""
    base: dict[str, Any] = {
        "path": "tiny.rule",
        "version": version,
        "code": {"rules/tiny/rule.py": {"rule": "c0de"}},
        "packages": {"numpy": "2.0"},
        "backend": None,
        "weights": (),
        "types": {"return": "7e"},
    }
    return RuleFacts(**(base | changes))


FACTS = facts()


def call(name: str, do: str = "hash", value: Any = 0, rule: RuleFacts = FACTS, **inputs: Input) -> Call:
    """A call of the tiny rule. `name` is an option, so that equal calls of two names have two keys."""
    return Call(name=name, rule=rule, options={"do": do, "value": value, "name": name}, inputs=inputs, where=HERE)


def out(address: str, *fields: str) -> Output:
    """`a.b` as an input."""
    return Output(tuple(address.split(".")), fields)


def every(address: str, *fields: str) -> Gather:
    """All copies of `a.b` as an input."""
    return Gather(tuple(address.split(".")), fields)


def item(group: str, *fields: str) -> Item:
    """The item of a group as an input."""
    return Item(tuple(group.split(".")), fields)


def leaf(path: Path) -> Leaf:
    """A file or folder as an input."""
    return Leaf(path, HERE)


def group(name: str, over: Output | Item | Fixed, *members: Call | Group, **overrides: Call) -> Group:
    """A group; `label=call` replaces a member in one copy."""
    return Group(
        name=name,
        over=over,
        members={member.name: member for member in members},
        overrides={label: {other.name: other} for label, other in overrides.items()},
        where=HERE,
    )


def graph(*members: Call | Group, default: tuple[str, ...] = ()) -> Graph:
    """A graph; its targets are `default`, or its last member."""
    names = default or (members[-1].name,)
    return Graph("tiny/graph", {m.name: m for m in members}, {"default": tuple(tuple(n.split(".")) for n in names)})


class Record:
    """A listener that keeps everything."""

    def __init__(self) -> None:
        self.events: list[Event] = []

    def __call__(self, event: Event) -> None:
        self.events.append(event)

    def of(self, kind: type[Event]) -> list[Any]:
        """Events of one kind."""
        return [event for event in self.events if isinstance(event, kind)]

    def with_status(self, status: str) -> list[str]:
        """Addresses of nodes in the order in which they finished with `status`."""
        return [event.node for event in self.events if isinstance(event, NodeFinished) and event.status == status]


def inline() -> InlineExecutor:
    """This process as the executor."""
    return InlineExecutor(run_task)


def run(
    plan: Graph, store: Store, *targets: Address, exchange: Remotes = None, **flags: Any
) -> tuple[RunResult, Record]:
    """Build with this process as the executor; `flags` are fields of `Policy`."""
    record, policy = Record(), RunPolicy(**flags)
    asked = targets or plan.targets["default"]
    return build(plan, asked, store=store, executor=inline(), listen=record, policy=policy, exchange=exchange), record


def scene(mesh: Any = 0, items: Any = None) -> Graph:
    """Two objects with a chain each, gathered."""
    return graph(
        call("seg", "items", items or {"box": "b", "mug": "m"}),
        group(
            "body",
            out("seg"),
            call("mesh", value=mesh, seen=item("body")),
            call("pose", "pick", mesh=out("body.mesh")),
        ),
        call("scene", all=every("body.pose")),
    )
