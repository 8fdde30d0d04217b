"""The asset library: a list, a search, and a folder with an index and a page that needs nothing else."""

from __future__ import annotations

import hashlib
import json
import re
from pathlib import Path

import pytest

from tests.e2e.space import Space
from tests.e2e.test_bad_captures import write_capture

BUILD = ("twin/tabletop", "--input", "capture=shot")


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Space:
    space = Space(tmp_path_factory.mktemp("library"))
    space.write("dxb.toml", 'cache = "cache"\nprofile = "stub"\n')
    write_capture(space.root / "shot")
    answer = space.dxb("build", *BUILD)
    assert answer.code == 0, answer.err
    return space


def rows(space: Space, *words: str) -> list[dict]:
    answer = space.dxb("library", "--json", *words)
    assert answer.code == 0, answer.err
    return answer.rows


@pytest.mark.slow
def test_it_lists_objects_and_backgrounds_with_their_facts(built):
    found = rows(built)
    assert {row["kind"] for row in found} == {"object", "background"}
    thing = next(row for row in found if row["kind"] == "object")
    assert thing["mass_low_kg"] <= thing["mass_kg"] <= thing["mass_high_kg"]
    assert thing["mass_kg"] > 0
    assert all(0.001 < edge < 1.0 for edge in thing["size_m"])
    assert thing["nodes"][0].startswith("twin/tabletop@")
    assert thing["nodes"][0].endswith(f"body[{thing['name']}].asset")
    (room,) = rows(built, "--kind", "background")
    assert (room["category"], room["mass_kg"]) == ("room", None)
    lines = built.dxb("library").out.splitlines()
    assert [line.split("\t")[:3] for line in lines] == [[r["kind"], r["name"], r["category"]] for r in found]


@pytest.mark.slow
def test_every_word_of_a_search_must_fit(built):
    thing = next(row for row in rows(built) if row["kind"] == "object")
    assert thing in rows(built, thing["name"], thing["material"].upper())
    assert rows(built, thing["name"], "no_such_word") == []


@pytest.mark.slow
def test_the_folder_has_an_index_a_page_and_the_files(built, tmp_path):
    answer = built.dxb("library", "-o", str(tmp_path / "lib"))
    assert answer.code == 0, answer.err
    index = json.loads((tmp_path / "lib" / "index.json").read_text())
    assert index["form"] == 1
    assert [row["digest"] for row in index["assets"]] == [row["digest"] for row in rows(built)]
    page = (tmp_path / "lib" / "index.html").read_text()
    assert not re.findall(r"(?:src|href)=\"(?!data:|#)", page)
    for row in index["assets"]:
        assert row["folder"] == f"assets/{row['digest'][:16]}"
        assert row["meshes"]
        for path in (row["thumbnail"], *row["meshes"], *([row["urdf"]] if row["urdf"] else [])):
            assert (tmp_path / "lib" / path).is_file()
        assert f'id="{row["digest"][:16]}"' in page
    assert any(row["urdf"] for row in index["assets"])


def content(folder: Path) -> dict[str, str]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.slow
def test_the_same_assets_give_the_same_files(built, tmp_path):
    for name in ("a", "b", "a"):
        written = built.dxb("library", "-o", str(tmp_path / name), "--json").document["files"]
        assert [Path(file).name for file in written] == ["index.json", "index.html"]
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_a_folder_of_other_files_is_left_alone(built, tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    answer = built.dxb("library", "-o", str(tmp_path))
    assert answer.code == 2
    assert "holds files that are no asset library" in answer.err
    assert content(tmp_path).keys() == {"notes.txt"}


@pytest.mark.slow
def test_a_replaced_asset_is_shown_only_with_all(built):
    before = {row["digest"] for row in rows(built, "--kind", "object")}
    built.write("dxb.toml", 'cache = "cache"\nprofile = "stub"\n')
    text = (built.root / "shot" / "capture.json").read_text()
    built.write("shot/capture.json", text.replace('"depth_scale_m": 0.001', '"depth_scale_m": 0.0011'))
    assert built.dxb("build", *BUILD).code == 0
    now = {row["digest"] for row in rows(built, "--kind", "object")}
    assert now
    assert now != before
    assert {row["digest"] for row in rows(built, "--kind", "object", "--all")} == now | before


def test_an_empty_library_says_so(tmp_path):
    space = Space(tmp_path)
    space.write("dxb.toml", 'cache = "cache"\n')
    answer = space.dxb("library", "-o", "lib")
    assert answer.code == 2
    assert "no asset is in the store" in answer.err
