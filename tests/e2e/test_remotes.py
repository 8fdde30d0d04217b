"""Results shared between machines, through the real `dxb`: each machine is a store of its own."""

from __future__ import annotations

import os
import random
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.e2e.space import Answer, Space
from tests.interrupts import hear_interrupts
from tests.store.remotes import servers

EVERY = {"start", "words", "all", *(f"word[{w}].{n}" for w in ("one", "two") for n in ("loud", "louder"))}
LINE = "all\t"


def machine(space: Space, name: str, *words: str, use: str = "") -> Answer:
    """Build on a machine with a store of its own; `use` is the list of remotes."""
    return space.dxb("build", "--console", "jsonl", *words, env={"DXB_CACHE": name, "DXB_REMOTES": use})


def results(space: Space, name: str) -> dict[str, bytes]:
    """Every result and blob of a store."""
    folders = [space.root / name / kind for kind in ("ac", "cas")]
    return {
        str(path.relative_to(space.root / name)): path.read_bytes()
        for f in folders
        for path in f.rglob("*")
        if path.is_file()
    }


def uploads(answer: Answer) -> list[tuple[int, int]]:
    return [(event["results"], event["left"]) for event in answer.events if event["event"] == "uploaded"]


def given_up(answer: Answer) -> list[dict]:
    return [event for event in answer.events if event["event"] == "remote_given_up"]


@pytest.fixture
def served(space: Space) -> Iterator[str]:
    """`dxb cache serve` as a process."""
    with serving(space, "served") as url:
        yield url


@contextmanager
def serving(space: Space, name: str, *words: str) -> Iterator[str]:
    server = space.start("cache", "serve", "--port", "0", "--cache", name, *words)
    try:
        assert server.stdout is not None
        yield server.stdout.readline().strip()
    finally:
        server.send_signal(signal.SIGINT)
        _, said = server.communicate(timeout=20)
        assert server.returncode == 0, said


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
    assert results(space, "two") == results(space, "one")
    assert (space.root / "two/out/say/words/all/all").read_bytes() == b"ONE!!! TWO!!!"
    third = machine(space, "two", "say/words", use=f"{remote}:r")
    assert third.events[-1]["counts"] == {"cached": 7}


def test_a_log_shows_what_was_fetched_and_from_where(space: Space, served: str) -> None:
    space.write("dxb.toml", f'cache = "cache"\n[remotes]\nlab = "{served}"\n')
    space.dxb("build", "say/words", "--cache", "local:rw,lab:rw", env={"DXB_CACHE": "one"})
    log = space.dxb("build", "say/words", "--console", "plain").err
    assert "  ↓  start" in log
    assert "lab" in log
    assert "built say/words   7 nodes: 7 fetched" in log


def test_a_remote_that_is_not_there_costs_a_warning(space: Space) -> None:
    port = servers.free_port()
    space.write("dxb.toml", f'[remotes]\nlab = {{address = "http://me:geheim@127.0.0.1:{port}/x", mode = "rw"}}\n')
    answer = space.dxb("build", "say/words", "--console", "plain")
    assert answer.code == 0
    (warning,) = [line for line in answer.err.splitlines() if "is left alone" in line]
    assert warning == (
        f"warning: remote lab (http://***@127.0.0.1:{port}/x) is left alone for the rest of this build: "
        "no connection: Connection refused; `--cache local:rw` builds without remotes"
    )
    assert "warning: 7 results were not uploaded to lab: no connection: Connection refused" in answer.err
    assert "geheim" not in answer.err


def test_a_read_only_remote_refuses_and_the_build_goes_on(space: Space) -> None:
    with serving(space, "served", "--read-only") as url:
        answer = machine(space, "one", "say/words", use=f"{url}:rw")
    assert answer.code == 0
    assert answer.nodes("ran") == EVERY
    (notice,) = given_up(answer)
    assert notice["doing"] == "write"
    assert notice["reason"] == "PUT was answered 405: it does not allow that"
    assert uploads(answer) == [(0, 7)]


