"""The trace of a run: of the Trace Event Format, and true to the run."""

from __future__ import annotations

import json
from itertools import pairwise
from typing import Any

import jsonschema
import pytest

from dextera_build.report.run import Run, read
from dextera_build.report.timeline import critical_path
from dextera_build.report.trace import trace
from tests.report.fabricate import fabricate

NUMBER, WORD = {"type": "integer", "minimum": 0}, {"type": "string", "minLength": 1}


def phase(letter: str, required: list[str], **more: Any) -> dict[str, Any]:
    properties = {"ph": {"const": letter}, "name": WORD, "pid": NUMBER, "tid": NUMBER, "ts": NUMBER, **more}
    return {"type": "object", "properties": properties, "required": ["ph", "name", "pid", "ts", *required]}


SCHEMA = {
    "type": "object",
    "required": ["traceEvents", "displayTimeUnit"],
    "properties": {
        "displayTimeUnit": {"enum": ["ms", "ns"]},
        "otherData": {"type": "object"},
        "traceEvents": {
            "type": "array",
            "items": {
                "oneOf": [
                    phase("X", ["tid", "dur", "cat", "args"], dur={"type": "integer", "minimum": 1}),
                    phase("i", ["tid", "s"], s={"enum": ["g", "p", "t"]}),
                    phase(
                        "C", ["args"], args={"type": "object", "additionalProperties": {"type": "number", "minimum": 0}}
                    ),
                    phase("M", ["args"], name={"enum": ["process_name", "thread_name", "thread_sort_index"]}),
                    phase("s", ["tid", "id", "cat"]),
                    phase("f", ["tid", "id", "cat"], bp={"const": "e"}),
                ]
            },
        },
    },
}


@pytest.fixture(params=["mixed", "failed", "cached"])
def run(request: pytest.FixtureRequest) -> Run:
    try:
        return read(*fabricate(request.param))
    except (KeyError, ValueError):
        pytest.skip(f"no run of the kind {request.param}")


def of(run: Run, letter: str) -> list[dict[str, Any]]:
    return [event for event in trace(run)["traceEvents"] if event["ph"] == letter]


def test_it_is_of_the_format(run: Run) -> None:
    jsonschema.validate(json.loads(json.dumps(trace(run), allow_nan=False)), SCHEMA)


def test_every_node_is_there_once_with_what_is_known_of_it(run: Run) -> None:
    events = {event["name"]: event for event in [*of(run, "X"), *of(run, "i")]}
    assert sorted(events) == sorted(node.address for node in run.nodes)
    for node in run.nodes:
        event = events[node.address]
        assert (event["cat"], event["args"]["status"]) == (node.rule, node.status)
        assert event["args"].get("key") == node.key
        assert event["ph"] == ("X" if node.worked else "i")
        if node.worked:
            assert event["dur"] == pytest.approx(node.seconds * 1e6, abs=2)


def test_slices_of_a_worker_do_not_overlap(run: Run) -> None:
    lanes: dict[int, list[tuple[int, int]]] = {}
    for event in of(run, "X"):
        lanes.setdefault(event["tid"], []).append((event["ts"], event["ts"] + event["dur"]))
    for spans in lanes.values():
        for (_, end), (begin, _) in pairwise(sorted(spans)):
            assert end <= begin + 1000  # the log of one is written a moment after the next began


def test_flows_join_the_critical_path(run: Run) -> None:
    path = [node.address for node in critical_path(run)]
    starts, ends = of(run, "s"), of(run, "f")
    assert len(starts) == len(ends) == max(len(path) - 1, 0)

    def slice_at(event: dict[str, Any]) -> list[str]:
        return [
            x["name"] for x in of(run, "X") if x["tid"] == event["tid"] and x["ts"] <= event["ts"] <= x["ts"] + x["dur"]
        ]

    for start, end, (before, after) in zip(starts, ends, pairwise(path), strict=True):
        assert start["id"] == end["id"]
        assert before in slice_at(start)
        assert after in slice_at(end)
        assert start["ts"] <= end["ts"]


def test_counters_return_to_nothing(run: Run) -> None:
    last = {event["name"]: next(iter(event["args"].values())) for event in of(run, "C")}
    assert all(value == pytest.approx(0, abs=1e-3) for value in last.values())
    assert (
        not last or max(next(iter(event["args"].values())) for event in of(run, "C") if event["name"] == "nodes") <= 2
    )
