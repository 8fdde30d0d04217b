"""Places in `out/`: nothing shares a folder, and the common ones have plain names."""

from __future__ import annotations

import os
from itertools import product
from pathlib import Path

import pytest

from dextera_build.building import places
from dextera_build.building.places import name_of
from dextera_build.project.project import Project
from dextera_build.runs import workspaces


def project(root: Path, cache: str = "cache", *recipes: str) -> Project:
    (root / "recipes").mkdir(parents=True, exist_ok=True)
    (root / "dxb.toml").write_text(f'cache = "{cache}"\n')
    for recipe in recipes:
        path = root / "recipes" / f"{recipe}.yaml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("")
    return Project(root)


def folder(made: Project, recipe: str = "g", variant: str = "") -> str:
    return places.of(made, recipe, variant).folder


def test_in_a_projects_own_store_the_names_are_those_of_recipe_and_node(tmp_path: Path) -> None:
    made = project(tmp_path)
    assert folder(made, "twin/laptop_scene") == f"{tmp_path}/cache/out/twin/laptop_scene"
    assert folder(made, "g", "@stub-12345678") == f"{tmp_path}/cache/out/g@stub-12345678"
    assert name_of("body[blue_mug].mesh") == "body.blue_mug.mesh"


def test_recipes_requests_and_nodes_never_share_a_folder(tmp_path: Path) -> None:
    recipes = ("g", "g/a", "g/a/b", "g@a-12345678", "g%2Fa", "h/a", "h/a/b", "i/j/k")
    made = project(tmp_path, "cache", *recipes)
    nodes = ("a", "b", "x[a:b].c", "x[a.b].c", "x[a%3Ab].c", "x[a].b[c].d", "x[a.b.c].d", "g/a:b", "g.a.b")
    found = {
        (recipe, variant, node): f"{folder(made, recipe, variant)}/{name_of(node)}"
        for recipe, variant, node in product(recipes, ("", "@a-12345678"), nodes)
    }
    assert len(set(found.values())) == len(found)
    for one, other in product(found.values(), repeat=2):
        assert not one.startswith(f"{other}/")
    assert folder(made, "g") == f"{tmp_path}/cache/out/g"
    assert folder(made, "i/j/k") == f"{tmp_path}/cache/out/i/j/k"


def test_a_long_name_is_cut_and_stays_its_own() -> None:
    one, other = (name_of(f"b[{'ü' * 90}].c[{':' * 90}].{end}") for end in "de")
    assert one != other
    assert max(len(name.encode()) for name in (one, other)) <= 230


def test_in_a_shared_store_every_workspace_has_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shared = tmp_path / "store"
    shared.mkdir()
    one, other = (project(tmp_path / name / "lab", str(shared)) for name in ("ada", "bob"))
    assert Path(folder(one)).is_relative_to(shared / "out")
    assert Path(folder(one)).parent.name.startswith("lab-")
    found = {folder(one), folder(other)}
    monkeypatch.setattr(workspaces, "_machine", lambda: "elsewhere")
    found.add(folder(one))
    assert len(found) == 3


def test_a_link_to_a_shared_store_is_seen(tmp_path: Path) -> None:
    (tmp_path / "store").mkdir()
    one, other = (project(tmp_path / name) for name in ("one", "other"))
    for made in (one, other):
        (made.root / "cache").symlink_to(tmp_path / "store")
    assert os.path.realpath(folder(one)) != os.path.realpath(folder(other))


def test_the_store_of_an_inner_project_is_not_the_outer_ones(tmp_path: Path) -> None:
    inner, outer = project(tmp_path / "inner"), project(tmp_path, "inner/cache")
    assert folder(inner) == f"{tmp_path}/inner/cache/out/g"
    assert folder(outer) != folder(inner)


def test_what_cannot_be_placed_in_a_shared_store_lies_in_the_project(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "store").mkdir()
    made = project(tmp_path / "lab", str(tmp_path / "store"))
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    assert folder(made) == f"{tmp_path}/lab/cache/out/g"
