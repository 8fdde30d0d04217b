"""A secret that a rule asked for reaches the service, and nothing else; files of a project hold none."""

from __future__ import annotations

import base64

import pytest

from tests.e2e.space import Answer, Space

SECRET = "geheim-0123456789"
RULE = '''
"""toy.whisper: does with a secret what it should not."""
import base64
import os
import sys
import numpy
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class WhisperOptions(Options):
    """Options."""
    how: str = "nothing"
    """What it does."""

@rule(version=1)
def whisper(ctx: Context, *, options: WhisperOptions) -> File:
    """Return a text."""
    key = ctx.secret("FORGE_PASS")
    print("printed", key, flush=True)
    print("to stderr", key, file=sys.stderr, flush=True)
    ctx.log(f"logged {key}")
    ctx.progress(1, 2, f"shown {key}")
    ctx.say(f"said {key}")
    ctx.metric(f"measured {key}", 1.0, f"per {key}")
    ctx.preview(numpy.zeros((4, 4, 3), "uint8"), f"seen {key}")
    print(base64.b64encode(f"anna:{key}".encode()).decode())
    if options.how == "raise":
        raise ValueError(f"called with {key}")
    if options.how == "fail":
        ctx.fail(f"called with {key}", key=key, hint=key)
    if options.how == "die":
        os.kill(os.getpid(), 9)
    sent = []
    ctx.call("forge", {"q": 1}, lambda seconds: sent.append(key) or b"done")
    return File(data=key.encode() if options.how == "return" else b"done")
'''


@pytest.fixture
def whispering(space: Space, monkeypatch: pytest.MonkeyPatch) -> Space:
    # The name alone does not tell that it is a secret; that the rule asked for it does.
    monkeypatch.setenv("FORGE_PASS", SECRET)
    space.write("rules/toy/whisper.py", RULE.lstrip())
    space.write("recipes/say/whisper.yaml", "nodes:\n  w: {rule: toy.whisper}\ntargets: {default: [w]}\n")
    return space


@pytest.mark.medium
@pytest.mark.parametrize(
    ("how", "code"),
    [
        ("nothing", ""),
        ("raise", "DXB-B302"),
        ("fail", "DXB-B202"),
        ("die", "DXB-B301"),
        ("return", "DXB-B363"),
    ],
)
def test_a_secret_is_shown_and_written_nowhere(whispering: Space, how: str, code: str) -> None:
    words = ("build", "say/whisper", "--set", f"w.how={how}")
    answers = [whispering.dxb(*words, "-v", "--console", "plain"), whispering.dxb(*words, "--console", "jsonl")]
    assert [answer.code for answer in answers] == ([1, 1] if code else [0, 0]), answers[0].err
    assert code in answers[0].err
    answers += [whispering.dxb("log"), whispering.dxb("log", "0001", "w"), whispering.dxb("report", "--out", "r.html")]
    assert "printed ***" in answers[3].out
    assert holders(whispering, answers, SECRET) == []
    assert holders(whispering, answers, base64.b64encode(f"anna:{SECRET}".encode()).decode()) == []


def holders(space: Space, answers: list[Answer], secret: str) -> list[str]:
    """Files and printed texts that hold a secret."""
    files = [path for path in space.root.rglob("*") if path.is_file()]
    assert len(files) > 10
    printed = [text for answer in answers for text in (answer.out, answer.err) if secret in text]
    return printed + [str(path) for path in files if secret.encode() in path.read_bytes()]


GOSSIP = '''
"""toy.gossip: passes its environment on."""
import os
import subprocess
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, Options, rule

class GossipOptions(Options):
    """Options."""
    how: str = "return"
    """What it does."""

@rule(version=1)
def gossip(ctx: Context, *, options: GossipOptions) -> File:
    """Return its environment."""
    assert "DXB_REMOTE_TOKEN" not in os.environ
    assert len(ctx.secret("DXB_REMOTE_TOKEN")) == 12
    print(dict(os.environ), os.environ.get("LAB_WORD"))
    subprocess.run(["env"], check=True)
    if options.how == "raise":
        raise RuntimeError(str(dict(os.environ)))
    named = {name: value for name, value in os.environ.items() if name != "LAB_WORD"}
    return File(data=repr(named).encode())
'''


@pytest.mark.medium
@pytest.mark.parametrize("how", ["return", "raise"])
def test_secrets_of_dxb_reach_neither_a_log_nor_a_result(space: Space, how: str) -> None:
    space.write("rules/toy/gossip.py", GOSSIP.lstrip())
    space.write("recipes/say/gossip.yaml", "nodes:\n  g: {rule: toy.gossip}\ntargets: {default: [g]}\n")
    space.write("dxb.toml", 'cache = "cache"\n[remotes]\nlab = "http://a:${LAB_WORD}@127.0.0.1:9/x"\n')
    secret = {
        "DXB_REMOTE_TOKEN": "geheim-token",
        "DXB_REMOTES": "local:rw,lab:r,http://u:geheim-address@127.0.0.1:9/x:r",
        "DXB_KEY_PASSPHRASE": "geheim-phrase",
        "LAB_WORD": "geheim-of-lab",
    }
    built = space.dxb("build", "say/gossip", "--set", f"g.how={how}", "-v", env=secret)
    assert built.code == (1 if how == "raise" else 0), built.err
    answers = [built, space.dxb("log", "0001", "g"), space.dxb("report", "--out", "r.html")]
    assert "***" in answers[1].out
    assert holders(space, answers, "geheim") == []


@pytest.mark.medium
def test_a_secret_that_there_is_not_is_a_clear_error(whispering: Space, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("FORGE_PASS")
    answer = whispering.dxb("build", "say/whisper")
    assert answer.code == 1
    assert "error[DXB-E366]" in answer.err
    assert "there is no secret `FORGE_PASS`" in answer.err


@pytest.mark.parametrize(
    ("file", "text", "place"),
    [
        ("recipes/say/whisper.yaml", "nodes:\n  w: {rule: toy.whisper, how: KEY}\n", "whisper.yaml:2:31"),
        ("recipes/say/whisper.yaml", "# KEY\nnodes: {}\n", "whisper.yaml:1:3"),
        ("dxb.toml", "[services.forge]\nconcurrent = 1\nkey = 'KEY'\n", "dxb.toml:3:8"),
    ],
)
def test_a_secret_in_a_file_of_the_project_is_refused(
    whispering: Space, monkeypatch: pytest.MonkeyPatch, file: str, text: str, place: str
) -> None:
    monkeypatch.setenv("FORGE_API_KEY", "another-0123456")
    whispering.write(file, text.replace("KEY", "another-0123456"))
    answer = whispering.dxb("build", "say/whisper")
    assert answer.code == 2
    assert "error[DXB-R406]" in answer.err
    assert "holds the value of `FORGE_API_KEY`" in answer.err
    assert place in answer.err
    assert "another-0123456" not in answer.err


def test_a_secret_on_the_command_line_of_a_recipe_is_refused(whispering: Space) -> None:
    key = "sk-" + "a1" * 16
    answer = whispering.dxb("build", "say/whisper", "--set", f"w.how={key}")
    assert answer.code == 2
    assert "error[DXB-R406]: `--set w.how` holds what looks like a secret key" in answer.err


def test_a_field_for_a_secret_is_refused(whispering: Space) -> None:
    whispering.write("dxb.toml", '[services.forge]\napi_key = "x"\n')
    answer = whispering.dxb("build", "say/whisper")
    assert "error[DXB-R406]: `services.forge.api_key` would hold a secret" in answer.err
