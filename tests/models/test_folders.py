"""Folders with installed models."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.errors import MachineError
from dextera_build.models.folders import ModelFolders, damaged, hashed, incomplete
from dextera_build.models.model import Installed, ModelFile, digest_of


def filled(**files: bytes) -> Callable[[Path], str]:
    """A function that writes files."""

    def fill(folder: Path) -> str:
        for name, data in files.items():
            (folder / name).write_bytes(data)
        return "here"

    return fill


@pytest.fixture
def folders(tmp_path: Path) -> ModelFolders:
    return ModelFolders([tmp_path / "own", tmp_path / "shared"])


def test_an_installed_model_is_found_with_its_digest(folders: ModelFolders) -> None:
    made = folders.install("tiny", filled(a=b"1", b=b"22"))
    assert folders.find("tiny") == folders.find("tiny", made.digest) == made
    assert [(file.path, file.size) for file in made.files] == [("a", 1), ("b", 2)]
    assert (made.size, made.source, list(folders.all())) == (3, "here", [made])
    assert (made.folder / "b").read_bytes() == b"22"
    assert folders.find("tiny", "0" * 64) is None
    assert folders.find("other") is None


def test_the_same_files_have_the_same_digest_wherever_they_lie(tmp_path: Path) -> None:
    one, two = (ModelFolders([tmp_path / name]).install("tiny", filled(a=b"1", b=b"2")) for name in "xy")
    assert one.digest == two.digest
    other = ModelFolders([tmp_path / "x"]).install("tiny", filled(a=b"1", b=b"3"))
    assert other.digest != one.digest


@given(st.dictionaries(st.text("ab/", min_size=1, max_size=4), st.integers(0, 3), max_size=4))
def test_the_digest_does_not_depend_on_the_order(sizes: dict[str, int]) -> None:
    files = tuple(ModelFile(path, size, "0" * 64) for path, size in sizes.items())
    assert digest_of(files) == digest_of(tuple(reversed(files)))


def test_the_version_installed_last_is_taken_and_an_earlier_one_by_its_digest(folders: ModelFolders) -> None:
    old, new = folders.install("tiny", filled(a=b"old")), folders.install("tiny", filled(a=b"new"))
    os.utime(f"{old.folder}.json", (1, 1))
    assert folders.find("tiny") == new
    assert folders.find("tiny", old.digest) == old
    folders.remove(new)
    assert folders.find("tiny") == old


def test_a_shared_folder_is_searched_after_the_own_one(folders: ModelFolders) -> None:
    shared = ModelFolders(folders.folders[1:]).install("tiny", filled(a=b"shared"))
    assert folders.find("tiny") == shared
    own = folders.install("tiny", filled(a=b"own"))
    assert folders.find("tiny") == own


def test_lost_and_changed_files_are_seen(folders: ModelFolders) -> None:
    made = folders.install("tiny", filled(a=b"1", b=b"22"))
    assert (incomplete(made), damaged(made)) == ([], [])
    os.chmod(made.folder / "b", 0o644)
    (made.folder / "b").write_bytes(b"23")
    assert (incomplete(made), damaged(made)) == ([], ["b"])
    (made.folder / "a").unlink()
    assert (incomplete(made), damaged(made)) == (["a"], ["a", "b"])
    assert damaged(folders.install("tiny", filled(a=b"1", b=b"22"))) == []


def test_what_an_interrupted_installation_left_does_not_count_and_is_completed(folders: ModelFolders) -> None:
    def broken(folder: Path) -> str:
        filled(a=b"1")(folder)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        folders.install("tiny", broken)
    assert folders.find("tiny") is None
    made = folders.install("tiny", filled(b=b"2"))
    assert [file.path for file in made.files] == ["a", "b"]


def test_nothing_is_no_model(folders: ModelFolders) -> None:
    with pytest.raises(MachineError, match="`tiny` has no files"):
        folders.install("tiny", filled())


def test_hidden_files_are_no_part_of_a_model(folders: ModelFolders, tmp_path: Path) -> None:
    (tmp_path / ".cache").mkdir()
    (tmp_path / ".cache" / "x").write_bytes(b"1")
    (tmp_path / "w").write_bytes(b"1")
    assert [file.path for file in hashed(tmp_path)] == ["w"]


@pytest.mark.parametrize(
    "text", ["", "{}", '{"digest": "0", "source": "", "files": []}', '{"files": [["../a", 1, "0"]]}']
)
def test_a_damaged_list_is_told(folders: ModelFolders, text: str) -> None:
    made = folders.install("tiny", filled(a=b"1"))
    Path(f"{made.folder}.json").write_text(text)
    with pytest.raises(MachineError, match="the list of a model's files is damaged"):
        folders.find("tiny")


def test_no_file_outside_the_folder_is_a_part_of_a_model(folders: ModelFolders) -> None:
    import json

    made = folders.install("tiny", filled(a=b"1"))
    files = (ModelFile("../../x", 1, "0" * 64),)
    document = {"digest": digest_of(files), "source": "", "files": [list(file) for file in files]}
    Path(f"{made.folder}.json").write_text(json.dumps(document))
    with pytest.raises(MachineError, match="damaged"):
        folders.find("tiny")


def test_a_folder_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "own").write_text("")
    with pytest.raises(MachineError, match="cannot be written") as caught:
        ModelFolders([tmp_path / "own"]).install("tiny", filled(a=b"1"))
    assert "DXB_MODELS" in str(caught.value.hint)


def test_progress_counts_up_to_the_whole(folders: ModelFolders) -> None:
    told: list[tuple[str, int, int]] = []
    made: Installed = folders.install("tiny", filled(a=b"1", b=b"22"), lambda *said: told.append(said))
    assert told == [("a", 1, 3), ("b", 3, 3)]
    assert damaged(made, lambda *said: told.append(said)) == []
    assert told[2:] == told[:2]
