"""Settings and lock files that hold anything: one error, whatever verb meets them."""

from __future__ import annotations

import os
import sys

import pytest

from dextera_build.errors import RecipeError, UsageError
from dextera_build.project import lockfile
from dextera_build.project.project import Project
from tests.hostile.conftest import one_error

SETTINGS = {
    "nothing that is TOML": (b"\x00\xff\xfe", "R402"),
    "half a line": (b"cache =", "R402"),
    "bytes that are no text": (b'cache = "\xff"', "R402"),
    "lists in lists": (b"cache = " + b"[" * 100_000, "R402"),
    "tables in tables": (b"cache = " + b"{a=" * 50_000, "R402"),
    "a number of 5,000 digits": (b"jobs = " + b"9" * 5000, "R402"),
    "a key twice": (b"jobs = 1\njobs = 2", "R402"),
    "a table for a folder": (b"[cache]\na = 1", "R403"),
    "a list for a profile": (b'profile = ["cpu"]', "R403"),
    "a folder with a null byte": (rb'cache = "a\u0000b"', "R403"),
    "a folder that speaks to the terminal": (rb'cache = "\u001b[2J"', "R403"),
    "a date for a number": (b"jobs = 1979-05-27", "R403"),
    "a number below zero": (b"jobs = -1", "U103"),
    "a number that is none": ('jobs = "²"'.encode(), "U103"),
    "a number beyond all machines": (b"jobs = 99999999999999999999", "U103"),
    "a setting that is none": (b'"\\u001b[2J" = 1', "R401"),
    "keys in a list of lists": (b"trusted_keys = [[1]]", "R403"),
    "an amount that is none": (b"resources = {memory = nan}", "U171"),
    "a wait without end": (b'[remotes.lab]\naddress = "/lab"\ntimeout_s = inf', "U131"),
    "a wait that is none": (b'[remotes.lab]\naddress = "/lab"\ntimeout_s = nan', "U131"),
    "a remote by another protocol": (b'[remotes]\nlab = "javascript://x"', "U131"),
    "remotes as a list": (b"remotes = [[1]]", "U132"),
}


@pytest.fixture
def settings(project):
    """Writes `dxb.local.toml`, and takes it away again."""
    path = project.root / "dxb.local.toml"
    yield path.write_bytes
    path.unlink(missing_ok=True)


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_are_refused_with_one_short_error(settings, dxb, name):
    data, code = SETTINGS[name]
    settings(data)
    words = ("ls", "runs") if code in ("R401", "R402", "R403", "U130", "U131", "U171") else ("build", "say/words")
    assert f"DXB-{code}" in one_error(dxb(*words))


@pytest.mark.parametrize("name", ["a" * 5000, "~nobody-of-this-name/keys", "gone"])
def test_keys_that_are_nowhere_are_refused(settings, project, name):
    settings(f'trusted_keys = ["{name}"]'.encode())
    with pytest.raises(UsageError, match="which is not there"):
        print(Project(project.root).trusted_keys)


@pytest.mark.parametrize("text", ["tool = 3", "[tool]\ndxb = 3", "[[tool]]\n", "tool.dxb = []  # [tool.dxb]"])
def test_a_table_that_is_none_is_refused(project, dxb, text):
    project.write("pyproject.toml", text)
    try:
        assert "DXB-R402" in one_error(dxb("ls", "runs"))
    finally:
        (project.root / "pyproject.toml").unlink()


def test_a_pyproject_above_that_is_no_text_is_passed_by(project, dxb, monkeypatch):
    project.write("below/deep/x", "")
    (project.root / "below" / "pyproject.toml").write_bytes(b"\xff[tool.dx]")
    monkeypatch.chdir(project.root / "below" / "deep")
    assert "say/words" in dxb("ls").out


LOCKS = {
    "bytes": b"\xff\xfe",
    "lists in lists": b"version = " + b"[" * 100_000,
    "digits": b"version = " + b"9" * 5000,
    "another version": b"version = 2",
    "true for one": b'version = 1\n[cpu."a:b"]\nkey = true\noutput = 1\nsize = true',
    "a block that is none": b"version = 1\ncpu = 3",
    "a pin that is none": b'version = 1\n[cpu]\n"a:b" = 3',
    "a name that is none": b'version = 1\n[cpu.""]\nkey = 1',
    "a digest that leads elsewhere": b'version = 1\n[cpu."a:b"]\nkey = "../../../etc/passwd"\noutput = "x"\nsize = 1',
    "a size below zero": b'version = 1\n[cpu."a:b"]\nkey = "%(d)s"\noutput = "%(d)s"\nsize = -1' % {b"d": b"0" * 64},
}


@pytest.mark.parametrize("name", LOCKS)
def test_a_lock_file_is_refused(tmp_path, name):
    (tmp_path / "dxb.lock").write_bytes(LOCKS[name])
    with pytest.raises(RecipeError) as caught:
        lockfile.read(tmp_path / "dxb.lock")
    assert caught.value.code in ("DXB-R501", "DXB-R503")


def test_a_folder_in_place_of_a_file_is_refused(project, dxb):
    (project.root / "dxb.local.toml").mkdir()
    assert dxb("ls", "runs").code == 0  # a folder is no file of settings
    (project.root / "dxb.local.toml").rmdir()
    with pytest.raises(RecipeError):
        lockfile.read(project.root)


@pytest.mark.skipif(os.geteuid() == 0 or sys.platform != "linux", reason="root may read everything")
def test_settings_that_may_not_be_read_are_refused(settings, project, dxb):
    settings(b"jobs = 1")
    (project.root / "dxb.local.toml").chmod(0)
    assert "DXB-R402" in one_error(dxb("ls", "runs"))
