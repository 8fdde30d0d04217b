"""What a build does, case by case; random graphs are in `tests/oracle`."""

from __future__ import annotations

import dataclasses
import sys
import threading
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.engine.graph import Address, Graph, Group, Pack
from dextera_build.engine.key import Writer
from dextera_build.runs.events import (
    GroupOpened,
    NodeFinished,
    NodeLog,
    NodeProgress,
    NodeStarted,
    RunSized,
    RunStarted,
)
from dextera_build.runs.history import History
from dextera_build.store import headers
from dextera_build.store.store import Store
from tests.engine.tiny import call, every, facts, graph, group, item, leaf, out, run, scene


def test_a_second_build_runs_nothing(store: Store) -> None:
    first, _ = run(scene(), store)
    second, record = run(scene(), store)
    assert {node.status for node in first.nodes.values()} == {"ran"}
    assert {node.status for node in second.nodes.values()} == {"cached"}
    assert record.of(NodeStarted) == []
    assert first.targets == ("scene",)
    assert {name: node.output for name, node in first.nodes.items()} == {
        name: node.output for name, node in second.nodes.items()
    }


def test_only_what_the_target_needs_runs(store: Store) -> None:
    result, _ = run(scene(), store, Address(("body", "mesh"), ("mug",)))
    assert set(result.nodes) == {"seg", "body[mug].mesh"}
    assert result.targets == ("body[mug].mesh",)
    every_copy, _ = run(scene(), store, Address(("body", "mesh")))
    assert every_copy.targets == ("body[box].mesh", "body[mug].mesh")


def test_an_optional_field_that_is_not_set_is_an_input_left_out(store: Store) -> None:
    def plan(note: str | None, *, optional: bool = True) -> Graph:
        second = dataclasses.replace(out("a", "note"), optional=optional)
        return graph(call("a", "noted", note), call("b", first=out("a"), second=second))

    _, record = run(plan(None), store)
    assert [set(event.inputs) for event in record.of(NodeFinished)] == [set(), {"first"}]
    whole, record = run(plan("seen"), store)
    assert [set(event.inputs) for event in record.of(NodeFinished)] == [set(), {"first", "second"}]
    assert [node.status for node in whole.nodes.values()] == ["ran", "ran"]
    assert {node.status for node in run(plan(None), store)[0].nodes.values()} == {"cached"}
    refused, _ = run(plan(None, optional=False), store)
    assert [node.error.code for node in refused.nodes.values() if node.error] == ["DXB-B312"]


def test_an_equal_output_stops_the_wave(store: Store) -> None:
    chain = [call("b", "const", a=out("a")), call("c", b=out("b")), call("d", c=out("c"))]
    run(graph(call("a"), *chain), store)
    result, _ = run(graph(call("a", value=1), *chain), store)
    assert {name: node.status for name, node in result.nodes.items()} == {
        "a": "ran",
        "b": "ran",
        "c": "cached",
        "d": "cached",
    }


def test_a_renamed_object_rebuilds_nothing_of_it(store: Store) -> None:
    run(scene(), store)
    result, _ = run(scene(items={"box": "b", "cup": "m"}), store)
    ran = {name for name, node in result.nodes.items() if node.status == "ran"}
    assert ran == {"seg", "scene"}


def test_equal_objects_share_one_run(store: Store) -> None:
    result, record = run(scene(items={"box": "same", "mug": "same"}), store)
    assert len(record.with_status("ran")) == 4  # seg, one mesh, one pose, scene
    assert result.nodes["body[box].mesh"].key == result.nodes["body[mug].mesh"].key
    assert {result.nodes[f"body[{label}].mesh"].status for label in ("box", "mug")} == {"ran", "cached"}


def test_an_override_touches_one_copy(store: Store) -> None:
    run(scene(), store)
    plan = scene()
    body = plan.members["body"]
    assert isinstance(body, Group)
    own = call("mesh", value="own", seen=item("body"))
    changed = dataclasses.replace(body, overrides={"mug": {"mesh": own}})
    result, _ = run(dataclasses.replace(plan, members={**plan.members, "body": changed}), store)
    ran = {name for name, node in result.nodes.items() if node.status == "ran"}
    assert {"body[mug].mesh", "body[mug].pose"} <= ran
    assert not any("box" in name for name in ran)


