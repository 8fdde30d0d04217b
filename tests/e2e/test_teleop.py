"""`dxb teleop`: a session without an operator, which the user ends."""

from __future__ import annotations

import signal

import pytest

from tests import documents, qr_codes
from tests.e2e.space import Space
from tests.e2e.test_serve import FLAGS, TASK


@pytest.mark.slow
def test_a_session_that_is_ended_at_once_prints_two_documents(space: Space) -> None:
    pytest.importorskip("websockets", reason="needs websockets (extra `teleop`)")
    space.write("recipes/task/try.yaml", TASK)
    refused = space.dxb("teleop", "task/try")
    assert refused.code == 2
    assert "`dxb build task/try:task`, then `dxb teleop task/try:task`" in refused.err
    built = space.build("task/try:task", *FLAGS)
    assert built.code == 0, built.err[-3000:]
    other = space.dxb("teleop", "task/try:base")
    assert other.code == 2
    assert "hint: `dxb teleop task/try:task`" in other.err
    session = space.start("teleop", "task/try:task", "--no-open", "--port", "0", "--json")
    assert session.stdout is not None
    line = session.stdout.readline()
    session.send_signal(signal.SIGINT)
    out, err = session.communicate(timeout=120)
    assert session.returncode == 0, err
    assert documents.read(line)["url"].startswith("http://127.0.0.1:")
    told = documents.read(out)
    assert (told["schema"], told["takes"], told["replay"]) == ("dxb.teleop.ended/1", 0, None)
    assert (told["camera_ms"], told["messages_dropped"]) == (None, 0)
    session = space.start("teleop", "task/try:task", "--no-open", "--port", "0", "--joint-speed", "0.5")
    assert session.stdout is not None
    address = session.stdout.readline().strip()
    session.send_signal(signal.SIGINT)
    _, err = session.communicate(timeout=120)
    assert session.returncode == 0, err
    # A camera reads the address from the terminal.
    assert qr_codes.read(err) == address
    refused = space.dxb("teleop", "task/try:task", "--no-open", "--joint-speed", "1.5")
    assert refused.code == 2
    assert "the guard needs a part of the joints' speed limits from 0 to 1" in refused.err
