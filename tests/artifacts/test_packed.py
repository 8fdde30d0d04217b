"""One artifact in one file."""

from __future__ import annotations

import io
import re
import zipfile

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.artifacts.packed import pack, unpack
from dextera_build.artifacts.tasks.task import TaskBundle, View
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
    with pytest.raises(ArtifactError, match="this is not a packed View") as caught:
        unpack(View, data)
    assert caught.value.code == "DXB-A109"
    with pytest.raises(ArtifactError, match=r"`dxb\.toml` is not a packed View"):
        unpack(View, b"", "`dxb.toml`")


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
    with pytest.raises(ArtifactError, match="this is not a packed TaskBundle"):
        unpack(TaskBundle, written.getvalue())


def altered(edit) -> bytes:
    """A packed view whose members `edit` wrote."""
    written = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(pack(episodes.view()))) as whole, zipfile.ZipFile(written, "w") as changed:
        for name in whole.namelist():
            edit(changed, name, whole.read(name))
    return written.getvalue()


def test_a_small_file_that_would_unpack_to_all_of_the_memory_is_refused_before_it_is_unpacked():
    data = bytearray(altered(lambda changed, name, data: changed.writestr(name, data)))
    # The last member's entry in the directory; its declared size stands 24 bytes further on.
    entry = data.rindex(b"PK\x01\x02")
    data[entry + 24 : entry + 28] = (2 << 30).to_bytes(4, "little")
    with pytest.raises(ArtifactError, match="a packed artifact is too large") as caught:
        unpack(View, bytes(data))
    assert caught.value.code == "DXB-A112"
    assert caught.value.facts["most"] == "1,073,741,824"


def test_no_more_is_read_than_a_member_declares():
    data = bytearray(altered(lambda changed, name, data: changed.writestr(name, data + b" " * (1 << 20), 8)))
    for start in (found.start() for found in re.finditer(re.escape(b"PK\x01\x02"), bytes(data))):
        data[start + 24 : start + 28] = (3).to_bytes(4, "little")
    with pytest.raises(ArtifactError, match="this is not a packed View"):
        unpack(View, bytes(data))


@pytest.mark.parametrize(
    ("place", "value"),
    [(8, b"\x01\x00"), (10, b"\x63\x00"), (10, b"\x0c\x00")],
    ids=["encrypted", "unknown method", "bzip2"],
)
def test_a_member_that_cannot_be_opened_is_refused(place, value):
    data = bytearray(pack(episodes.view()))
    for start in (found.start() for found in re.finditer(re.escape(b"PK\x01\x02"), bytes(data))):
        data[start + place : start + place + 2] = value
    with pytest.raises(ArtifactError, match="this is not a packed View"):
        unpack(View, bytes(data))


@given(st.binary(max_size=60), st.integers(0, 3000))
@example(b"\x00\x03", 1136)  # says that a member begins before the file
@settings(deadline=None, max_examples=60)
def test_a_torn_or_overwritten_file_is_refused_or_is_the_same_artifact(patch, place):
    whole = pack(episodes.view())
    data = whole[:place] + patch + whole[place + len(patch) :]
    try:
        found = unpack(View, data)
    except ArtifactError:
        return
    assert found.encode(digest.of_bytes) == episodes.view().encode(digest.of_bytes)
