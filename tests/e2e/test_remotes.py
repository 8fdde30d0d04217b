"""Results shared between machines, through the real `dxb`: each machine is a store of its own."""

from __future__ import annotations

import os
import random
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import pytest

from tests.e2e.machines import EVERY, agree, given_up, machine, results, serving, uploads
from tests.e2e.space import Answer, Space
from tests.interrupts import hear_interrupts
from tests.remotes import servers

GATE = '''
"""toy.gate: waits until the project has a file `go`."""
import time
from pathlib import Path
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class GateOptions(Options):
    """Options."""
    go: str = ""
    """The file."""

@rule(version=1)
def gate(ctx: Context, text: File, *, options: GateOptions) -> File:
    """Return the text."""
    while not Path(options.go).exists():
        time.sleep(0.01)
    return text
'''


@pytest.mark.medium
@pytest.mark.parametrize("kind", ["folder", "http"])
def test_a_second_machine_runs_nothing(space: Space, served: str, kind: str) -> None:
    remote = served if kind == "http" else "./share"
    first = machine(space, "one", "say/words", use=f"{remote}:rw")
    assert first.nodes("ran") == EVERY, first.err
    assert uploads(first) == [(7, 0)]
    second = machine(space, "two", "say/words", use=f"{remote}:r")
    assert second.code == 0
    assert second.nodes("fetched") == EVERY
    assert second.nodes("ran", "cached") == set()
    assert agree(space, "two", "one")
    assert (space.root / "two/out/say/words/all/all").read_bytes() == b"ONE!!! TWO!!!"
    third = machine(space, "two", "say/words", use=f"{remote}:r")
    assert third.events[-1]["counts"] == {"cached": 7}
    assert space.dxb("cache", "pull", "say/words", "--from", remote, env={"DXB_CACHE": "two"}).code == 0
    assert results(space, "two") == results(space, "one")


@pytest.mark.slow
def test_bytes_come_only_where_somebody_reads_them(space: Space, served: str) -> None:
    machine(space, "one", "say/words", use=f"{served}:rw")
    machine(space, "two", "say/words", use=f"{served}:r")
    assert (ours := blobs(space, "two")) < (all_of_them := blobs(space, "one"))
    # A node that must run reads what only passed through before.
    space.edit("recipes/say/words.yaml", "texts: $word.louder", "texts: $word.loud")
    later = machine(space, "two", "say/words", use=f"{served}:r")
    assert later.nodes("ran") == {"all"}
    assert later.nodes("fetched") == {"word[one].loud", "word[two].loud"}
    assert ours < blobs(space, "two")
    pulled = space.dxb("cache", "pull", "say/words:start", "--from", served, env={"DXB_CACHE": "two"})
    assert "1 node: 1 fetched" in pulled.err
    space.edit("recipes/say/words.yaml", "texts: $word.loud}", "texts: $word.louder}")
    assert space.dxb("cache", "pull", "say/words", "--from", served, env={"DXB_CACHE": "two"}).code == 0
    assert all_of_them <= blobs(space, "two")


@pytest.mark.medium
def test_bytes_that_a_remote_lost_are_made_again(space: Space) -> None:
    machine(space, "one", "say/words", use="./share:rw")
    machine(space, "two", "say/words", use="./share:r")
    for file in (space.root / "share" / "cas").rglob("*"):
        if file.is_file():
            file.unlink()
    space.edit("recipes/say/words.yaml", "texts: $word.louder", "texts: $word.loud")
    later = machine(space, "two", "say/words", use="./share:r")
    assert later.code == 0
    assert later.nodes("ran") == EVERY - {"word[one].louder", "word[two].louder"}


def blobs(space: Space, store: str) -> set[str]:
    return {place for place in results(space, store) if place.startswith("cas/")}