def test_a_remote_killed_in_the_middle(space: Space) -> None:
    space.write("recipes/say/long.yaml", long_recipe(12))
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
    rest = build.stderr.read()
    assert build.wait(60) == 0
    server.communicate()
    answer = Answer(0, "", "".join(lines) + rest)
    assert len(answer.nodes("ran")) == 13
    ((sent, left),) = uploads(answer)
    assert sent + left == 13
    assert left > 0
    # What was uploaded is whole: another machine takes that and makes the rest.
    with serving(space, "served") as url:
        second = machine(space, "two", "say/long", use=f"{url}:r")
    assert second.code == 0
    assert len(second.nodes("fetched")) >= sent
    made, remade = results(space, "one"), results(space, "two")
    assert {name for name in made if name.startswith("ac")} == {name for name in remade if name.startswith("ac")}
    assert (space.root / "two/out/say/long/all/all").read_bytes() == (
        space.root / "one/out/say/long/all/all"
    ).read_bytes()


@pytest.mark.parametrize("seed", range(3))
def test_a_remote_full_of_damage(space: Space, seed: int) -> None:
    dice = random.Random(seed)
    first = machine(space, "one", "say/words", use="./share:rw")
    assert uploads(first) == [(7, 0)]
    for file in [path for path in (space.root / "share").rglob("*") if path.is_file()]:
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
        self.served = 0
        threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while True:
            link, _ = self._listening.accept()
            self.served += 1
            threading.Thread(target=self._drip, args=(link,), daemon=True).start()

    def _drip(self, link: socket.socket) -> None:
        try:
            for byte in b"HTTP/1.1 200 OK\r\nX-Slow: " + b"x" * 60_000:
                link.sendall(bytes([byte]))
                time.sleep(0.05)
        except OSError:
            pass


def test_a_server_that_drips_is_left_alone(space: Space) -> None:
    server = Dripping()
    space.write("dxb.toml", f'[remotes]\nlab = {{address = "{server.url}", mode = "rw", timeout_s = 0.3}}\n')
    answer = space.build("say/words")
    assert answer.code == 0
    assert answer.nodes("ran") == EVERY
    assert [notice["reason"] for notice in given_up(answer)] == ["it answers too slowly"]
    assert answer.events[-1]["seconds"] < 20
    assert server.served > 0


def test_an_interrupt_does_not_wait_for_uploads(space: Space) -> None:
    build = subprocess.Popen(
        [sys.executable, "-m", "dextera_build", "build", "--console", "jsonl", "say/words"],
        cwd=space.root,
        env=space.environment(DXB_REMOTES=f"{Dripping().url}:w"),
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=hear_interrupts,
    )
    assert build.stderr is not None
    lines = []
    for line in build.stderr:
        lines.append(line)
        if '"event": "uploading"' in line:
            build.send_signal(signal.SIGINT)
            break
    lines += build.stderr.readlines()
    assert build.wait(10) == 130
    answer = Answer(130, "", "".join(lines))
    assert answer.nodes("ran") == EVERY
    assert uploads(answer) == [(0, 7)]
    assert space.build("say/words").nodes("ran") == set()


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


def test_push_and_pull(space: Space, served: str) -> None:
    assert space.build("say/words").code == 0
    pushed = space.dxb("push", "say/words", "--to", served)
    assert pushed.code == 0, pushed.err
    assert {line.partition("\t")[0] for line in pushed.out.splitlines()} == {f"say/words:{node}" for node in EVERY}
    assert f"{served}: 7 results uploaded" in pushed.err
    assert space.dxb("push", "say/words", "--to", served).code == 0
    pulled = space.dxb("pull", "say/words", "--from", served, env={"DXB_CACHE": "two"})
    assert pulled.code == 0, pulled.err
    assert "pulled say/words   7 nodes: 7 fetched" in pulled.err
    assert pulled.out == "all\ttwo/out/say/words/all/all\n"
    assert (space.root / "two/out/say/words/all/all").read_bytes() == b"ONE!!! TWO!!!"
    again = space.dxb("build", "say/words", env={"DXB_CACHE": "two"})
    assert "say/words is up to date   7 nodes" in again.err


