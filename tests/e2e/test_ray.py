"""Builds on a real Ray cluster: two nodes on this machine with a store each, and a folder that they share."""

from __future__ import annotations

import importlib.util
import signal
import socket
import subprocess
import time
from collections.abc import Iterator

import pytest

from tests.e2e.raylets import PATIENCE_S, Raylets, raylets
from tests.e2e.space import Answer, Space

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="ray is not installed: `make test-all`"),
    pytest.mark.timeout(900),
]

WHERE = '''
"""toy.where: says on which node it ran."""
import os
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class WhereOptions(Options):
    """Options."""
    salt: str = ""
    """Makes two calls differ."""

@rule(version=1, resources={"site:SITE": 1})
def NAME(ctx: Context, text: File, *, options: WhereOptions) -> File:
    """Return the text with the site's name."""
    print("store", os.environ["DXB_NODE_STORE"], flush=True)
    ctx.progress(1, 2, "halfway")
    return File(data=text.data + b" SITE" + bytes(2_000_000))
'''
RECIPE = """
inputs: {text: words.txt}
nodes:
  a: {rule: toy.at_a, text: $text}
  b: {rule: toy.at_b, text: $a}
  c: {rule: toy.at_a, text: $b, salt: again}
"""
SHARED = {"DXB_REMOTES": "./shared:rw"}


def test_without_a_shared_remote_the_error_says_how_to_name_one(space: Space) -> None:
    answer = space.run("build", "say/words", "--executor", "ray:127.0.0.1:1")
    assert answer.code == 2
    assert "error[DXB-U195]: a build on a cluster needs a remote that all its machines can read and write" in answer.err
    assert "hint: in `dxb.toml`: [remotes] shared = {address = " in answer.err


def test_a_cluster_that_ran_here_once_is_not_waited_for(space: Space) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        gone = f"127.0.0.1:{free.getsockname()[1]}"
    space.write("ray/ray_current_cluster", gone)
    began = time.monotonic()
    answer = space.run("build", "say/words", "--executor", "ray", env={"RAY_TMPDIR": str(space.root), **SHARED})
    assert answer.code == 4
    assert "error[DXB-E351]: no Ray cluster answers at `" in answer.err
    assert gone.rpartition(":")[2] in answer.err
    assert time.monotonic() < began + 60


@pytest.fixture(scope="module")
def cluster() -> Iterator[Raylets]:
    with raylets() as found:
        yield found


@pytest.fixture
def sites(space: Space) -> Space:
    for site in "ab":
        space.write(
            f"rules/toy/at_{site}.py",
            WHERE.lstrip().replace("toy.where", f"toy.at_{site}").replace("NAME", f"at_{site}").replace("SITE", site),
        )
    space.write("recipes/toy/sites.yaml", RECIPE)
    space.write("words.txt", "one")
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nshared = {address = "shared", mode = "rw"}\n')
    return space


def on(cluster: Raylets, space: Space, *words: str, **environment: str) -> Answer:
    return space.run(
        "build", "--console", "jsonl", "--executor", f"ray:{cluster.address}", *words, env=environment or None
    )


def made(answer: Answer) -> dict[str, tuple[str, str]]:
    """Node -> (key, output) of all that ran."""
    return {
        event["node"]: (event["key"], event["output"])
        for event in answer.events
        if event["event"] == "node_finished" and event["status"] == "ran"
    }


def test_keys_and_bytes_are_those_of_one_machine(cluster: Raylets, sites: Space) -> None:
    answer = on(cluster, sites, "toy/sites")
    assert answer.code == 0, answer.err
    alone = sites.dxb(
        "build",
        "--console",
        "jsonl",
        "toy/sites",
        "--resources",
        "site:a=1,site:b=1",
        env={"DXB_CACHE": "alone", "DXB_NODE_STORE": "none", "DXB_REMOTES": "local:rw"},
    )
    assert alone.code == 0, alone.err
    assert made(answer) == made(alone)
    assert len(made(answer)) == 3
    assert any(event["event"] == "node_progress" for event in answer.events)
    for name, site in (("a", "a"), ("b", "b"), ("c", "a")):
        log = sites.dxb("log", "toy/sites", name)
        assert f"store {cluster.home}/store_{site}" in log.out
    assert on(cluster, sites, "toy/sites").nodes("ran") == set()


def test_a_failure_is_that_of_one_machine_and_the_rest_goes_on(cluster: Raylets, sites: Space) -> None:
    sites.write(
        "recipes/toy/fails.yaml",
        """
inputs: {text: words.txt}
nodes:
  bad: {rule: toy.slow, text: $text, do: fail}
  worse: {rule: toy.slow, text: $text, do: raise}
  good: {rule: toy.slow, text: $text}
  after: {rule: toy.slow, text: $bad}
targets: {default: [bad, worse, good, after]}
""",
    )
    answer = on(cluster, sites, "toy/fails", "-k")
    assert answer.code == 1
    assert answer.nodes("ran") == {"good"}
    assert answer.nodes("failed") == {"bad", "worse"}
    alone = sites.dxb("build", "--console", "jsonl", "toy/fails", "-k", env={"DXB_CACHE": "alone"})

    def errors(of: Answer) -> dict[str, dict]:
        return {e["node"]: e["error"] for e in of.events if e["event"] == "node_finished" and e["status"] == "failed"}

    assert errors(answer) == errors(alone)