def test_an_override_of_no_copy_is_told(store: Store) -> None:
    plan = scene()
    body = plan.members["body"]
    assert isinstance(body, Group)
    own = call("mesh", value="own", seen=item("body"))
    changed = dataclasses.replace(body, overrides={"mugg": {"mesh": own}, "mug": {"mesh": own}})
    plan = dataclasses.replace(plan, members={**plan.members, "body": changed})
    result, _ = run(plan, store)
    assert [(str(one.group), one.label, one.known) for one in result.unmatched] == [("body", "mugg", ("box", "mug"))]
    result, _ = run(plan, store, Address(("seg",)))
    assert not result.unmatched, "the group was not opened"


def test_groups_in_groups_gather_by_joined_labels(store: Store) -> None:
    plan = graph(
        call("seg", "items", {"mug": "m", "box": "b"}),
        group(
            "body",
            out("seg"),
            call("parts", "items", {"lid": "l", "rim": "r"}, seen=item("body")),
            group("part", out("body.parts"), call("mesh", p=item("body.part"), b=item("body"))),
            call("whole", "blob", parts=every("body.part.mesh")),
        ),
        call("all", parts=every("body.part.mesh"), whole=every("body.whole")),
    )
    result, record = run(plan, store)
    assert result.ok
    parts = headers.items(store.blobs.get, result.nodes["all"].inputs["parts"])
    assert list(parts) == ["box.lid", "box.rim", "mug.lid", "mug.rim"]
    assert parts["mug.lid"] == result.nodes["body[mug].part[lid].mesh"].output
    inner = headers.items(store.blobs.get, result.nodes["body[mug].whole"].inputs["parts"])
    assert inner == {"lid": parts["mug.lid"], "rim": parts["mug.rim"]}
    assert {event.group for event in record.of(GroupOpened)} == {"body", "body[mug].part", "body[box].part"}


def test_an_empty_group_gathers_an_empty_collection(store: Store) -> None:
    plan = graph(
        call("seg", "items", {}),
        group("body", out("seg"), call("mesh", seen=item("body"))),
        call("scene", all=every("body.mesh")),
    )
    result, _ = run(plan, store)
    assert result.ok
    assert headers.items(store.blobs.get, result.nodes["scene"].inputs["all"]) == {}


def test_fields_are_followed(store: Store) -> None:
    plan = graph(
        call("seg", "items", {"mug": "m"}),
        call("one", x=out("seg", "items", "mug")),
        call("two", x=out("seg", "items", "mgu")),
    )
    result, _ = run(plan, store, Address(("one",)), Address(("two",)), keep_going=True)
    assert result.nodes["one"].status == "ran"
    error = result.nodes["two"].error
    assert error is not None
    assert error.message == "`mgu` is not in `items` of Many"
    assert error.hint == "did you mean `mug`?"


def test_force_runs_what_is_cached(store: Store) -> None:
    run(scene(), store)
    one, _ = run(scene(), store, force=frozenset({"body[mug].mesh"}))
    assert [name for name, node in one.nodes.items() if node.status == "ran"] == ["body[mug].mesh"]
    both, _ = run(scene(), store, force=frozenset({"body.mesh"}))
    assert sorted(n for n, node in both.nodes.items() if node.status == "ran") == ["body[box].mesh", "body[mug].mesh"]


def test_the_number_of_nodes_is_told_as_far_as_it_is_known(store: Store) -> None:
    _, record = run(scene(), store)
    sizes = [(event.nodes, event.unopened) for event in record.of(RunSized)]
    assert sizes == [(2, 1), (6, 0)]  # seg and scene; then two copies of two calls
    started = record.of(NodeStarted)[0]
    assert record.events.index(record.of(RunSized)[0]) < record.events.index(started)