def test_a_plan_says_what_a_remote_has(space: Space, served: str) -> None:
    space.build("say/words")
    space.dxb("push", "say/words", "--to", served)
    rows = space.dxb("plan", "say/words", env={"DXB_CACHE": "two", "DXB_REMOTES": f"{served}:r"}).out
    assert "start\tremote\ttoy.start" in rows
    assert "words\tunknown" in rows
    without = space.dxb("plan", "say/words", env={"DXB_CACHE": "two"}).out
    assert "start\tstale\ttoy.start" in without  # nothing was brought


def test_pull_says_what_is_lacking_and_runs_nothing(space: Space, served: str) -> None:
    space.build("say/words:words")
    space.dxb("push", "say/words:words", "--to", served)
    pulled = space.dxb("pull", "say/words", "--from", served, env={"DXB_CACHE": "two"})
    assert pulled.code == 1
    assert "error[DXB-S202]: 2 nodes are neither in the store nor in a remote" in pulled.err
    assert "say/words:word[one].loud, say/words:word[two].loud" in pulled.err
    assert "pulled say/words   7 nodes: 2 fetched, 3 wait, 2 lacking" in pulled.err
    assert "`dxb build say/words` makes what is lacking" in pulled.err


def test_push_says_what_is_not_built(space: Space, served: str) -> None:
    answer = space.dxb("push", "say/words", "--to", served)
    assert answer.code == 1
    assert "error[DXB-S201]:" in answer.err
    assert "hint: dxb build say/words" in answer.err


def test_push_to_where_nothing_may_be_written(space: Space) -> None:
    space.build("say/words")
    with serving(space, "served", "--read-only") as url:
        answer = space.dxb("push", "say/words", "--to", url)
    assert answer.code == 1
    assert answer.out == ""
    assert "7 results were not uploaded" in answer.err
    assert "405: it does not allow that" in answer.err


def test_push_needs_a_remote(space: Space) -> None:
    answer = space.dxb("push", "say/words")
    assert answer.code == 2
    assert "error[DXB-U136]: no remote may be written" in answer.err
    assert "`--to NAME`" in answer.err
    assert "error[DXB-U133]: no remote is called `lab`" in space.dxb("pull", "say/words", "--from", "lab").err


def test_the_store_to_read_runs_nothing(space: Space) -> None:
    space.build("say/words:words")
    assert space.dxb("build", "--cache", "local:r", "say/words:words").code == 0
    answer = space.dxb("build", "--cache", "local:r", "say/words")
    assert answer.code == 1
    assert "`word[one].loud` is stale and may not run now" in answer.err


def test_the_configuration_shows_remotes_without_secrets(space: Space) -> None:
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nlab = "https://me:geheim@cache.lab/dxb"\nshare = "../share"\n')
    space.write(
        "dxb.local.toml",
        '[remotes]\nbucket = {address = "s3://twins/dxb", mode = "rw", secret_access_key = "geheim"}\n',
    )
    shown = space.dxb(
        "show", "--config", "--cache", "local:rw,https://you:geheim@host:r", env={"DXB_CACHE": "other"}
    ).out
    assert "geheim" not in shown
    rows = dict(line.split("\t", 1) for line in shown.splitlines())
    assert rows["cache"] == "other\tenvironment"
    assert rows["remotes.lab"] == "https://***@cache.lab/dxb r\tdxb.toml"
    assert rows["remotes.bucket"] == "s3://twins/dxb rw secret_access_key=***\tdxb.local.toml"
    assert rows["use"] == "local:rw,https://***@host:r\tcommand line"


