"""Bundles that were tampered with are refused with one error, and no part of them can be used."""

from __future__ import annotations

import json
import shutil
import tarfile
from pathlib import Path

import pytest

from dextera_build.bundle import importer, oci
from dextera_build.bundle.errors import BundleRefused
from dextera_build.bundle.export import archive
from dextera_build.digest import canonical, of_bytes
from dextera_build.store import references
from tests.bundle.conftest import bundle
from tests.bundle.forge import END, Forgery, refused, take


def parts(folder: Path) -> list[Path]:
    return sorted((folder / "blobs" / "sha256").iterdir())


def test_a_changed_byte_of_a_part_is_refused(folder, other):
    for part in parts(folder):
        good = part.read_bytes()
        part.write_bytes(good[:-1] + bytes([good[-1] ^ 1]))
        refused(folder, other, "DXB-S302", "damaged")
        part.write_bytes(good)
    assert take(folder, other).new > 0


def test_a_layout_of_another_version_is_refused(folder, other):
    for text in (b'{"imageLayoutVersion":"1.0.1"}', b"{}", b"[]"):
        (folder / "oci-layout").write_bytes(text)
        with pytest.raises(BundleRefused, match="oci-layout"):
            take(folder, other)
    (folder / "oci-layout").unlink()
    refused(folder, other, "DXB-S301", "oci-layout")


def test_a_cut_or_grown_part_is_refused(folder, other):
    for part in parts(folder):
        good = part.read_bytes()
        part.write_bytes(good[:-1])
        refused(folder, other, "DXB-S302", "bytes, not")
        part.write_bytes(good + b"\0")
        refused(folder, other, "DXB-S302", "bytes, not")
        part.write_bytes(good)


def test_a_part_that_is_gone_is_refused(folder, other):
    for part in parts(folder):
        good = part.read_bytes()
        part.unlink()
        refused(folder, other, "DXB-S303", "lacks")
        part.write_bytes(good)


@pytest.mark.parametrize(
    ("name", "word"),
    [
        ("../../escape", "not named by a digest"),
        ("/etc/passwd", "not named by a digest"),
        ("cas/../../escape", "not named by a digest"),
        ("cas/" + "A" * 64, "not named by a digest"),
    ],
)
def test_names_that_lead_out_are_refused(folder, other, name, word):
    refused(Forgery(folder).add_file(name, b"x").write(), other, "DXB-S304", word)


@pytest.mark.parametrize("kind", [b"1", b"2", b"3", b"4", b"6", b"7", b"S", b"K", b"L", b"x", b"g"])
def test_whatever_is_no_file_is_refused(folder, other, kind):
    """Links, devices, pipes, sparse files, long names, extended headers."""
    refused(Forgery(folder).add_kind(kind).write(), other, "DXB-S304", "neither a file nor a folder")


def test_a_file_with_a_negative_size_is_refused(folder, other):
    refused(Forgery(folder).add_size(-1).write(), other, "DXB-S304", "negative")


def test_a_file_that_claims_more_than_there_is_is_refused(folder, other):
    refused(Forgery(folder).add_size(1 << 60).write(), other, "DXB-S304", "unexpected end")


def test_bytes_after_the_end_of_an_archive_are_not_read(folder, other):
    take(Forgery(folder).add_tail(b"hidden").write(), other)
    assert not any(b"hidden" in file.read_bytes() for file in other.root.rglob("*") if file.is_file())


def test_a_blob_that_stands_twice_is_refused(folder, other):
    forged = Forgery(folder)
    name, data = forged.files[0]
    refused(forged.add_file(name, data).write(), other, "DXB-S304", "twice")


def test_a_blob_under_the_name_of_another_is_refused(folder, other):
    refused(Forgery(folder).add_file("cas/" + "0" * 64, b"x").write(), other, "DXB-S302", "other bytes than its name")


def test_a_blob_that_nothing_names_is_refused(folder, other):
    refused(Forgery(folder).add_file("cas/" + of_bytes(b"x"), b"x").write(), other, "DXB-S306", "no result names")


def test_every_blob_is_needed(folder, other):
    """A bundle that lacks any one of them is refused."""
    for place in range(len(Forgery(folder).files)):
        copy = folder.with_name(f"without-{place}")
        shutil.copytree(folder, copy)
        forged = Forgery(copy)
        forged.files.pop(place)
        refused(forged.write(), other, "DXB-S303", "lacks")