def test_groups_in_groups_are_open_when_all_copies_are(store: Store) -> None:
    plan = graph(
        call("seg", "items", {"mug": "m", "box": "b"}),
        group(
            "body",
            out("seg"),
            call("parts", "items", {"lid": "l", "rim": "r"}, seen=item("body")),
            group("part", out("body.parts"), call("mesh", p=item("body.part"), b=item("body"))),
        ),
        call("all", parts=every("body.part.mesh")),
    )
    _, record = run(plan, store)
    sizes = [(event.nodes, event.unopened) for event in record.of(RunSized)]
    assert sizes[0] == (2, 1)
    assert (4, 2) in sizes
    assert sizes[-1] == (8, 0)
    assert [nodes for nodes, _ in sizes] == sorted(nodes for nodes, _ in sizes)


def test_what_the_targets_do_not_need_is_not_counted(store: Store) -> None:
    _, record = run(scene(), store, Address(("body", "mesh"), ("mug",)))
    (started,) = record.of(RunStarted)
    assert (started.calls, started.groups) == (2, 1)
    assert [(event.nodes, event.unopened) for event in record.of(RunSized)][-1] == (2, 0)


def test_files_that_a_node_reads_are_told_from_the_project_on(store: Store, tmp_path: Path) -> None:
    inside, outside = tmp_path / "project" / "photo.png", tmp_path / "note.txt"
    inside.parent.mkdir()
    inside.write_text("pixels")
    outside.write_text("soon")
    plan = graph(
        call("a", photo=leaf(inside), note=leaf(outside)),
        call("b", pack=Pack({"left": leaf(inside), "right": out("a")})),
        default=("a", "b"),
    )
    _, record = run(plan, store, project=str(inside.parent))
    told = {event.node: event.files for event in record.of(NodeFinished)}
    assert told == {"a": {"photo": "photo.png", "note": str(outside)}, "b": {"pack[left]": "photo.png"}}


def test_events_tell_progress_and_log(store: Store) -> None:
    _, record = run(graph(call("a", "tell", "hello")), store)
    (progress,) = record.of(NodeProgress)
    assert (progress.done, progress.total, progress.what) == (1, 2, "halves")
    assert [event.text for event in record.of(NodeLog)] == ["hello"]


def test_what_was_done_is_remembered(store: Store) -> None:
    run(scene(), store, run="0001")
    run(scene(), store, run="0002")
    run(scene(mesh=1), store, run="0003")
    history = History(store, "tiny/graph")
    seg, mesh = history.get("seg"), history.get("body[mug].mesh")
    assert seg is not None
    assert mesh is not None
    assert (seg.run, mesh.run) == ("0001", "0003")
    assert store.blobs.get(mesh.key_document).startswith(b'{"backend"')


@pytest.mark.medium
def test_a_long_chain_does_not_recurse(store: Store) -> None:
    length = 3 * sys.getrecursionlimit()
    links = [call("n0"), *(call(f"n{n}", "const", x=out(f"n{n - 1}")) for n in range(1, length))]
    first, _ = run(graph(*links), store)
    assert first.ok
    assert len(first.nodes) == length
    links[0] = call("n0", value=1)
    second, record = run(graph(*links), store)
    assert second.ok
    assert record.with_status("ran") == ["n0", "n1"]


def test_the_rule_version_enters_the_key(store: Store) -> None:
    run(graph(call("a")), store)
    result, _ = run(graph(call("a", rule=facts(2))), store)
    assert result.nodes["a"].status == "ran"


def test_a_key_that_is_being_built_elsewhere_is_waited_for(store: Store) -> None:
    key = digest.of_bytes(Writer().document(call("a"), {}))
    other = Store(store.root)
    assert other.locks.take(key)
    thread = threading.Timer(0.1, other.locks.release, [key])
    thread.start()
    result, record = run(graph(call("a"), call("b"), default=("a", "b")), store)
    thread.join()
    assert [event.text for event in record.of(NodeLog)] == ["another process builds the same key"]
    assert record.with_status("ran") == ["b", "a"]
    assert result.ok