def test_a_variable_that_is_not_set(space: Space) -> None:
    space.write("dxb.toml", '[remotes]\nlab = "https://ci:${NOT_SET_HERE}@host/x"\n')
    answer = space.dxb("pull", "say/words")
    assert answer.code == 2
    assert "error[DXB-U135]: remote `lab` needs the variable `NOT_SET_HERE`, which is not set" in answer.err
    built = space.dxb("build", "say/words", "--console", "plain")
    assert built.code == 0
    assert "needs the variable `NOT_SET_HERE`" in built.err


def test_serving_where_nothing_can_listen(space: Space, served: str) -> None:
    answer = space.dxb("cache", "serve", "--port", served.rpartition(":")[2])
    assert answer.code == 4
    assert "error[DXB-E331]: nothing can listen at 127.0.0.1:" in answer.err
    assert space.dxb("cache", "serve", "--port", "99999").code == 4


@pytest.mark.slow
def test_two_machines_and_nginx(space: Space, tmp_path: Path) -> None:
    (tmp_path / "nginx").mkdir()
    with servers.nginx(tmp_path / "nginx") as url:
        assert uploads(machine(space, "one", "say/words", use=f"{url}:rw")) == [(7, 0)]
        assert machine(space, "two", "say/words", use=f"{url}:r").nodes("fetched") == EVERY
    # Its folder is a store.
    assert machine(space, "three", "say/words", use="./nginx/data:r").nodes("fetched") == EVERY


@pytest.mark.slow
def test_nginx_that_lets_only_some_write(space: Space, tmp_path: Path) -> None:
    (tmp_path / "nginx").mkdir()
    (tmp_path / "nginx/writers").write_text("ci:{PLAIN}geheim\n")
    guard = 'limit_except GET HEAD { auth_basic "dxb"; auth_basic_user_file writers; }'
    with servers.nginx(tmp_path / "nginx", guard) as url:
        refused = machine(space, "one", "say/words", use=f"{url}:rw")
        assert given_up(refused)[0]["reason"] == "PUT was answered 401: it wants a name and a password"
        named = url.replace("http://", "http://ci:geheim@")
        assert space.dxb("push", "say/words", "--to", named, env={"DXB_CACHE": "one"}).code == 0
        netrc = space.write("netrc", "machine 127.0.0.1 login ci password geheim\n")
        netrc.chmod(0o600)
        by_file = space.dxb("push", "say/words", "--to", url, env={"DXB_CACHE": "one", "NETRC": str(netrc)})
        assert by_file.code == 0
        assert "geheim" not in by_file.err + by_file.out
        assert machine(space, "two", "say/words", use=f"{url}:r").nodes("fetched") == EVERY


@pytest.mark.slow
def test_two_machines_and_a_bucket(space: Space, tmp_path: Path) -> None:
    (tmp_path / "s3").mkdir()
    with servers.s3(tmp_path / "s3") as endpoint:
        space.write(
            "dxb.toml",
            f'[remotes]\nbucket = {{address = "s3://twins/dxb", endpoint = "{endpoint}", region = "us-east-1"}}\n',
        )
        keys = {"AWS_ACCESS_KEY_ID": "anyone", "AWS_SECRET_ACCESS_KEY": "geheim"}
        first = space.dxb(
            "build", "--console", "jsonl", "say/words", env={**keys, "DXB_CACHE": "one", "DXB_REMOTES": "bucket:rw"}
        )
        assert uploads(first) == [(7, 0)], first.err
        second = space.dxb("build", "--console", "jsonl", "say/words", env={**keys, "DXB_CACHE": "two"})
        assert second.nodes("fetched") == EVERY
        nobody = space.dxb(
            "build", "--console", "plain", "say/words", env={"DXB_CACHE": "three", "AWS_EC2_METADATA_DISABLED": "true"}
        )
        assert nobody.code == 0