def test_compressed_and_other_files_are_refused(tmp_path, other):
    for magic, word in [
        (b"\x1f\x8b\x08", "not a tar archive"),
        (b"hello", "not a tar archive"),
        (b"", "not a tar archive"),
        (bytes(1024), "index.json"),
    ]:
        (tmp_path / "x.tar").write_bytes(magic)
        refused(tmp_path / "x.tar", other, "DXB-S301", word)
    (tmp_path / "empty").mkdir()
    refused(tmp_path / "empty", other, "DXB-S301", "index.json")


def test_an_archive_with_other_files_is_refused(tmp_path, other):
    for name in ("../escape", "/etc/passwd", "blobs/sha256/../../x", "blobs/md5/x", "run.sh", "\x1b[2J"):
        (tmp_path / "x.tar").write_bytes(b"".join(archive([(name, 1, [b"x"])])))
        refused(tmp_path / "x.tar", other, "DXB-S304", "not part of an OCI image layout")


def test_a_cut_archive_is_refused_at_every_block(tmp_path, store, plan, other):
    bundle(store, plan).write(tmp_path / "good.tar")
    good = (tmp_path / "good.tar").read_bytes()
    for size in range(0, len(good) - len(END), tarfile.BLOCKSIZE):
        (tmp_path / "cut.tar").write_bytes(good[:size])
        with pytest.raises(BundleRefused):
            take(tmp_path / "cut.tar", other)
    assert list(other.actions.keys()) == []


@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        (lambda raw: raw.update(schemaVersion=1), "DXB-S306", "spelled"),
        (lambda raw: raw.update(mediaType="application/json"), "DXB-S306", "spelled"),
        (lambda raw: raw.update(layers="many"), "DXB-S306", "`layers` is not a list"),
        (lambda raw: raw.update(layers=[raw["layers"][0]] * 2), "DXB-S306", "twice"),
        (lambda raw: raw["layers"][-1].update(mediaType=oci.PACK + "+gzip"), "DXB-S306", "not of type"),
        (lambda raw: raw["layers"][-1].update(size=-1), "DXB-S306", "`size` is not a whole number"),
        (lambda raw: raw["layers"][-1].update(size=True), "DXB-S306", "`size` is not a whole number"),
        (lambda raw: raw["layers"][-1].update(size=1 << 52), "DXB-S308", "does not fit"),
        (lambda raw: raw["layers"][-1].update(digest="md5:0"), "DXB-S306", "SHA-256"),
        (lambda raw: raw["layers"][-1].update(digest="sha256:../x"), "DXB-S306", "SHA-256"),
        (lambda raw: raw["config"].update(size=1 << 40), "DXB-S305", "config"),
        (lambda raw: raw["config"].update(mediaType="text/plain"), "DXB-S306", "not of type"),
        (lambda raw: raw.update(artifactType=[]), "DXB-S306", "not of type"),
        (lambda raw: raw.update(annotations={"a": "\x1b[31m"}), "DXB-S306", "control characters"),
        (lambda raw: raw["layers"].pop(0), "DXB-S303", "lacks"),
        (lambda raw: raw.update(more=1), "DXB-S306", "spelled"),
        (
            lambda raw: raw["layers"].insert(0, raw["layers"][0] | {"mediaType": oci.SIGNATURE}),
            "DXB-S306",
            "not of type",
        ),
    ],
)
def test_a_manifest_that_is_wrong_is_refused(folder, other, change, code, word):
    refused(Forgery(folder).edit_manifest(change).write(), other, code, word)


@pytest.mark.parametrize(
    ("text", "word"),
    [
        (b"[" * 100_000, "too deeply"),
        (b"[]", "not an object"),
        (b"\xff\xfe", "not JSON"),
        (b'{"a":' + b"1" * 5000 + b"}", "not JSON"),
    ],
)
def test_documents_that_are_hard_to_read_are_refused(folder, other, text, word):
    refused(Forgery(folder).replace_manifest(text).write(), other, "DXB-S306", word)


