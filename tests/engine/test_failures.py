"""What a build does when something is wrong: every error is one node's, named, and stops only what depends on it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from dextera_build.engine.dry import plan as dry
from dextera_build.engine.graph import Address, Call, Graph, Pack
from dextera_build.engine.run import build
from dextera_build.errors import RecipeError, RuleError, StaleError, UsageError
from dextera_build.runs.events import NodeFinished, RunFinished
from dextera_build.store import headers
from dextera_build.store.store import Store
from tests.engine.tiny import Record, call, every, graph, group, inline, item, leaf, out, run, scene


def test_two_copies_of_one_joined_label_are_refused(store: Store) -> None:
    plan = graph(
        call("seg", "items", {"a": "1", "a.b": "2"}),
        group(
            "body",
            out("seg"),
            call("parts", "items", {"b.c": "3", "c": "4"}),
            group("part", out("body.parts"), call("mesh", i=item("body.part"))),
        ),
        call("end", all=every("body.part.mesh")),
    )
    result, _ = run(plan, store)
    assert result.errors["body.part.mesh"].message == "`body.part.mesh` has two copies called `a.b.c`"


def test_a_failure_stops_the_build_and_names_what_waits(store: Store) -> None:
    plan = graph(
        call("a", "fail"),
        call("b", a=out("a")),
        call("c", b=out("b")),
        call("d"),
        call("end", c=out("c"), d=out("d")),
    )
    result, record = run(plan, store, keep_going=True)
    assert not result.ok
    assert {name: node.status for name, node in result.nodes.items()} == {
        "a": "failed",
        "b": "waits",
        "c": "waits",
        "d": "ran",
        "end": "waits",
    }
    assert result.nodes["end"].blocked_by == ["a"]
    error = result.nodes["a"].error
    assert isinstance(error, RuleError)
    assert error.hint == "try again"
    told = {event.node: event for event in record.of(NodeFinished)}
    assert told["c"].blocked_by == ["a"]
    assert told["a"].error.code == "DXB-B202"
    assert record.of(RunFinished)[0].counts == {"failed": 1, "waits": 3, "ran": 1}


def lenient(name: str, do: str = "fail") -> Call:
    return replace(call(name, do), on_failure="go_on")


def test_a_listed_collection_lacks_what_lenient_calls_failed_to_give(store: Store) -> None:
    listed = Pack({"a": out("a"), "b": out("b"), "c": out("c")})
    result, _ = run(graph(lenient("a"), call("b"), lenient("c"), call("end", all=listed)), store)
    assert not result.ok
    assert {name: node.status for name, node in result.nodes.items()} == {
        "a": "failed",
        "b": "ran",
        "c": "failed",
        "end": "ran",
    }
    assert headers.items(store.blobs.get, str(result.nodes["end"].inputs["all"])).keys() == {"b"}
    again, _ = run(graph(lenient("a", "hash"), call("b"), lenient("c"), call("end", all=listed)), store)
    assert headers.items(store.blobs.get, str(again.nodes["end"].inputs["all"])).keys() == {"a", "b"}


@pytest.mark.parametrize(
    ("end", "why"),
    [
        (call("end", all=Pack({"a": out("a"), "c": out("c")})), "nothing is left of the collection"),
        (call("end", all=Pack({"a": out("a"), "b": out("b")}), alone=out("a")), "it is read alone, too"),
        (call("end", all=Pack({"b": out("b"), "d": out("d")})), "the call is not lenient"),
    ],
)
def test_who_needs_a_lost_entry_of_a_listed_collection_waits(store: Store, end: Call, why: str) -> None:
    members = (lenient("a"), call("b"), lenient("c"), call("d", "fail"), end)
    result, _ = run(graph(*members, default=("end",)), store, keep_going=True)
    assert result.nodes["end"].status == "waits", why


def test_copies_that_come_after_one_that_failed_are_built_all_the_same(store: Store) -> None:
    parts = {"lid": "1", "base": "2"}
    plan = graph(
        call("seg", "items", {"box": "b", "mug": "m"}),
        call("soon"),
        call("late", s=out("soon")),
        group(
            "body",
            out("seg"),
            call("fit"),
            call("parts", "items", parts),
            group("part", out("body.parts"), call("mesh", fit=out("body.fit"), i=item("body.part"))),
            box=call("fit", "fail"),
            mug=call("parts", "items", parts, late=out("late")),
        ),
        call("end", all=every("body.part.mesh")),
    )
    for target in (("end",), ("body", "part", "mesh")):
        (result, _) = run(plan, Store(store.root / target[-1]), Address(target), keep_going=True)
        status = {name: node.status for name, node in result.nodes.items()}
        assert {status[f"body[mug].part[{part}].mesh"] for part in parts} == {"ran"}
        assert {status[f"body[box].part[{part}].mesh"] for part in parts} == {"waits"}


def test_without_keep_going_the_rest_is_cancelled(store: Store) -> None:
    plan = graph(call("a", "fail"), call("b", a=out("a")), call("c"), default=("a", "b", "c"))
    result, _ = run(plan, store)
    status = {name: node.status for name, node in result.nodes.items()}
    assert status["a"] == "failed"
    assert status["b"] == "waits"
    assert status["c"] in ("ran", "cancelled")


def test_what_a_rule_lets_escape_is_one_line(store: Store) -> None:
    result, record = run(graph(call("a", "crash", "luck")), store)
    error = result.nodes["a"].error
    assert error is not None
    assert (error.message, error.code) == ("ValueError: bad luck", "DXB-B302")
    log = result.nodes["a"].log
    assert log is not None
    assert b"Traceback" in store.blobs.get(log)
    assert record.of(NodeFinished)[0].log == log


def test_two_failures_are_both_named(store: Store) -> None:
    plan = graph(call("a", "fail"), call("b", "crash"), call("c", a=out("a"), b=out("b")))
    result, _ = run(plan, store, keep_going=True)
    assert set(result.nodes["c"].blocked_by) == {"a", "b"}


def test_only_keeps_others_from_running(store: Store) -> None:
    run(scene(), store)
    fine, _ = run(scene(), store, only=frozenset())
    assert fine.ok
    stale, _ = run(scene(mesh=1), store, only=frozenset({"body[mug].mesh"}), keep_going=True)
    assert stale.nodes["body[mug].mesh"].status == "ran"
    error = stale.nodes["body[box].mesh"].error
    assert isinstance(error, StaleError)
    assert error.message == "`body[box].mesh` is stale and may not run now"
    assert error.hint == "dxb why 'tiny/graph:body[box].mesh'"


def test_a_missing_file_is_said_before_anything_runs(store: Store, tmp_path: Path) -> None:
    plan = graph(call("slow"), call("b", s=out("slow"), photo=leaf(tmp_path / "nowhere" / "photo.png")))
    record = Record()
    with pytest.raises(RecipeError, match=r"there is no file or folder `.*photo\.png`") as caught:
        build(plan, [("b",)], store=store, executor=inline(), listen=record)
    assert caught.value.code == "DXB-R301"
    assert str(caught.value.where) == "recipe.yaml:1:1"
    assert caught.value.facts["nearest"] == str(tmp_path)
    assert record.events == []


def test_a_file_that_changes_while_it_is_used_is_not_cached(store: Store, tmp_path: Path) -> None:
    photo = tmp_path / "photo"
    photo.write_text("before")
    plan = graph(call("a", "edit", str(photo), photo=leaf(photo)), call("b", a=out("a")))
    result, _ = run(plan, store)
    error = result.nodes["a"].error
    assert error is not None
    assert error.message == f"`{photo}` changed while `a` ran"
    assert error.code == "DXB-B304"
    assert result.nodes["b"].status == "waits"
    photo.write_text("edited")  # as the action leaves it, so that the next build is at rest
    again, _ = run(plan, store)
    assert {name: node.status for name, node in again.nodes.items()} == {"a": "ran", "b": "ran"}


def test_an_unknown_copy_lists_the_copies(store: Store) -> None:
    result, _ = run(scene(), store, Address(("body", "mesh"), ("mgu",)))
    assert not result.ok
    error = result.errors["body[mgu].mesh"]
    assert error.message == "`body[mgu].mesh`: there is no `mgu` in `body`"
    assert error.facts["copies"] == "box, mug"
    assert error.hint == "did you mean `mug`?"


def named(plan: Graph, label: str) -> Graph:
    """The same graph for a request that names a copy of the group `body`."""
    return replace(plan, members={**plan.members, "body": replace(plan.group(("body",)), named={label: "a setting"})})


def test_a_copy_that_the_request_names_must_exist(store: Store) -> None:
    plan = named(scene(), "mgu")
    assert dry(plan, [("scene",)], store)  # nothing is known yet
    result, _ = run(plan, store, keep_going=True)
    assert not result.ok
    assert result.errors["body"].message == "`a setting`: there is no `mgu` in `body`"
    assert result.errors["body"].hint == "did you mean `mug`?"
    assert {name: node.status for name, node in result.nodes.items()} == {"seg": "ran", "scene": "waits"}
    with pytest.raises(UsageError, match="there is no `mgu` in `body`"):
        dry(plan, [("scene",)], store)
    assert run(named(scene(), "mug"), store)[0].ok


@pytest.mark.parametrize(("label", "ok"), [("lid", True), ("knob", True), ("konb", False)])
def test_a_copy_of_an_inner_group_may_be_in_any_outer_copy(store: Store, label: str, ok: bool) -> None:
    inner = group("part", out("body.parts"), call("mesh", i=item("body.part")))
    outer = group(
        "body",
        out("seg"),
        call("parts", "items", {"lid": "1"}),
        replace(inner, named={label: "a setting"}),
        b=call("parts", "items", {"knob": "2"}),
    )
    plan = graph(call("seg", "items", {"a": "1", "b": "2"}), outer, call("end", all=every("body.part.mesh")))
    assert run(plan, store)[0].ok == ok


def test_a_group_over_what_cannot_be_opened_fails(store: Store) -> None:
    plan = graph(
        call("one"), group("body", out("one"), call("mesh", i=item("body"))), call("end", m=every("body.mesh"))
    )
    result, record = run(plan, store)
    assert result.errors["body"].message.startswith("`each` cannot open Text")
    assert result.nodes["end"].blocked_by == ["body"]
    told = {event.node: event for event in record.of(NodeFinished)}
    assert (told["body"].status, told["body"].rule) == ("failed", "each")


@pytest.mark.parametrize("label", ["", "a/b", "a[1]", "a\nb"])
def test_labels_that_cannot_stand_in_an_address_are_refused(store: Store, label: str) -> None:
    plan = scene(items={label: "x"})
    result, _ = run(plan, store)
    assert result.errors["body"].code == "DXB-B306"


def test_a_metric_that_is_not_finite_fails_the_node(store: Store) -> None:
    from tests.engine.inline import InlineExecutor

    executor = InlineExecutor(
        lambda task, emit: {"output": store.blobs.put(b"{}"), "metrics": {"error": (float("nan"), "m")}}
    )
    result = build(graph(call("a")), [("a",)], store=store, executor=executor, listen=Record())
    error = result.nodes["a"].error
    assert error is not None
    assert error.message == "metric `error` is nan, not a finite number"


def test_ten_thousand_links_fail_together(store: Store) -> None:
    links = [call("n0", "fail"), *(call(f"n{n}", x=out(f"n{n - 1}")) for n in range(1, 10_000))]
    result, _ = run(graph(*links), store)
    assert result.nodes["n9999"].blocked_by == ["n0"]


def test_a_circle_is_a_fault_with_names(store: Store) -> None:
    plan = graph(call("a", x=out("b")), call("b", x=out("a")))
    with pytest.raises(AssertionError, match="wait for one another: a, b"):
        run(plan, store)
