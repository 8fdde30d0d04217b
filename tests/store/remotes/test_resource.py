"""Names of blobs in byte streams."""

from __future__ import annotations

import pytest

from dextera_build.store.remotes import resource
from dextera_build.store.remotes.reapi import Reapi
from tests.store.remotes.things import digest_of


def test_an_instance_is_part_of_the_address_and_of_every_name() -> None:
    remote = Reapi("token@host:1", "team/main", tls=True, timeout_s=1)
    assert remote.address == "grpcs://host:1/team/main"
    remote.close()
    digest = digest_of(b"x")
    assert resource.to_read("team/main", digest) == f"team/main/blobs/{digest.hash}/1"
    assert resource.read_from(resource.to_read("team/main", digest)) == digest
    assert resource.to_write("", digest).startswith("uploads/")
    assert resource.written_to(resource.to_write("blobs/uploads", digest) + "/a/b") == digest


@pytest.mark.parametrize(
    "name",
    ["", "blobs", "blobs/abc/1", f"blobs/{'a' * 64}/-1", f"compressed-blobs/zstd/{'a' * 64}/1", f"x/{'a' * 64}/1"],
)
def test_names_of_other_things_are_refused(name: str) -> None:
    for parse in (resource.read_from, resource.written_to):
        with pytest.raises(ValueError, match="names no blob by SHA-256"):
            parse(name)