def test_a_huge_manifest_is_refused(folder, other):
    refused(Forgery(folder).replace_manifest(b" " * (oci.MOST_MANIFEST + 1)).write(), other, "DXB-S305", "manifest")


def test_a_huge_index_is_refused(folder, other):
    (folder / "index.json").write_bytes(b" " * (oci.MOST_MANIFEST + 1))
    refused(folder, other, "DXB-S305", "index.json")


def node_of(raw: dict, name: str = "scene") -> dict:
    return next(node for node in raw["builds"][0]["nodes"] if node["node"] == name)


@pytest.mark.medium
@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        (lambda raw: raw.update(form=2), "DXB-S306", "form"),
        (lambda raw: raw.update(closure="all"), "DXB-S306", "closure"),
        (lambda raw: raw.update(builds=[]), "DXB-S306", "no build"),
        (lambda raw: raw["builds"][0].update(targets=[]), "DXB-S306", "no targets"),
        (lambda raw: raw["builds"][0].update(targets=["nothing"]), "DXB-S306", "no node `nothing`"),
        (lambda raw: raw["builds"][0].update(recipe="../../x"), "DXB-S306", "address of a recipe"),
        (lambda raw: raw.update(recipes={"\x1b[31m": "0" * 64}), "DXB-S306", "`?[31m` is not the address"),
        (lambda raw: raw.update(recipes={"a": 1}), "DXB-S306", "`a` is not a text"),
        (lambda raw: raw.update(recipes=[]), "DXB-S306", "recipes"),
        (lambda raw: raw["builds"][0]["nodes"].append(node_of(raw)), "DXB-S306", "twice"),
        (lambda raw: node_of(raw).update(depends_on=["ghost"]), "DXB-S306", "no node `ghost`"),
        (lambda raw: node_of(raw).update(node="a\nb"), "DXB-S306", "control characters"),
        (lambda raw: node_of(raw).update(seconds=-1), "DXB-S306", "seconds"),
        (lambda raw: node_of(raw).pop("backend"), "DXB-S306", "`nodes` is not an object with `backend`"),
        (lambda raw: node_of(raw).update(result=None), "DXB-S306", "has no result"),
        (lambda raw: node_of(raw).update(is_whole=False), "DXB-S306", "has no result"),
        (lambda raw: node_of(raw, "read").update(is_whole=False, result="0" * 64), "DXB-S303", "lacks"),
        (lambda raw: node_of(raw, "read").update(is_whole=False, output="0" * 64), "DXB-S307", "another output"),
        (lambda raw: node_of(raw).update(rule="other.rule"), "DXB-S307", "another rule"),
        (lambda raw: node_of(raw).update(backend="gpu"), "DXB-S307", "another rule"),
        (lambda raw: node_of(raw).update(output=node_of(raw, "read")["output"]), "DXB-S307", "another output"),
        (lambda raw: node_of(raw).update(result=node_of(raw, "read")["result"]), "DXB-S307", "key document"),
        (lambda raw: node_of(raw).update(key=node_of(raw, "read")["key"]), "DXB-S307", ""),
        (lambda raw: node_of(raw).update(key="0" * 64), "DXB-S303", "lacks"),
        (lambda raw: node_of(raw).update(result="0" * 64), "DXB-S303", "lacks"),
        (lambda raw: node_of(raw).update(key=node_of(raw)["output"]), "DXB-S306", "key document"),
        (lambda raw: node_of(raw).update(output="0" * 64), "DXB-S307", "another output"),
    ],
)
def test_a_config_that_is_wrong_is_refused(folder, other, change, code, word):
    refused(Forgery(folder).edit_config(change).write(), other, code, word)


@pytest.mark.parametrize(
    ("change", "code", "word"),
    [
        (lambda raw: raw.update(output="0" * 64), "DXB-S307", "another output"),
        (lambda raw: raw.update(key_document=raw["output"]), "DXB-S307", "key document"),
        (lambda raw: raw.update(line="\x1b]0;title"), "DXB-S306", "control characters"),
        (lambda raw: raw.update(previews=[["a"]]), "DXB-S306", "result"),
        (lambda raw: raw.update(previews=[["a", "../x"]]), "DXB-S306", "result"),
        (lambda raw: raw.update(metrics={"a": ["b", "c"]}), "DXB-S306", "result"),
        (lambda raw: raw.update(metrics={"a": [10**400, "c"]}), "DXB-S306", "result"),
        (lambda raw: raw.update(log=1), "DXB-S306", "result"),
        (lambda raw: raw.update(log="0" * 64), "DXB-S303", "lacks"),
        (lambda raw: raw.update(more=1), "DXB-S306", "result"),
    ],
)
def test_a_result_that_is_wrong_is_refused(folder, other, change, code, word):
    refused(Forgery(folder).edit_result("scene", change).write(), other, code, word)