@pytest.mark.medium
def test_a_log_shows_what_was_fetched_and_from_where(space: Space, served: str) -> None:
    space.write("dxb.toml", f'cache = "cache"\n[remotes]\nlab = "{served}"\n')
    space.dxb("build", "say/words", "--cache", "local:rw,lab:rw", env={"DXB_CACHE": "one"})
    log = space.dxb("build", "say/words", "--console", "plain").err
    assert re.search(r"^  ↓  start +\d\S* s +lab  ", log, re.MULTILINE)
    assert "built say/words   7 nodes: 7 fetched" in log


@pytest.mark.medium
def test_a_remote_that_is_not_there_costs_a_warning(space: Space) -> None:
    with servers.deaf_port() as port:
        space.write("dxb.toml", f'[remotes]\nlab = {{address = "http://me:geheim@127.0.0.1:{port}/x", mode = "rw"}}\n')
        answer = space.dxb("build", "say/words", "--console", "plain")
    assert answer.code == 0
    (warning,) = [line for line in answer.err.splitlines() if "is not used for the rest" in line]
    assert warning == (
        f"warning: remote lab (http://***@127.0.0.1:{port}/x) is not used for the rest of this build: "
        "no connection: Connection refused; `--cache local:rw` builds without remotes"
    )
    assert "warning: 7 results were not uploaded to lab: no connection: Connection refused" in answer.err
    assert "geheim" not in answer.err


@pytest.mark.medium
def test_a_read_only_remote_refuses_and_the_build_goes_on(space: Space) -> None:
    with serving(space, "served", "--read-only") as url:
        answer = machine(space, "one", "say/words", use=f"{url}:rw")
    assert answer.code == 0
    assert answer.nodes("ran") == EVERY
    (notice,) = given_up(answer)
    assert notice["doing"] == "write"
    assert notice["reason"] == "PUT was answered 405: it does not allow that"
    assert uploads(answer) == [(0, 7)]


@pytest.mark.slow
def test_a_remote_killed_in_the_middle(space: Space) -> None:
    space.write("rules/toy/gate.py", GATE.lstrip())
    last = f"  last: {{rule: toy.gate, text: $all, go: {space.root / 'go'}}}\ntargets:"
    space.write("recipes/say/long.yaml", long_recipe(12).replace("targets:", last).replace("[all]", "[last]"))
    server = space.start("cache", "serve", "--port", "0", "--cache", "served")
    assert server.stdout is not None
    url = server.stdout.readline().strip()
    build = subprocess.Popen(
        [sys.executable, "-m", "dextera_build", "build", "-j", "2", "--console", "jsonl", "say/long"],
        cwd=space.root,
        env=space.environment(DXB_CACHE="one", DXB_REMOTES=f"{url}:rw"),
        stderr=subprocess.PIPE,
        text=True,
    )
    assert build.stderr is not None
    lines = []
    for line in build.stderr:
        lines.append(line)
        if '"status": "ran"' in line and len(lines) > 8:
            os.kill(server.pid, signal.SIGKILL)
            break
    space.write("go", "")
    rest = build.stderr.read()
    assert build.wait() == 0
    server.communicate()
    answer = Answer(0, "", "".join(lines) + rest)
    assert len(answer.nodes("ran")) == 14
    ((sent, left),) = uploads(answer)
    assert sent + left == 14
    assert left > 0
    # What was uploaded is whole: another machine takes that and makes the rest.
    with serving(space, "served") as url:
        second = machine(space, "two", "say/long", use=f"{url}:r")
    assert second.code == 0
    assert len(second.nodes("fetched")) >= sent
    made, remade = results(space, "one"), results(space, "two")
    assert {name for name in made if name.startswith("ac")} == {name for name in remade if name.startswith("ac")}
    made, remade = ((space.root / name / "out/say/long/last/last").read_bytes() for name in ("one", "two"))
    assert made == remade


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_a_remote_full_of_damage(space: Space, seed: int) -> None:
    dice = random.Random(seed)
    first = machine(space, "one", "say/words", use="./share:rw")
    assert uploads(first) == [(7, 0)]
    for file in sorted(path for path in (space.root / "share").rglob("*") if path.is_file()):
        data = bytearray(file.read_bytes())
        file.unlink()
        if dice.random() < 0.5:
            data = data[: dice.randrange(len(data))]
        else:
            data[dice.randrange(len(data))] ^= 1 << dice.randrange(8)
        file.write_bytes(bytes(data))
    second = machine(space, "two", "say/words", use="./share:rw")
    assert second.code == 0
    assert second.nodes("ran", "fetched") == EVERY
    assert (space.root / "two/out/say/words/all/all").read_bytes() == b"ONE!!! TWO!!!"


