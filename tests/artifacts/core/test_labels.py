"""Labels that cannot be names of files are refused when the value is made, and named."""

from __future__ import annotations

import pytest

from dextera_build import digest
from dextera_build.artifacts.base import Collection, File, Folder
from dextera_build.errors import ArtifactError, StoreError

X = File(data=b"x")
PATHS = [
    ("", "a name is empty"),
    (".", "`.` is not a name"),
    ("..", "`..` is not a name"),
    ("/etc/passwd", "a name is empty"),
    ("a//b", "a name is empty"),
    ("a/", "a name is empty"),
    ("a/../b", "`..` is not a name"),
    ("a" * 256, "a name has 256 bytes"),
    ("ä" * 128 + "/b", "a name has 256 bytes"),
    ("a/" * 1000 + "b", "longer than 2,000 bytes"),
    ("a\x1b[2Jb", "a control character"),
    ("a\nb", "a control character"),
    ("a\u202eb", "a control character"),
    ("a\0b", "a control character"),
    ("\udc80", "not valid Unicode"),
]


@pytest.mark.parametrize(("path", "wrong"), PATHS)
def test_a_folder_refuses_paths_that_no_file_can_have(path, wrong, tmp_path):
    with pytest.raises(ArtifactError) as caught:
        Folder(files={"fine": b"", path: b""})
    assert caught.value.message.startswith(f"Folder: `{path}` cannot be the name of a file")
    assert wrong in caught.value.message
    memory: dict[str, bytes] = {}
    stored = Folder.model_construct(files={path: b""})

    def put(data: bytes) -> str:
        memory[digest.of_bytes(data)] = data
        return digest.of_bytes(data)

    if path != "\udc80":
        with pytest.raises(StoreError, match="cannot be written below"):
            Folder.restore(stored.encode(put), memory.__getitem__, tmp_path, "stem")
        assert list(tmp_path.iterdir()) == []


def test_a_folder_refuses_a_file_that_is_a_folder_too():
    with pytest.raises(ArtifactError, match="`a` is a file of the folder, too"):
        Folder(files={"a": b"", "a/b/c": b""})


@pytest.mark.parametrize("label", ["", ".", "..", "a/b", "a" * 201, "a\tb", "a\x9bb"])
def test_a_collection_refuses_labels_that_no_file_can_have(label):
    with pytest.raises(ArtifactError) as caught:
        Collection[File](items={"fine": X, label: X})
    assert caught.value.message.startswith(f"Collection: `{label}` cannot be the name of a file")
    assert caught.value.hint


def test_unusual_labels_that_are_fine_are_taken(tmp_path):
    names = ["a b", "-rf", "ünï", ".digest", "CON", "<script>", "a\u202fb", "'\"`$(x)", "a\\b", "a" * 255]
    folder = Folder(files={name: name.encode() for name in names})
    folder.export(tmp_path, "stem")
    assert all((tmp_path / name).read_bytes() == name.encode() for name in names)
    assert len(Collection[File](items=dict.fromkeys([name for name in names if "/" not in name][:-1], X)).items) == 9


def test_files_of_a_project_are_read_whatever_their_names_are():
    memory: dict[str, bytes] = {}

    def put(data: bytes) -> str:
        memory[digest.of_bytes(data)] = data
        return digest.of_bytes(data)

    key = Folder.model_construct(files={"Icon\r": b"1", ".digest": b"2"}).encode(put)
    assert Folder.decode(key, memory.__getitem__).files == {"Icon\r": b"1", ".digest": b"2"}
