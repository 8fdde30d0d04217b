"""Secrets come from the environment or the keyring, and files of a project that hold one are refused with the place."""

from __future__ import annotations

import sys
import types

import pytest

from dextera_build import redact
from dextera_build.calls import secrets
from dextera_build.errors import MachineError, RecipeError, RuleError
from dextera_build.rule import Context

VALUE = "geheim-0123456789"


@pytest.fixture(autouse=True)
def nothing_hidden(monkeypatch):
    monkeypatch.setattr(redact, "_values", {})


@pytest.fixture
def keyring(monkeypatch):
    """A keyring with one secret."""
    errors = types.ModuleType("keyring.errors")
    errors.KeyringError = type("KeyringError", (Exception,), {})
    made = types.ModuleType("keyring")
    made.errors, made.entries, made.broken = errors, {("dxb", "FORGE_KEY"): VALUE}, False

    def get_password(service, name):
        if made.broken:
            raise errors.KeyringError("locked")
        return made.entries.get((service, name))

    made.get_password = get_password
    monkeypatch.setitem(sys.modules, "keyring", made)
    monkeypatch.setitem(sys.modules, "keyring.errors", errors)
    return made


def test_the_environment_comes_before_the_keyring(monkeypatch, keyring):
    assert secrets.get("FORGE_KEY") == VALUE
    monkeypatch.setenv("FORGE_KEY", "another-secret")
    assert secrets.get("FORGE_KEY") == "another-secret"


@pytest.mark.parametrize("how", ["absent", "locked", "not installed"])
def test_a_secret_that_there_is_not(monkeypatch, keyring, how):
    keyring.broken = how == "locked"
    if how == "not installed":
        monkeypatch.setitem(sys.modules, "keyring", None)
    with pytest.raises(MachineError, match="there is no secret `OTHER_KEY`") as caught:
        secrets.get("OTHER_KEY")
    assert caught.value.code == "DXB-E366"
    assert caught.value.hint == "export OTHER_KEY=..., or `keyring set dxb OTHER_KEY`"


def test_a_secret_of_a_rule_is_hidden_and_named_to_the_pool(monkeypatch, tmp_path):
    monkeypatch.setenv("FORGE_KEY", VALUE)
    told = []
    ctx = Context(scratch=tmp_path, emit=lambda kind, data: told.append((kind, dict(data))))
    assert ctx.secret("FORGE_KEY") == VALUE
    assert told == [("secret", {"name": "FORGE_KEY"})]
    error = RuleError(f"bad {VALUE}", code="DXB-B202", facts={"sent": f"<{VALUE}>"}, hint=VALUE)
    assert (error.message, error.facts, error.hint) == ("bad ***", {"sent": "<***>"}, "***")
    plain = {"text": f"a {VALUE}", "rows": [VALUE, 3, None], "bytes": VALUE.encode()}
    assert redact.redact_plain(plain) == {"text": "a ***", "rows": ["***", 3, None], "bytes": b"***"}
    assert secrets.secret_in(f"..{VALUE}..".encode()) == "the value of `FORGE_KEY`"
    monkeypatch.delenv("FORGE_KEY")
    assert secrets.secret_in(f"..{VALUE}..".encode()) == "the secret `FORGE_KEY`"


def test_the_longest_secret_is_removed_first():
    redact.hide("SHORT", VALUE)
    redact.hide("LONG", VALUE + "-more")
    redact.hide("TINY", "abc")
    assert redact.redact(f"{VALUE}-more {VALUE} abc") == "*** *** abc"


@pytest.mark.parametrize(
    "key",
    [
        "sk-" + "a1" * 12,
        "AKID" + "z8kr" * 8,
        "AKIA" + "ABCDEFGH12345678",
        "ghp_" + "a1B2" * 9,
        "hf_" + "aB3" * 11,
        "-----BEGIN OPENSSH PRIVATE KEY-----",
    ],
)
def test_what_looks_like_a_key_is_refused_with_its_place(key):
    with pytest.raises(RecipeError, match=r"`dxb\.toml` holds what looks like a secret key") as caught:
        secrets.refuse_written(f"[a]\nb = 1\nc = '{key}'\n", "dxb.toml")
    assert caught.value.code == "DXB-R406"
    assert str(caught.value.where) == "dxb.toml:3:6"
    assert "ctx.secret(NAME)" in caught.value.hint
    assert key not in str(caught.value.to_json())


def test_the_value_of_a_variable_is_refused(monkeypatch):
    monkeypatch.setenv("FORGE_API_KEY", "0123456789ab-cd")
    with pytest.raises(RecipeError, match="holds the value of `FORGE_API_KEY`") as caught:
        secrets.refuse_written("x: 0123456789ab-cd", "recipe.yaml")
    assert str(caught.value.where) == "recipe.yaml:1:4"
    assert "0123456789ab" not in str(caught.value)


@pytest.mark.parametrize(
    "value", ["public", "./keys/lab-1-trusted", "/home/me/.ssh/id_25519", "123456789012", "password-store"]
)
def test_words_paths_and_numbers_in_variables_are_no_secrets(monkeypatch, value):
    monkeypatch.setenv("SOME_KEY", value)
    secrets.refuse_written(f"a: {value}", "recipe.yaml")


@pytest.mark.parametrize(
    "text", ["sk-1", "task-sk-short", "hf_hub", "summary: an ask-for-more-than-twenty-letters node"]
)
def test_ordinary_text_is_no_key(text):
    secrets.refuse_written(text, "recipe.yaml")


@pytest.mark.parametrize("name", ["DXB_TRUSTED_KEYS", "COSIGN_PUBLIC_KEY"])
def test_public_keys_are_no_secrets(monkeypatch, name):
    monkeypatch.setenv(name, "lab-keys-2026-a")
    secrets.refuse_written("trusted_keys = 'lab-keys-2026-a'", "dxb.toml")


def test_a_path_that_exists_is_no_secret(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("LAB_KEYS", "keys-of-lab-7")
    with pytest.raises(RecipeError):
        secrets.refuse_written("keys: keys-of-lab-7", "recipe.yaml")
    (tmp_path / "keys-of-lab-7").mkdir()
    secrets.refuse_written("keys: keys-of-lab-7", "recipe.yaml")
