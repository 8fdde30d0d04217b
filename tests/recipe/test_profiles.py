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
