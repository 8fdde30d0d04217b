"""A server is started once and kept for the next calls, until it fails, idles, makes room, or loses its worker."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

import pytest

from dextera_build.errors import RuleError
from dextera_build.outside import running, servers
from dextera_build.outside.running import Limits
from dextera_build.running import runner
from tests.e2e.space import Space
from tests.outside.conftest import alive
from tests.outside.test_program import GREY

SERVER = """
import os, signal, subprocess, sys, time
import dxb_backend

print("loading", os.getpid())
CALLS = []

def tint(request):
    CALLS.append(1)
    request.say(f"{os.getpid()} {len(CALLS)}")
    print("call", len(CALLS), flush=True)
    os.write(1, b"a library's output without an end of line")
    do(request)
    return request.inputs["image"]

def do(request):
    pass

if __name__ == "__main__":
    dxb_backend.serve(tint=tint)
"""


def text(do: str = "pass") -> str:
    return SERVER.replace("def do(request):\n    pass", f"def do(request):\n    {do}")


def run(toy: Any, do: str = "pass", **words: Any) -> tuple[int, int]:
    """Process id of the server that answers, and how many calls it has had."""
    toy.program(text(do), server=True, **words)
    made = toy.runner()
    made.run("toy.tint", image=toy.image)
    pid, count = made.outcome.line.split()
    return int(pid), int(count)


def is_alive(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


def test_it_answers_several_calls(toy, capfd):
    first, second, third = run(toy), run(toy), run(toy)
    assert [count for _, count in (first, second, third)] == [1, 2, 3]
    assert first[0] == second[0] == third[0]
    out = capfd.readouterr().out
    assert out.count("loading") == 1
    assert "call 3" in out
    assert "a library's output" in out


def test_other_code_is_another_server(toy):
    first, _ = run(toy)
    second, count = run(toy, "time.sleep(0)")
    assert (first != second, count) == (True, 1)
    assert not is_alive(first)


def test_a_refusal_leaves_it_alive(toy):
    do = "if len(CALLS) == 2: raise dxb_backend.Refused('no more', 'ask again')"
    pid, _ = run(toy, do)
    with pytest.raises(RuleError, match="no more"):
        run(toy, do)
    assert run(toy, do) == (pid, 3)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("do", "code", "words"),
    [
        ("raise ValueError('by hand')", "DXB-B370", {}),
        ("os._exit(0)", "DXB-B370", {}),
        ("os.kill(os.getpid(), 9)", "DXB-B370", {}),
        ("signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)", "DXB-B371", {"timeout_s": 1.5}),
        ("held = bytearray(1 << 30); time.sleep(600)", "DXB-B372", {"memory_gb": 0.2}),
        (
            "[(request.file(str(n)).write_bytes(bytes(1 << 20)), time.sleep(0.002)) for n in range(9999)]",
            "DXB-B373",
            {"disk_gb": 0.05},
        ),
        ("dxb_backend._tell({'done': 'elsewhere'}); time.sleep(600)", "DXB-B371", {"timeout_s": 1.5}),
        ("dxb_backend._tell({'done': str(request._folder)}); time.sleep(1)", "DXB-B374", {}),
    ],
)
def test_a_failed_call_ends_it_and_the_next_one_starts_it_again(toy, do, code, words):
    guarded = f"\n    if not os.path.exists({str(toy.root / 'fine')!r}):\n        {do}"
    with pytest.raises(RuleError) as caught:
        run(toy, f"pass{guarded}", **words)
    assert caught.value.code == code
    assert caught.value.hint
    (toy.root / "fine").touch()
    assert run(toy, f"pass{guarded}", **words)[1] == 1


@pytest.mark.slow
def test_the_time_of_a_call_is_limited_not_that_of_the_server(toy):
    for count in range(3):
        assert run(toy, "time.sleep(0.6)", timeout_s=1.5)[1] == count + 1


@pytest.mark.medium
def test_an_idle_server_ends_and_the_next_call_starts_another(toy, monkeypatch):
    monkeypatch.setattr(Limits.__init__, "__defaults__", (0.5,))  # `idle_s`
    monkeypatch.setattr(running, "_SPARE_S", 0.0)
    first, _ = run(toy)
    deadline = time.monotonic() + 20
    while is_alive(first) and time.monotonic() < deadline:
        time.sleep(0.05)
    second, count = run(toy)
    assert (first != second, count) == (True, 1)


def test_a_server_that_is_about_to_end_is_not_asked(toy, monkeypatch):
    monkeypatch.setattr(running, "_SPARE_S", 1000.0)
    assert run(toy)[0] != run(toy)[0]


@pytest.mark.medium
def test_the_response_is_there_until_it_was_read(toy, monkeypatch):
    """The guard of a program that has ended waits for the worker."""
    ask = running.Running.ask

    def slowly(*arguments):
        ask(*arguments)
        time.sleep(1.0)

    monkeypatch.setattr(running.Running, "ask", slowly)
    assert (toy.run().pixels == toy.image.pixels).all()


def test_it_makes_room_for_a_model(toy):
    pid, _ = run(toy)
    runner.pretrained({"weights": ("voice@abc",)})
    assert not is_alive(pid)
    assert servers._KEPT == {}


RECIPE = """
nodes:
  photo: {rule: toy.grey}
  one: {rule: toy.tint, image: $photo}
  two: {rule: toy.tint, image: $photo, salt: other}
targets: {default: [one, two]}
"""


@pytest.mark.medium
def test_a_worker_keeps_it_for_its_next_nodes_and_it_ends_with_the_build(toy, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    space = Space(toy.root)
    space.write("dxb.toml", 'cache = "cache"\n')
    space.write("rules/toy/grey.py", GREY.lstrip())
    space.write("recipes/say/two.yaml", RECIPE)
    toy.program(text(), server=True)
    built = space.dxb("build", "say/two", "--jobs", "1")
    assert built.code == 0, built.err
    lines = [space.dxb("log", "say/two", name).out for name in ("one", "two")]
    assert sorted(line.count("loading") for line in lines) == [0, 1]
    assert ["call 2" in line for line in lines].count(True) == 1
    assert alive(tmp_path, 15) == []
    assert os.listdir(tmp_path / "tmp") == []