class Dripping:
    """A server that gives one byte of an answer now and then."""

    def __init__(self) -> None:
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.url = f"http://127.0.0.1:{self._listening.getsockname()[1]}"
        self.served = threading.Event()
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            link, _ = self._listening.accept()
            self.served.set()
            threading.Thread(target=self._drip, args=(link,), daemon=True).start()

    def _drip(self, link: socket.socket) -> None:
        try:
            for byte in b"HTTP/1.1 200 OK\r\nX-Slow: " + b"x" * 60_000:
                link.sendall(bytes([byte]))
                time.sleep(0.02)
        except OSError:
            pass


@pytest.mark.slow
def test_a_server_that_drips_is_left_alone(space: Space) -> None:
    server = Dripping()
    space.write("dxb.toml", f'[remotes]\nlab = {{address = "{server.url}", mode = "rw", timeout_s = 1.0}}\n')
    answer = space.build("say/words")
    assert answer.code == 0
    assert answer.nodes("ran") == EVERY
    assert [notice["reason"] for notice in given_up(answer)] == ["it answers too slowly"]
    assert answer.events[-1]["seconds"] < 120  # all that it drips would take twenty minutes
    assert server.served.wait(60)  # whoever connected stands in line until this process has time for it


@pytest.mark.slow
def test_an_interrupt_does_not_wait_for_uploads(space: Space) -> None:
    build = subprocess.Popen(
        [sys.executable, "-m", "dextera_build", "build", "--console", "jsonl", "say/words"],
        cwd=space.root,
        env=space.environment(DXB_REMOTES=f"{Dripping().url}:w"),
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_interrupts(),
    )
    assert build.stderr is not None
    lines = []
    for line in build.stderr:
        lines.append(line)
        if '"event": "uploading"' in line:
            build.send_signal(signal.SIGINT)
            break
    lines += build.stderr.readlines()
    assert build.wait(120) == 130
    answer = Answer(130, "", "".join(lines))
    assert answer.nodes("ran") == EVERY
    assert uploads(answer) == [(0, 7)]
    assert space.build("say/words").nodes("ran") == set()


@pytest.mark.slow
def test_several_builds_share_one_remote(space: Space, served: str) -> None:
    space.write("recipes/say/long.yaml", long_recipe(6))
    builds = [
        subprocess.Popen(
            [sys.executable, "-m", "dextera_build", "build", "-j", "1", "--console", "none", "say/long"],
            cwd=space.root,
            env=space.environment(DXB_CACHE=f"m{number}", DXB_REMOTES=f"{served}:rw"),
        )
        for number in range(4)
    ]
    assert [build.wait(120) for build in builds] == [0, 0, 0, 0]
    last = machine(space, "last", "say/long", use=f"{served}:r")
    assert len(last.nodes("fetched")) == 7
    checked = space.dxb("cache", "size", "--cache", "served").out
    assert checked.startswith("blobs\t")


def long_recipe(number: int) -> str:
    """Slow nodes beside one another, and one that reads them all."""
    rows = [f"  n{place}: {{rule: toy.slow, text: $start, seconds: 0.{place + 1:02}}}" for place in range(number - 1)]
    last = ", ".join(f"n{place}: $n{place}" for place in range(number - 1))
    return "\n".join(
        [
            "summary: Slow words.",
            "nodes:",
            "  start: {rule: toy.start, text: one two}",
            *rows,
            f"  all: {{rule: toy.join, texts: {{{last}}}}}",
            "targets:",
            "  default: [all]",
            "",
        ]
    )