VOICE = '''
"""Speaks with a voice."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="with a voice", profiles=("lab",), weights=("NAME",), gpu_gb=1.0)

def read(folder, device):
    with open("LOADS", "a") as file:
        file.write(f"NAME on {device}\\n")
    return (folder / "voice.txt").read_bytes()
'''
SPOKEN = '''
"""toy.NAME: says with which voice it speaks."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def NAME(ctx: Context, text: File) -> File:
    """Return the text with the voice's."""
    return File(data=text.data + ctx.load(ctx.backend.read, "NAME"))
'''
CHOIR = """
inputs: {text: words.txt}
nodes:
  a: {rule: toy.alto, text: $text}
  b: {rule: toy.bass, text: $a}
  c: {rule: toy.alto, text: $b}
  d: {rule: toy.bass, text: $c}
"""


def test_models_stay_loaded_beside_each_other_or_give_way(cluster: Raylets, sites: Space) -> None:
    loads = sites.root / "loads"
    for name in ("alto", "bass"):
        sites.write(f"rules/toy/{name}.py", SPOKEN.lstrip().replace("NAME", name))
        sites.write(f"rules/toy/{name}_voice.py", VOICE.lstrip().replace("NAME", name).replace("LOADS", str(loads)))
        sites.write(f"recipes/model/{name}.yaml", "summary: a voice\nlicence: MIT\nmemory_gb: 0.5\n")
    sites.write("recipes/profile/lab.yaml", "extends: cpu\n")
    sites.write("recipes/toy/choir.yaml", CHOIR)
    sites.write("voice.txt", "!")
    folder = {"DXB_MODELS": str(sites.root / "models"), "DXB_PROFILE": "lab"}
    for name in ("alto", "bass"):
        assert sites.dxb("models", "add", name, "voice.txt", env=folder).code == 0
    for gpu_memory, loaded in ((2, ["alto", "bass"]), (1, ["alto", "bass", "alto", "bass"])):
        answer = on(
            cluster,
            sites,
            "toy/choir",
            *(f"--force={name}" for name in "abcd"),
            "--resources",
            f"gpu_memory={gpu_memory}",
            **folder,
        )
        assert answer.code == 0, answer.err
        assert answer.nodes("ran") == set("abcd")
        assert loads.read_text().splitlines() == [f"{name} on cuda" for name in loaded]
        assert gone(cluster, 60.0)
        loads.unlink()


SLOW = "inputs: {text: words.txt}\nnodes:\n" + "".join(
    f"  s{n}: {{rule: toy.slow, text: $text, seconds: {2.0 + n / 1000}}}\n" for n in range(8)
)
SLOW += "targets: {default: [s0, s1, s2, s3, s4, s5, s6, s7]}\n"


def running(space: Space, cluster: Raylets, *words: str) -> subprocess.Popen[str]:
    """A build that has finished a node and runs others."""
    space.write("recipes/toy/slow.yaml", SLOW)
    build = space.start("build", "--console", "plain", "--executor", f"ray:{cluster.address}", "toy/slow", *words)
    assert build.stderr is not None
    said = []
    for line in build.stderr:
        said.append(line)
        if line.startswith("  +  "):
            return build
    raise AssertionError("".join(said))


def finish(build: subprocess.Popen[str]) -> str:
    try:
        return build.communicate(timeout=PATIENCE_S)[1]
    finally:
        build.kill()


def gone(cluster: Raylets, within_s: float) -> bool:
    end = time.monotonic() + within_s
    while cluster.workers() and time.monotonic() < end:
        time.sleep(0.1)
    return not cluster.workers()


def test_killed_workers_lose_nothing(cluster: Raylets, sites: Space) -> None:
    build = running(sites, cluster)
    for worker in cluster.workers():
        worker.kill()
    said = finish(build)
    assert build.returncode == 0, said
    assert "8 ran" in said


def test_code_that_was_edited_between_builds_runs_as_it_is_now(cluster: Raylets, sites: Space) -> None:
    assert on(cluster, sites, "toy/sites:a").code == 0
    first = made(on(cluster, sites, "toy/sites", "--force", "a"))["a"]
    sites.edit("rules/toy/at_a.py", 'b" a"', 'b" A"')
    answer = on(cluster, sites, "toy/sites")
    assert answer.code == 0, answer.err
    assert made(answer)["a"] != first
    assert sites.dxb("get", "toy/sites:a", "-o", "got").code == 0
    assert (sites.root / "got").is_dir()
    assert any(file.read_bytes().startswith(b"one A") for file in (sites.root / "got").rglob("*") if file.is_file())


def test_a_killed_driver_leaves_what_was_finished_and_no_process(cluster: Raylets, sites: Space) -> None:
    build = running(sites, cluster)
    assert cluster.workers()
    build.kill()
    build.communicate(timeout=30)
    assert gone(cluster, 60.0)
    answer = on(cluster, sites, "toy/slow")
    assert answer.code == 0
    assert answer.nodes("cached")
    assert len(answer.nodes("cached", "ran")) == 8


def test_an_interrupt_ends_it_all(cluster: Raylets, sites: Space) -> None:
    build = running(sites, cluster)
    build.send_signal(signal.SIGINT)
    finish(build)
    assert build.returncode == 130
    assert gone(cluster, 60.0)


def test_a_lost_node_loses_nothing(sites: Space) -> None:
    with raylets() as cluster:
        build = running(sites, cluster)
        cluster.end("b")
        said = finish(build)
    assert build.returncode == 0, said
    assert "8 ran" in said


def test_without_a_cluster_the_error_says_how_to_start_one(space: Space) -> None:
    answer = space.run("build", "say/words", "--executor", "ray:127.0.0.1:1", env=SHARED)
    assert answer.code == 4
    assert "error[DXB-E351]: no Ray cluster answers at `127.0.0.1:1`" in answer.err
    assert "hint: `ray start --head`" in answer.err
