"""Profiles: which backend is taken, what is said of one that is missing, and wrong profiles."""

from __future__ import annotations

import pytest

from dextera_build.engine import missing
from dextera_build.errors import MachineError, install_extra
from dextera_build.recipe import profiles
from dextera_build.recipe.plan import Request, plan


def planned(space, address, **request):
    project = space.project()
    return plan(address, project.recipe, project.library, project.root, Request(**request)).graph


def test_a_backend_that_is_not_installed_stands_in_the_plan_and_is_the_machines_fault(space):
    space.write("recipes/say/b.yaml", "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s, backend: cloud}}")
    rule = dict(planned(space, "say/b").calls())["t",].rule
    assert (rule.backend, rule.chosen, len(rule.missing)) == ("cloud", "recipe", 1)
    with pytest.raises(MachineError) as caught:
        missing.refuse([rule])
    assert caught.value.exit_code == 4
    assert caught.value.message == "backend `cloud` of toy.spoken is missing"
    assert caught.value.hint == install_extra("models")
    for verb in ("build", "plan"):
        answer = space.dxb(verb, "say/b")
        assert answer.code == 4
        assert "error[DXB-E301]: backend `cloud` of toy.spoken is missing" in answer.err
    assert "t\tmissing\ttoy.spoken\tcloud" in space.dxb("plan", "say/b").out
    assert space.dxb("build", "say/b:s").code == 0  # which needs no such backend
    told = space.dxb("plan", "say/b").err  # where nothing else is stale
    assert "1 cannot run here" in told
    assert "up to date" not in told


@pytest.mark.medium
def test_the_next_in_line_is_taken_only_where_the_recipe_says_so(space):
    text = "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s, backend: [cloud, quiet]}}"
    space.write("recipes/say/b.yaml", text)
    rule = dict(planned(space, "say/b").calls())["t",].rule
    assert (rule.backend, rule.passed, rule.missing) == ("quiet", ("cloud",), ())
    assert rule.chosen.startswith("recipe; cloud is missing: needs ")
    space.write("recipes/profile/lab.yaml", "extends: cpu\nbackends: {toy.spoken: [cloud, quiet]}")
    text = "nodes: {s: {rule: toy.start}, t: {rule: toy.spoken, text: $s}}"
    for head, taken in (("", "cloud"), ("fallback: true\n", "quiet")):
        space.write("recipes/say/b.yaml", head + text)
        profile = profiles.read("lab", space.root)
        assert dict(planned(space, "say/b", profile=profile).calls())["t",].rule.backend == taken
    built = space.dxb("build", "say/b", "--profile", "lab")
    assert built.code == 0
    assert "toy.spoken runs on quiet (profile lab; cloud is missing: needs " in built.err
    assert "toy.spoken runs on quiet" in space.dxb("log", "say/b", "--profile", "lab", "--json").out
    assert space.dxb("report", "say/b", "--profile", "lab", "-o", "page.html").code == 0
    assert "cloud is missing" in (space.root / "page.html").read_text()
    assert "lab\ttoy.spoken\tcloud,quiet\tlab" in space.dxb("ls", "profiles").out


ASKING = """inputs: {{note: {{help: A file.}}, name: {{help: Another.}}}}
nodes:
  words: {{rule: toy.split, text: $note}}
  copy:
    each: $note.items
    as: one
    nodes: {{loud: {{rule: toy.spoken, text: $one.part{backend}}}}}
  all: {{rule: toy.join, texts: $copy.loud}}
  more: {{rule: toy.shout, text: $name}}
targets: {{default: [all], more: [more]}}
"""


def test_a_plan_without_its_inputs_shows_the_backends_and_lists_inputs_and_backends_together(space):
    space.write("recipes/say/b.yaml", ASKING.format(backend=", backend: cloud"))
    answer = space.dxb("plan", "say/b", "--json")
    assert answer.code == 2
    rows = {row["node"]: row for row in answer.rows}
    assert {name: row["status"] for name, row in rows.items()} == {"copy.loud": "missing", "all": "unknown"}
    assert rows["copy.loud"]["needs"] == ["no-such-distribution"]
    assert rows["copy.loud"]["next"] == install_extra("models")
    assert "error[DXB-U105]: 2 inputs are not given, and 1 backend is missing" in answer.err
    for told in (
        "input `note` of",
        "A file.",
        "input `name` of",
        "needs no-such-distribution",
        install_extra("models"),
    ):
        assert told in answer.err
    assert "error[DXB-U105]: the input `note` of `say/b` is not given\n" in space.dxb("build", "say/b").err
    space.write("recipes/say/b.yaml", ASKING.format(backend=""))
    half = space.dxb("plan", "say/b", "--input", "name=dxb.toml")
    assert "error[DXB-U105]: the input `note` of `say/b` is not given\n" in half.err
    assert half.out.splitlines()[0] == "copy.loud\tunknown\ttoy.spoken\tquiet\t-\tprofile cpu"


@pytest.mark.slow
def test_the_plan_of_a_photograph_and_the_doctor_agree_on_what_the_models_need(space):
    answer = space.dxb("plan", "twin/from_photo", "--profile", "gpu", "--json")
    planned = {f"{row['rule']}={row['backend']}": row for row in answer.rows if row["status"] == "missing"}
    assert len(planned) >= 5  # without weights
    found = {row["what"]: row for row in space.dxb("doctor", "--profile", "gpu", "--json").rows}
    for name, row in planned.items():
        assert found[name]["found"].endswith(f"needs {', '.join(row['needs'])}")
        assert row["next"].startswith(found[name]["mend"])
        assert row["next"] in answer.err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("extends: lab", "the profile extends itself"),
        ("extends: nothing", "no profile is called `nothing`"),
        ("backends: {toy.spoken: []}", "backends of `toy.spoken`` is empty"),
        ("backends: 3", "`backends` is a mapping, this is number"),
        ("back: 3", "a profile has no `back`"),
    ],
)
def test_a_wrong_profile_says_where(space, text, message):
    space.write("recipes/profile/lab.yaml", text)
    answer = space.dxb("plan", "say/words", "--profile", "lab")
    assert answer.code == 2
    assert message in answer.err
