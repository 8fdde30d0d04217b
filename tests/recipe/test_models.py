"""Models of a project: descriptions, keys, what a plan says of missing ones, a build with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dextera_build.errors import RecipeError
from dextera_build.recipe import models
from tests.recipe.conftest import Space

BACKEND = '''
"""Speaks as a voice does."""
from dextera_build.rule import Backend
from dextera_build.artifacts.base import File
LOADS = "{loads}"
BACKEND = Backend(summary="with a voice", profiles=("lab",), weights=("voice",))

def read(folder, device):
    with open(LOADS, "a") as file:
        file.write(f"{device} ")
    return (folder / "voice.txt").read_bytes()

def speak(text):
    raise AssertionError
'''
RULE = '''
"""toy.spoken: a rule with backends."""
from dextera_build.artifacts.base import File
from dextera_build.rule import Context, rule

@rule(version=1)
def spoken(ctx: Context, text: File) -> File:
    """Return the text as spoken."""
    if not hasattr(ctx.backend, "read"):
        return ctx.backend.speak(text)
    file = ctx.weights("voice") / "voice.txt"
    return File(data=text.data + ctx.load(ctx.backend.read, "voice") + file.read_bytes())
'''
RECIPE = "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s}, u: {rule: toy.spoken, text: $t}}"
VOICE = "summary: a voice\nlicence: Research\nforbids: commercial use\nmemory_gb: 0.5\n"


class Voiced(Space):
    """A project with a model; `settings` are more variables."""

    settings: dict[str, str]

    def environment(self, **more: str) -> dict[str, str]:
        return super().environment(DXB_MODELS=str(self.root / "models"), DXB_PROFILE="lab", **self.settings, **more)


@pytest.fixture
def voiced(space):
    space = Voiced(space.root)
    space.settings = {}
    space.write("rules/toy/spoken.py", RULE.lstrip())
    space.write("rules/toy/spoken_voice.py", BACKEND.lstrip().replace("{loads}", str(space.root / "loads")))
    space.write("recipes/profile/lab.yaml", "extends: cpu\n")
    space.write("recipes/model/voice.yaml", VOICE)
    space.write("recipes/say/b.yaml", RECIPE)
    return space


@pytest.mark.medium
def test_a_backend_waits_for_its_weights_and_its_licence_then_runs_and_loads_once(voiced):
    refused = voiced.dxb("build", "say/b")
    assert refused.code == 4
    assert "backend `voice` of toy.spoken is missing" in refused.err
    assert "the licence of `voice`, which forbids commercial use, the weights `voice`" in refused.err
    assert "`dxb models accept voice`, `dxb models get voice`" in refused.err
    assert "voice\tmissing" in voiced.dxb("models", "ls").out
    assert voiced.dxb("models", "accept", "voice").out == "voice\tResearch\tcommercial use\n"
    assert voiced.dxb("models", "accept", "voice", "--json").rows[0]["forbids"] == "commercial use"
    voiced.write("voice.txt", "!")
    assert voiced.dxb("models", "add", "voice", "voice.txt").code == 0
    built = voiced.dxb("build", "say/b")
    assert built.code == 0, built.err
    assert (voiced.root / "loads").read_text() == "cpu "  # two nodes, one worker
    assert "0 ran" in voiced.dxb("build", "say/b").err or "up to date" in voiced.dxb("build", "say/b").err


def test_weights_of_a_backend_that_another_uses_are_in_its_key(voiced):
    voiced.settings["DXB_ACCEPT_LICENCES"] = "voice"
    voiced.write(
        "rules/toy/spoken_choir.py",
        '''
"""Speaks with the voice of another backend."""
from dextera_build.rule import Backend
BACKEND = Backend(summary="with another's voice", profiles=("choir",), uses=("voice",))

def speak(ctx, text):
    return ctx.other("voice").tell(text)
'''.lstrip(),
    )
    voice = (voiced.root / "rules/toy/spoken_voice.py").read_text()
    tell = '\ndef tell(ctx, text, options):\n    return File(data=text.data + ctx.load(read, "voice"))\n'
    voiced.write("rules/toy/spoken_voice.py", voice + tell)
    speak = ("ctx.backend.speak(text)", "ctx.backend.speak(ctx, text)")
    voiced.write("rules/toy/spoken.py", RULE.lstrip().replace(*speak))
    voiced.write("recipes/say/b.yaml", RECIPE.replace("toy.spoken, ", "toy.spoken, backend: choir, "))
    for word in "!?":
        voiced.write("voice.txt", word)
        assert voiced.dxb("models", "add", "voice", "voice.txt").code == 0
        built = voiced.dxb("build", "--console", "plain", "say/b")
        assert built.code == 0, built.err
    assert (voiced.root / "loads").read_text() == "cpu cpu "  # the other weights made the nodes stale


@pytest.mark.medium
def test_other_weights_make_their_nodes_stale_and_no_others(voiced):
    voiced.settings["DXB_ACCEPT_LICENCES"] = "voice"
    voiced.write("a/voice.txt", "!")
    voiced.write("b/voice.txt", "?")
    assert voiced.dxb("models", "add", "voice", "a").code == 0
    assert voiced.dxb("build", "say/b").code == 0
    assert voiced.dxb("models", "add", "voice", "b").code == 0
    plan = voiced.dxb("plan", "say/b").out
    assert "s\tcached" in plan
    assert "t\tcached" not in plan
    why = voiced.dxb("why", "say/b:t").out
    assert "weights" in why
    assert "voice" in why
    models = {row["model"]: row for row in voiced.dxb("models", "ls", "--json").rows}
    digest = models["voice"]["digest"]
    assert voiced.dxb("build", "say/b").code == 0
    first = next(row for row in (voiced.root / "models" / "voice").glob("*.json") if digest[:12] not in row.name)
    voiced.write("recipes/model/voice.yaml", VOICE + f"digest: {json.loads(first.read_text())['digest']}\n")
    assert "t\tcached" in voiced.dxb("plan", "say/b").out  # the version that the description names


def test_weights_of_another_version_than_described_are_refused(voiced):
    voiced.write("recipes/model/voice.yaml", VOICE + f"digest: {'ab' * 32}\n")
    voiced.write("voice.txt", "!")
    answer = voiced.dxb("models", "add", "voice", "voice.txt")
    assert answer.code == 4
    assert "error[DXB-E388]: these are not the weights of `voice`" in answer.err
    assert voiced.dxb("models", "verify").out == ""


@pytest.mark.medium
def test_damage_is_found_and_a_file_that_is_gone_counts_as_missing(voiced):
    voiced.settings["DXB_ACCEPT_LICENCES"] = "voice"
    voiced.write("voice.txt", "!")
    folder = Path(voiced.dxb("models", "add", "voice", "voice.txt", "--json").rows[0]["folder"])
    assert voiced.dxb("models", "verify").out.endswith("\t-\n")
    (folder / "voice.txt").chmod(0o644)
    (folder / "voice.txt").write_text("?")
    assert voiced.dxb("models", "verify", "voice").out.endswith("\tvoice.txt\n")
    (folder / "voice.txt").unlink()
    assert "voice.txt of the weights `voice`" in voiced.dxb("build", "say/b").err
    assert "incomplete" in voiced.dxb("models", "ls").out
    assert voiced.dxb("models", "verify", "--json").rows[0]["damaged"] == ["voice.txt"]
    (gone,) = voiced.dxb("models", "rm", "voice", "--json").rows
    assert (gone["model"], gone["bytes"]) == ("voice", 1)
    assert "missing" in voiced.dxb("models", "ls").out


def test_an_undeclared_model_is_refused(voiced):
    voiced.settings["DXB_ACCEPT_LICENCES"] = "voice"
    voiced.write("voice.txt", "!")
    voiced.dxb("models", "add", "voice", "voice.txt")
    voiced.write("rules/toy/spoken.py", RULE.lstrip().replace('ctx.weights("voice")', 'ctx.weights("voices")'))
    answer = voiced.dxb("build", "say/b")
    assert "the backend does not declare the weights `voices`" in answer.err
    assert "did you mean `voice`?" in answer.err


def test_weights_that_nothing_describes_are_the_recipes_fault(voiced):
    (voiced.root / "recipes/model/voice.yaml").unlink()
    voiced.write("recipes/model/voices.yaml", VOICE)
    answer = voiced.dxb("plan", "say/b")
    assert "error[DXB-R213]: no model is called `voice`" in answer.err
    assert "did you mean `voices`?" in answer.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("summary: x", "the model `voice` has no `licence`"),
        ("licence: x", "the model `voice` has no `summary`"),
        ("summary: x\nlicence: y\nsource: ftp://x", "`ftp://x` is not a source of a model"),
        ("summary: x\nlicence: y\ndigest: abc", "`abc` is not a digest of a model"),
        ("summary: x\nlicence: y\nmemory_gb: -1", "`memory_gb` is a number of GiB from zero up"),
        ("summary: x\nlicence: y\nsize: 3", "a model has no `size`"),
    ],
)
def test_a_wrong_description_says_where(space, text, message):
    space.write("recipes/model/voice.yaml", text)
    with pytest.raises(RecipeError) as caught:
        models.read("voice", space.root)
    assert message in caught.value.message


def test_what_is_not_there_cannot_be_added(voiced):
    assert "error[DXB-U205]: `nothing` is not there" in voiced.dxb("models", "add", "voice", "nothing").err


def test_every_bundled_model_can_be_read():
    for name in models.names(None):
        model = models.read(name, None)
        assert model.summary
        assert model.licence


@pytest.mark.slow
def test_the_doctor_tells_of_weights_licence_and_memory_and_runs_the_self_test(voiced):
    def row(*flags: str) -> dict[str, object]:
        rows = voiced.dxb("doctor", "--json", *flags).rows
        return next(row for row in rows if row["what"] == "toy.spoken=voice")

    told = row()
    assert not told["ok"]
    assert "weights voice (not installed; Research); 0.5 GiB for weights; needs the licence" in told["found"]
    assert told["mend"] == "`dxb models accept voice`, `dxb models get voice`"
    voiced.settings["DXB_ACCEPT_LICENCES"] = "voice"
    voiced.write("voice.txt", "!")
    voiced.dxb("models", "add", "voice", "voice.txt")
    assert row()["ok"]
    rules = BACKEND.lstrip().replace("{loads}", str(voiced.root / "loads"))
    voiced.write(
        "rules/toy/spoken_voice.py", f"{rules}\ndef self_test(ctx):\n    assert ctx.load(read, 'voice') == b'?'\n"
    )
    assert "self-test: AssertionError" in row("--self-test", "toy.spoken")["found"]
    voiced.edit("rules/toy/spoken_voice.py", "b'?'", "b'!'")
    assert row("--self-test", "toy.spoken")["ok"]


def test_memory_that_runs_out_ends_in_one_error(space):
    text = RULE.lstrip()[: RULE.lstrip().index("    if not")] + "    return File(data=bytes(1 << 60))\n"
    space.write("rules/toy/spoken.py", text)
    space.write("recipes/say/b.yaml", "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s}}")
    answer = space.dxb("build", "say/b")
    assert answer.code == 1
    assert "the machine's memory is used up" in answer.err
    assert "Traceback" not in answer.err
