"""Resources, retries and use, through the real `dxb`."""

from __future__ import annotations

import pytest

from tests.e2e.space import Space

HUNGRY = '''
"""toy.hungry: says which devices it sees."""
import os
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1, gpus=1, resources={"licence:solver": 1})
def hungry(ctx: Context, text: File) -> File:
    """Return the devices."""
    return File(data=os.environ["CUDA_VISIBLE_DEVICES"].encode())
'''
SHY = HUNGRY.replace("hungry", "shy").replace(', gpus=1, resources={"licence:solver": 1}', "")
FLAKY = '''
"""toy.flaky: the server answers the third time."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1, retries=2, retry_wait_s=0.01)
def flaky(ctx: Context, text: File) -> File:
    """Return the text."""
    count = ctx.keep / "count"
    tries = int(count.read_text()) + 1 if count.exists() else 1
    count.write_text(str(tries))
    if tries < 3:
        raise ConnectionResetError("the server went away")
    return text
'''
RECIPE = """
inputs: {text: words.txt}
nodes:
  a: {rule: toy.hungry, text: $text}
  b: {rule: toy.shy, text: $text}
"""


@pytest.fixture
def hungry(space: Space) -> Space:
    space.write("rules/toy/hungry.py", HUNGRY.lstrip())
    space.write("rules/toy/shy.py", SHY.lstrip())
    space.write("recipes/toy/needs.yaml", RECIPE)
    space.write("words.txt", "one")
    return space


def test_what_the_machine_lacks_is_said_at_once(hungry: Space) -> None:
    answer = hungry.dxb("build", "toy/needs:a", "--console", "plain", "--resources", "gpu=0")
    assert answer.code == 1
    assert "it needs 1 of `gpu`, 1 of `licence:solver`, which is more than there is" in answer.err
    assert "error[DXB-E345]" in answer.err
    assert "`gpu` here              0" in answer.err
    assert "--resources gpu=1" in answer.err


def test_the_table_of_another_file_is_named(hungry: Space) -> None:
    hungry.write("dxb.toml", "[tool.dxb.resources]\ngpu = 2\n")
    answer = hungry.dxb("show", "--config")
    assert answer.code == 2
    assert "error[DXB-R401]: `tool` is not a setting" in answer.err
    assert "hint: settings stand here without `tool.dxb`: `[resources]`, not `[tool.dxb.resources]`" in answer.err


@pytest.mark.medium
def test_declared_resources_are_given_out(hungry: Space) -> None:
    hungry.write("dxb.toml", 'cache = "cache"\n[resources]\ngpu = 2\n"licence:solver" = 1\n')
    assert hungry.build("toy/needs", "-k").code == 0
    assert (hungry.root / hungry.dxb("get", "toy/needs:a", "-o", "a").out.strip()).read_bytes() == b"0"
    assert (hungry.root / hungry.dxb("get", "toy/needs:b", "-o", "b").out.strip()).read_bytes() == b""
    shown = hungry.dxb("show", "--config", env={"DXB_RESOURCES": "memory=3"}).out
    assert "resources\tgpu=2,licence:solver=1,memory=3\tenvironment" in shown


@pytest.mark.medium
def test_editing_resources_and_retries_rebuilds_nothing(hungry: Space) -> None:
    assert hungry.build("toy/needs", "--resources", "gpu=2,licence:solver=1").code == 0
    hungry.edit("rules/toy/hungry.py", "gpus=1", "gpus=2, cpus=2, memory_gb=3.0, retries=4")
    answer = hungry.build("toy/needs", "--resources", "gpu=0")
    assert (answer.code, answer.nodes("cached")) == (0, {"a", "b"})
    hungry.edit("rules/toy/hungry.py", "version=1", "version=2")
    assert hungry.dxb("plan", "toy/needs").out.splitlines()[0].split("\t")[:2] == ["a", "stale"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gpus=1", "`gpus` is not a resource"),
        ("memory=lots", "resource `memory` is a number from zero up, not `lots`"),
        ("gpu=-1", "resource `gpu` is a number from zero up, not `-1`"),
        ("gpu", "`gpu` is not of the form `NAME=AMOUNT,...`"),
    ],
)
def test_wrong_resources_are_named(hungry: Space, text: str, said: str) -> None:
    answer = hungry.dxb("build", "toy/needs", "--resources", text)
    assert answer.code == 2
    assert said in answer.err


def test_a_flaky_rule_is_tried_again(space: Space) -> None:
    space.write("rules/toy/flaky.py", FLAKY.lstrip())
    space.write("recipes/toy/net.yaml", "inputs: {text: words.txt}\nnodes: {a: {rule: toy.flaky, text: $text}}\n")
    space.write("words.txt", "one")
    answer = space.dxb("build", "toy/net", "--console", "plain")
    assert answer.code == 0, answer.err
    assert answer.err.count("try ") == 2
    assert "ConnectionResetError: the server went away" in answer.err
    (finished,) = (e for e in space.dxb("log", "--json").rows if e["event"] == "node_finished")
    assert finished["tries"] == 3
    assert finished["usage"]["memory_bytes"] > 1e6
    assert space.dxb("show", "--json", "toy/net:a").document["usage"]["cpu_seconds"] >= 0
    assert " of processor, " in space.dxb("show", "toy/net:a").out
    report = (space.root / space.dxb("report").out.strip()).read_text()
    assert " of processor, " in report
