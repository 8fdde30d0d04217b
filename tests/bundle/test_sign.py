"""Signatures hold for one bundle and one key, whoever reads them; keys are those of other programs too."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.bundle import importer, layout, oci, provenance, sign, trust
from dextera_build.bundle.errors import BundleRefused
from dextera_build.bundle.export import Export
from dextera_build.digest import canonical, of_bytes
from dextera_build.errors import UsageError
from tests.bundle.conftest import bundle
from tests.bundle.forge import Forgery


@pytest.fixture
def key(tmp_path: Path) -> Path:
    sign.generate(tmp_path / "key", "anna@lab")
    return tmp_path / "key"


def statement(made: Export, store) -> bytes:
    return provenance.statement(made.digest, made.contents, store.blobs.get, provenance.Circumstances())


def signed(made: Export, store, key: Path, data: bytes | None = None) -> Export:
    envelope, _ = sign.seal(statement(made, store) if data is None else data, key)
    made.attach(oci.DSSE, envelope)
    return made


def judge(path: Path, *keys: Path) -> trust.Voucher:
    return trust.judge(importer.open_bundle(layout.read(path)), sign.trusted(keys))


def refused(path: Path, code: str, *keys: Path) -> BundleRefused:
    with pytest.raises(BundleRefused) as error:
        judge(path, *keys)
    assert error.value.code == code, error.value.message
    return error.value


def required(path: Path, *keys: Path) -> BundleRefused:
    opened = importer.open_bundle(layout.read(path))
    with pytest.raises(BundleRefused) as error:
        trust.require(opened, trust.judge(opened, sign.trusted(keys)), sign.trusted(keys))
    assert error.value.code == "DXB-S309"
    return error.value


def test_a_signature_of_a_trusted_key_vouches(tmp_path, store, plan, key):
    signed(bundle(store, plan), store, key).write(tmp_path / "b.tar")
    voucher = judge(tmp_path / "b.tar", tmp_path / "key.pub")
    assert voucher.state == "trusted"
    assert voucher.signers[0].startswith("anna@lab (SHA256:")
    assert voucher.statement["subject"][0]["name"] == "tiny/graph:scene"


def test_whom_nobody_trusts_vouches_for_nothing(tmp_path, store, plan, key):
    signed(bundle(store, plan), store, key).write(tmp_path / "b.tar")
    sign.generate(tmp_path / "other", "bob@lab")
    assert judge(tmp_path / "b.tar").state == "unknown"
    error = required(tmp_path / "b.tar", tmp_path / "other.pub")
    assert "not trusted here" in error.message
    assert error.facts["trusted"].startswith("bob@lab (SHA256:")
    assert error.facts["signed by"].startswith("SHA256:")


def test_what_nobody_signed_is_refused_where_a_signature_is_required(tmp_path, store, plan, key):
    made = bundle(store, plan)
    made.attach(oci.IN_TOTO, statement(made, store))
    made.write(tmp_path / "b.tar")
    assert judge(tmp_path / "b.tar", tmp_path / "key.pub").state == "unsigned"
    assert "not signed" in required(tmp_path / "b.tar", tmp_path / "key.pub").message
    bundle(store, plan).write(tmp_path / "bare.tar")
    assert "not signed" in required(tmp_path / "bare.tar", tmp_path / "key.pub").message


def test_a_wrong_signature_in_a_trusted_name_is_refused(tmp_path, store, plan, key):
    made = bundle(store, plan)
    envelope, _ = sign.seal(statement(made, store), key)
    raw = json.loads(envelope)
    raw["signatures"][0]["sig"] = base64.b64encode(bytes(64)).decode()
    made.attach(oci.DSSE, canonical(raw))
    made.write(tmp_path / "b.tar")
    assert "anna@lab" in refused(tmp_path / "b.tar", "DXB-S310", tmp_path / "key.pub").message


def test_a_changed_statement_is_refused(tmp_path, store, plan, key):
    made = bundle(store, plan)
    envelope, _ = sign.seal(statement(made, store), key)
    raw = json.loads(envelope)
    raw["payload"] = base64.b64encode(base64.b64decode(raw["payload"]).replace(b"cpu", b"gpu")).decode()
    made.attach(oci.DSSE, canonical(raw))
    made.write(tmp_path / "b.tar")
    refused(tmp_path / "b.tar", "DXB-S310", tmp_path / "key.pub")


def test_a_signature_of_another_bundle_is_refused(tmp_path, store, plan, key):
    other = bundle(store, plan, "full")
    signed(bundle(store, plan), store, key, statement(other, store)).write(tmp_path / "b.tar")
    refused(tmp_path / "b.tar", "DXB-S311", tmp_path / "key.pub")


def test_a_signature_does_not_outlive_a_change_of_the_bundle(tmp_path, store, plan, key):
    """Whoever edits the config has to spell the manifest anew, and then nobody vouches for it."""
    signed(bundle(store, plan), store, key).write(tmp_path / "b")
    Forgery(tmp_path / "b").edit_config(lambda raw: raw.update(dxb="2.0")).write()
    assert judge(tmp_path / "b", tmp_path / "key.pub").state == "unsigned"
    required(tmp_path / "b", tmp_path / "key.pub")


@pytest.mark.parametrize(
    ("document", "word"),
    [
        (b"[]", "not an object"),
        (b'{"payloadType":"x","payload":"","signatures":[]}', "not about"),
        (b'{"payloadType":"application/vnd.in-toto+json","payload":"?","signatures":[]}', "base64"),
        (b'{"payloadType":"application/vnd.in-toto+json","payload":"e30=","signatures":[]}', "no in-toto statement"),
        (b'{"payloadType":"application/vnd.in-toto+json","payload":"e30=","signatures":[{"sig":1}]}', "base64"),
    ],
)
def test_an_envelope_that_is_wrong_is_refused(tmp_path, store, plan, document, word):
    made = bundle(store, plan)
    made.attach(oci.DSSE, document)
    made.write(tmp_path / "b.tar")
    assert word in refused(tmp_path / "b.tar", "DXB-S306").message


def test_signing_twice_gives_equal_bytes(tmp_path, store, plan, key):
    for name in ("a.tar", "b.tar"):
        signed(bundle(store, plan), store, key).write(tmp_path / name)
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


@given(st.binary(max_size=200), st.binary(min_size=1, max_size=8), st.integers(0, 63), st.integers(1, 255))
def test_a_signature_is_of_one_message(tmp_path_factory, message, more, place, flip):
    folder = tmp_path_factory.mktemp("keys")
    public = sign.generate(folder / "key", "anna")
    envelope, _ = sign.seal(message, folder / "key")
    found = sign.Envelope.read(envelope)
    ((_, signature),) = found.signatures
    assert public.verifies(signature, found.signed)
    assert not public.verifies(signature, sign.Envelope(message + more, ()).signed)
    wrong = bytearray(signature)
    wrong[place] ^= flip
    assert not public.verifies(bytes(wrong), found.signed)


def test_the_private_key_is_for_its_owner_alone(key):
    assert key.stat().st_mode & 0o777 == 0o600
    with pytest.raises(UsageError, match="there already") as error:
        sign.generate(key, "anna")
    assert error.value.code == "DXB-U143"


@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen here")
def test_keys_of_ssh_keygen_serve(tmp_path, key):
    path = tmp_path / "id"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "carl@lab", "-f", path], check=True)
    _, public = sign.seal(b"{}", path)
    (trusted,) = sign.trusted([tmp_path / "id.pub"])
    assert (trusted.raw, trusted.id, trusted.name) == (public.raw, public.id, "carl@lab")
    said = subprocess.run(["ssh-keygen", "-lf", tmp_path / "key.pub"], check=True, capture_output=True, text=True)
    assert sign.trusted([tmp_path / "key.pub"])[0].id in said.stdout


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl here")
def test_keys_of_openssl_serve(tmp_path, key):
    subprocess.run(["openssl", "pkey", "-in", key, "-pubout", "-out", tmp_path / "anna.pem"], check=True)
    assert sign.trusted([tmp_path / "anna.pem"])[0].raw == sign.trusted([tmp_path / "key.pub"])[0].raw


def test_a_passphrase_is_asked_for(key, monkeypatch):
    locked = key.with_name("locked")
    command = ["openssl", "pkcs8", "-topk8", "-in", key, "-out", locked, "-passout", "pass:secret"]
    subprocess.run(command, check=True)
    with pytest.raises(UsageError, match="passphrase does not fit") as error:
        sign.seal(b"{}", locked)
    assert (error.value.code, error.value.hint) == ("DXB-U144", "set `DXB_KEY_PASSPHRASE`")
    monkeypatch.setenv(sign.PASSPHRASE, "wrong")
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal(b"{}", locked)
    monkeypatch.setenv(sign.PASSPHRASE, "secret")
    assert sign.seal(b"{}", locked)[1].raw == sign.trusted([key.with_name("key.pub")])[0].raw
    with pytest.raises(UsageError, match="passphrase does not fit") as error:
        sign.seal(b"{}", key)
    assert error.value.hint == "unset `DXB_KEY_PASSPHRASE`"


@pytest.mark.parametrize("content", [b"", b"hello", b"-----BEGIN PUBLIC KEY-----\n-----END PUBLIC KEY-----\n"])
def test_a_file_without_a_key_is_said_so(tmp_path, content):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal(b"{}", tmp_path / "x")
    if content:
        with pytest.raises(UsageError, match="holds no public ed25519 key"):
            sign.trusted([tmp_path / "x"])
    with pytest.raises(UsageError, match="holds no usable ed25519 key"):
        sign.trusted([tmp_path / "missing"])


def test_a_key_of_another_kind_is_said_so(tmp_path):
    subprocess.run(["ssh-keygen", "-q", "-t", "ecdsa", "-N", "", "-f", tmp_path / "id"], check=True)
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal(b"{}", tmp_path / "id")
    with pytest.raises(UsageError, match="holds no public ed25519 key"):
        sign.trusted([tmp_path / "id.pub"])


def test_the_provenance_names_what_went_in(store, plan):
    made = bundle(store, plan)
    raw = json.loads(statement(made, store))
    assert raw["subject"][0]["digest"]["sha256"] == made.digest
    found = raw["predicate"]["buildDefinition"]["resolvedDependencies"]
    names = {(entry.get("annotations", {}).get("kind"), entry["name"]) for entry in found}
    assert names == {("file", "photo.bin"), ("recipe", "tiny/graph"), ("rule", "tiny.rule"), (None, "numpy")}
    (photo,) = (entry for entry in found if entry["name"] == "photo.bin")
    assert photo["digest"]["sha256"] == of_bytes(b"photo")
    assert provenance.subject_of(statement(made, store)) == (made.digest, raw)