@pytest.mark.parametrize(
    "header",
    [
        b"[]",
        b"{}",
        b'{"fields":1}',
        b'{"artifact":"A","fields":{"a":{}}}',
        b'{"artifact":"A","fields":{"a":{"$ref":1}}}',
        b'{"artifact":"A","fields":{"a":{"$ref":["' + b'a","' * 63 + b'a"]}}}',
        b'{"artifact":"A","fields":{"a":{"$bytes":[]}}}',
        b'{"artifact":"A","fields":{"a":{"$map":[]}}}',
        b'{"artifact":"A","fields":{"a":{"$value":3}}}',
        b'{"artifact":"A","fields":{"a":{"$other":{}}}}',
        b'{"artifact":"A","fields":{"a":{"$array":["f8"]}}}',
        b'{"artifact":3,"fields":{}}',
        b'{"artifact":"A","fields":{},"more":1}',
        b'{"artifact":"File","fields":{}}',
        b'{"artifact":"File","fields":{"data":"text"}}',
        b'{"artifact":"Folder","fields":{"files":{"$map":{"a":1}}}}',
        b"\x80\x04\x95pickle",
    ],
)
def test_an_output_that_is_no_artifact_is_refused(folder, other, header):
    refused(Forgery(folder).replace_output("scene", header).write(), other, "DXB-S306", "header")


@pytest.mark.parametrize(
    "change",
    [
        lambda raw: raw.pop("version"),
        lambda raw: raw.update(more=1),
        lambda raw: raw.update(options=[]),
        lambda raw: raw.update(version="1"),
        lambda raw: raw.update(code={"rules/a.py": ["f"]}),
        lambda raw: raw.update(packages={"numpy": 2}),
        lambda raw: raw.update(weights=[1]),
        lambda raw: raw.update(types=3),
        lambda raw: raw.update(inputs={"a": "b"}),
    ],
)
def test_a_key_document_of_another_form_is_refused(folder, other, change):
    forged = Forgery(folder)
    node = forged.node("scene")
    document = json.loads(forged.pop(node["key"]))
    change(document)
    node["key"] = forged.put(canonical(document))
    forged.edit_result("scene", lambda raw: raw.update(key_document=node["key"]))
    refused(forged.write(), other, "DXB-S306", "")


def test_a_key_document_that_two_parsers_could_read_differently_is_refused(folder, other):
    forged = Forgery(folder)
    node = forged.node("scene")
    node["key"] = forged.put(forged.pop(node["key"])[:-1] + b',"salt":"other"}')
    forged.edit_result("scene", lambda raw: raw.update(key_document=node["key"]))
    refused(forged.write(), other, "DXB-S306", "spelled")


def test_a_document_as_large_as_a_film_is_not_read(folder, other, monkeypatch):
    monkeypatch.setattr(importer, "MOST_DOCUMENT", 10)
    refused(folder, other, "DXB-S305", "document")


def test_a_header_as_large_as_a_film_is_not_read(folder, other, monkeypatch):
    monkeypatch.setattr(references, "_MOST_HEADER", 1000)
    header = b'{"artifact":"A","fields":{"text":"' + b"a" * 1000 + b'"}}'
    refused(Forgery(folder).replace_output("scene", header).write(), other, "DXB-S306", "header")


def test_two_nodes_may_share_a_key(folder, other):
    def twice(raw: dict) -> None:
        raw["builds"][0]["nodes"].append(node_of(raw) | {"node": "again"})

    taken = take(Forgery(folder).edit_config(twice).write(), other)
    assert taken.new == len(list(other.actions.keys()))


def test_the_forgery_changes_nothing_by_itself(folder, other):
    assert take(Forgery(folder).write(), other).new > 0
