"""The state picture: only its arrows exist, and queues follow from states."""

from __future__ import annotations

import pytest

from dextera_build.engine.states import State
from dextera_build.engine.units import Node, States
from tests.engine.tiny import call


@pytest.fixture
def node() -> Node:
    return Node(address="a", path=("a",), labels=(), call=call("a"))


def test_queues_follow_from_states(node: Node) -> None:
    states = States()
    states.set(node, State.READY)
    assert states.next_ready() is node
    assert states.next_ready() is None
    states.set(node, State.QUEUED)
    assert states.queue.popleft() is node
    states.set(node, State.LOCKED)
    assert states.locked == [node]
    states.set(node, State.QUEUED)
    assert states.locked == []
    states.set(node, State.RUNNING)
    assert states.running == 1
    states.set(node, State.DONE)
    assert states.running == 0


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (State.WAITS, State.RUNNING),
        (State.DONE, State.RUNNING),
        (State.FAILED, State.READY),
        (State.BLOCKED, State.DONE),
        (State.RUNNING, State.BLOCKED),
    ],
)
def test_other_changes_are_faults(node: Node, old: State, new: State) -> None:
    node.state = old
    with pytest.raises(AssertionError, match=f"{old.value} -> {new.value}"):
        States().set(node, new)


def test_what_left_the_ready_state_is_passed_over(node: Node) -> None:
    states = States()
    states.set(node, State.READY)
    states.set(node, State.CANCELLED)
    assert states.next_ready() is None
