"""One artifact in one file."""

from __future__ import annotations

import io
import zipfile

import pytest

from dextera_build import digest
from dextera_build.artifacts.packed import pack, unpack
from dextera_build.artifacts.task import TaskBundle, View
from dextera_build.errors import ArtifactError
from tests import episodes


def test_what_is_packed_comes_back_and_packs_to_the_same_bytes():
    bundle = episodes.bundle()
    data = pack(bundle)
    again = unpack(TaskBundle, data)
    assert again.encode(digest.of_bytes) == bundle.encode(digest.of_bytes)
    assert pack(again) == data


def test_an_exported_bundle_can_be_opened(tmp_path):
    bundle = episodes.bundle()
    written = bundle.export(tmp_path, "task")
    (file,) = [path for path in written if path.suffix == ".bundle"]
    assert unpack(TaskBundle, file.read_bytes()).task == bundle.task


def test_another_type_is_refused():
    with pytest.raises(ArtifactError, match="a TaskBundle is needed here, but a View came"):
        unpack(TaskBundle, pack(episodes.view()))


@pytest.mark.parametrize("data", [b"", b"PK\x03\x04 no zip", b"\x00" * 100])
def test_what_is_no_packed_artifact_is_refused(data):
    with pytest.raises(ArtifactError, match="this is no packed View") as caught:
        unpack(View, data)
    assert caught.value.code == "DXB-A109"


def test_a_changed_blob_is_refused():
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(pack(episodes.view()))) as whole, zipfile.ZipFile(written, "w") as changed:
        for name in whole.namelist():
            data = whole.read(name)
            changed.writestr(name, data if name == "artifact" else data + b" ")
    with pytest.raises(ArtifactError, match="a packed artifact is damaged") as caught:
        unpack(View, written.getvalue())
    assert caught.value.code == "DXB-A110"


def test_a_lost_blob_is_refused():
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(pack(episodes.bundle()))) as whole, zipfile.ZipFile(written, "w") as changed:
        for name in whole.namelist()[:-1]:
            changed.writestr(name, whole.read(name))
    with pytest.raises(ArtifactError, match="this is no packed TaskBundle"):
        unpack(TaskBundle, written.getvalue())
