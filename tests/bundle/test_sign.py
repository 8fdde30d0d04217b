"""A signature is valid for one bundle and one key; keys of other programs work, too."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.bundle import importer, layout, sign
from dextera_build.bundle.errors import BundleRefused
from dextera_build.bundle.export import Export
from dextera_build.digest import canonical
from dextera_build.errors import UsageError
from tests.bundle.conftest import bundle
from tests.bundle.forge import Forgery, packed, unpacked

needs_ssh_keygen = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="no ssh-keygen here")


@pytest.fixture
def key(tmp_path: Path) -> Path:
    sign.generate(tmp_path / "key", "anna@lab")
    return tmp_path / "key"


def signed(made: Export, key: Path, digest: str | None = None) -> Export:
    made.attach(sign.seal(digest or made.digest, key)[0])
    return made


def judge(path: Path, *keys: Path) -> sign.Voucher:
    return sign.judge(importer.open_bundle(layout.Layout(packed(path))), sign.trusted(keys))


def refused(path: Path, code: str, *keys: Path) -> BundleRefused:
    with pytest.raises(BundleRefused) as error:
        judge(path, *keys)
    assert error.value.code == code, error.value.message
    return error.value


def required(path: Path, *keys: Path) -> BundleRefused:
    opened = importer.open_bundle(layout.Layout(packed(path)))
    with pytest.raises(BundleRefused) as error:
        sign.require(opened, sign.judge(opened, sign.trusted(keys)), sign.trusted(keys))
    assert error.value.code == "DXB-S309"
    return error.value


def test_a_signature_of_a_trusted_key_vouches(tmp_path, store, plan, key):
    signed(bundle(store, plan), key).write(tmp_path / "b.tar")
    voucher = judge(tmp_path / "b.tar", tmp_path / "key.pub")
    assert voucher.state == "trusted"
    assert voucher.signer.startswith("anna@lab (SHA256:")


def test_whom_nobody_trusts_vouches_for_nothing(tmp_path, store, plan, key):
    signed(bundle(store, plan), key).write(tmp_path / "b.tar")
    sign.generate(tmp_path / "other", "bob@lab")
    assert judge(tmp_path / "b.tar").state == "unknown"
    error = required(tmp_path / "b.tar", tmp_path / "other.pub")
    assert "not trusted here" in error.message
    assert error.facts["trusted"].startswith("bob@lab (SHA256:")
    assert error.facts["signed by"].startswith("SHA256:")


def test_what_nobody_signed_is_refused_where_a_signature_is_required(tmp_path, store, plan, key):
    bundle(store, plan).write(tmp_path / "b.tar")
    assert judge(tmp_path / "b.tar", tmp_path / "key.pub").state == "unsigned"
    assert "not signed" in required(tmp_path / "b.tar", tmp_path / "key.pub").message


def test_a_wrong_signature_in_a_trusted_name_is_refused(tmp_path, store, plan, key):
    made = bundle(store, plan)
    raw = json.loads(sign.seal(made.digest, key)[0])
    made.attach(canonical(raw | {"signature": base64.b64encode(bytes(64)).decode()}))
    made.write(tmp_path / "b.tar")
    assert "anna@lab" in refused(tmp_path / "b.tar", "DXB-S310", tmp_path / "key.pub").message


def test_a_signature_of_another_bundle_is_refused(tmp_path, store, plan, key):
    other = bundle(store, plan, "full")
    signed(bundle(store, plan), key, other.digest).write(tmp_path / "b.tar")
    refused(tmp_path / "b.tar", "DXB-S310", tmp_path / "key.pub")


def test_a_signature_does_not_outlive_a_change_of_the_bundle(tmp_path, store, plan, key):
    """An edit of the config needs a new manifest, which is then unsigned."""
    signed(bundle(store, plan), key).write(tmp_path / "b.tar")
    forged = Forgery(unpacked(tmp_path / "b.tar")).edit_config(lambda raw: raw.update(dxb="2.0")).write()
    assert judge(forged, tmp_path / "key.pub").state == "unsigned"
    required(forged, tmp_path / "key.pub")


@pytest.mark.parametrize(
    ("document", "word"),
    [
        (b"[]", "not an object"),
        (b'{"key":"a","signature":"?"}', "base64"),
        (b'{"key":"a","signature":"\xc3\xa9"}', "base64"),
        (b'{"key":"a","signature":1}', "`signature` is not a text"),
        (b'{"key":"\\u001b[2J","signature":""}', "`key` is not a text"),
    ],
)
def test_a_signature_that_is_ill_formed_is_refused(tmp_path, store, plan, document, word):
    made = bundle(store, plan)
    made.attach(document)
    made.write(tmp_path / "b.tar")
    assert word in refused(tmp_path / "b.tar", "DXB-S306").message


def test_signing_twice_gives_equal_bytes(tmp_path, store, plan, key):
    for name in ("a.tar", "b.tar"):
        signed(bundle(store, plan), key).write(tmp_path / name)
    assert (tmp_path / "a.tar").read_bytes() == (tmp_path / "b.tar").read_bytes()


@given(st.integers(0, (1 << 256) - 1), st.integers(0, 255), st.integers(0, 63), st.integers(1, 255))
def test_a_signature_is_of_one_bundle(tmp_path_factory, number, bit, place, flip):
    folder = tmp_path_factory.mktemp("keys")
    public = sign.generate(folder / "key", "anna")
    mine, other = f"{number:064x}", f"{number ^ 1 << bit:064x}"
    signature = base64.b64decode(json.loads(sign.seal(mine, folder / "key")[0])["signature"])
    assert public.verifies(signature, sign.message(mine))
    assert not public.verifies(signature, sign.message(other))
    wrong = bytearray(signature)
    wrong[place] ^= flip
    assert not public.verifies(bytes(wrong), sign.message(mine))


def test_the_private_key_is_for_its_owner_alone(key):
    assert key.stat().st_mode & 0o777 == 0o600
    with pytest.raises(UsageError, match="already exists") as error:
        sign.generate(key, "anna")
    assert error.value.code == "DXB-U143"


@needs_ssh_keygen
def test_keys_of_ssh_keygen_serve(tmp_path, key):
    path = tmp_path / "id"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "carl@lab", "-f", path], check=True)
    _, public = sign.seal("0" * 64, path)
    (trusted,) = sign.trusted([tmp_path / "id.pub"])
    assert (trusted.raw, trusted.id, trusted.name) == (public.raw, public.id, "carl@lab")
    said = subprocess.run(["ssh-keygen", "-lf", tmp_path / "key.pub"], check=True, capture_output=True, text=True)
    assert sign.trusted([tmp_path / "key.pub"])[0].id in said.stdout


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl here")
def test_keys_of_openssl_serve(tmp_path):
    subprocess.run(["openssl", "genpkey", "-algorithm", "ed25519", "-out", tmp_path / "anna.pem"], check=True)
    document, public = sign.seal("0" * 64, tmp_path / "anna.pem")
    signature = base64.b64decode(json.loads(document)["signature"])
    assert public.verifies(signature, sign.message("0" * 64))


def test_a_passphrase_is_asked_for(key, monkeypatch):
    locked = key.with_name("locked")
    command = ["openssl", "pkcs8", "-topk8", "-in", key, "-out", locked, "-passout", "pass:secret"]
    subprocess.run(command, check=True)
    with pytest.raises(UsageError, match="passphrase does not fit") as error:
        sign.seal("0" * 64, locked)
    assert (error.value.code, error.value.hint) == ("DXB-U144", "set `DXB_KEY_PASSPHRASE`")
    monkeypatch.setenv(sign.PASSPHRASE, "wrong")
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal("0" * 64, locked)
    monkeypatch.setenv(sign.PASSPHRASE, "secret")
    assert sign.seal("0" * 64, locked)[1].raw == sign.trusted([key.with_name("key.pub")])[0].raw
    with pytest.raises(UsageError, match="passphrase does not fit") as error:
        sign.seal("0" * 64, key)
    assert error.value.hint == "unset `DXB_KEY_PASSPHRASE`"


@pytest.mark.parametrize("content", [b"", b"hello", b"-----BEGIN PUBLIC KEY-----\n-----END PUBLIC KEY-----\n"])
def test_a_file_without_a_key_is_said_so(tmp_path, content):
    (tmp_path / "x").write_bytes(content)
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal("0" * 64, tmp_path / "x")
    if content:
        with pytest.raises(UsageError, match="holds no public ed25519 key"):
            sign.trusted([tmp_path / "x"])
    with pytest.raises(UsageError, match="holds no usable ed25519 key"):
        sign.trusted([tmp_path / "missing"])


@needs_ssh_keygen
def test_a_key_of_another_kind_is_said_so(tmp_path):
    subprocess.run(["ssh-keygen", "-q", "-t", "ecdsa", "-N", "", "-f", tmp_path / "id"], check=True)
    with pytest.raises(UsageError, match="holds no private ed25519 key"):
        sign.seal("0" * 64, tmp_path / "id")
    with pytest.raises(UsageError, match="holds no public ed25519 key"):
        sign.trusted([tmp_path / "id.pub"])
