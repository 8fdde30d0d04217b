"""The lock file: what is written is read, equal pins are equal texts, and everything else is refused with its place."""

from __future__ import annotations

import os
import subprocess

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.errors import RecipeError, StoreError
from dextera_build.project import lockfile
from dextera_build.project.lockfile import Lock, Name, Pin
from dextera_build.project.project import LOCK
from dextera_build.project.settings import PROFILES
from dextera_build.recipe.bindings import PROPERTIES, Binding

HEX = st.binary(max_size=4).map(digest.of_bytes)
LABEL = st.text(
    st.characters(exclude_categories=["Cs"], exclude_characters="".join(map(chr, range(32))) + "[]/\\"), min_size=1
)
NAMES = st.builds(
    Name, st.sampled_from(PROFILES), st.sampled_from(["twin/a", "b"]), LABEL.map(lambda label: f"body[{label}].mesh")
)
PINS = st.dictionaries(NAMES, st.builds(Pin, HEX, HEX, st.integers(0, 2**40)), max_size=6)
BINDINGS = st.builds(
    Binding,
    st.tuples(st.integers(0, 9999), st.integers(0, 9999)),
    HEX,
    st.dictionaries(st.sampled_from(PROPERTIES), LABEL, max_size=2),
)
NAMED = st.dictionaries(
    st.sampled_from(["twin/a:named", "b:twin/named"]), st.dictionaries(LABEL, BINDINGS, max_size=3), max_size=2
)

ONE = Pin("1" * 64, "2" * 64, 3)
TWO = Pin("4" * 64, "5" * 64, 6)


@pytest.mark.medium
@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(PINS, NAMED)
def test_what_is_written_is_read(tmp_path_factory, pins, names):
    path = tmp_path_factory.mktemp("lock") / LOCK
    assert lockfile.write(path, Lock(pins, names))
    assert lockfile.read(path) == Lock(pins, {node: bound for node, bound in names.items() if bound})
    assert not lockfile.write(path, Lock(dict(reversed(pins.items())), dict(reversed(names.items()))))


def test_there_is_one_block_a_target_in_order(tmp_path):
    text = lockfile.spell(Lock({Name("gpu", "a", "n"): ONE, Name("cpu", "b", "n"): TWO, Name("cpu", "a", "n"): ONE}))
    assert [line for line in text.splitlines() if line.startswith("[")] == [
        '[cpu."a:n"]',
        '[cpu."b:n"]',
        '[gpu."a:n"]',
    ]
    assert text.count(f'\nkey = "{"1" * 64}"\noutput = "{"2" * 64}"\nsize = 3\n') == 2


def test_no_file_is_no_pins(tmp_path):
    assert lockfile.read(tmp_path / LOCK) is None


def merged(folder, ours, theirs):
    """What git makes of two branches that changed a lock file with one pin in the middle."""
    names = {"base": {}, "ours": ours, "theirs": theirs}
    for name, pins in names.items():
        (folder / name).write_text(lockfile.spell(Lock({Name("cpu", "m", "n"): ONE} | pins)))
    command = ["git", "merge-file", "-p", "ours", "base", "theirs"]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True).stdout


def test_branches_that_pin_other_targets_merge(tmp_path):
    path = tmp_path / LOCK
    path.write_text(merged(tmp_path, {Name("cpu", "a", "n"): ONE}, {Name("cpu", "z", "n"): TWO}))
    assert lockfile.read(path).pins == {
        Name("cpu", "a", "n"): ONE,
        Name("cpu", "m", "n"): ONE,
        Name("cpu", "z", "n"): TWO,
    }


def test_a_conflict_is_named_with_its_line(tmp_path):
    path = tmp_path / LOCK
    path.write_text(merged(tmp_path, {Name("cpu", "z", "n"): ONE}, {Name("cpu", "z", "n"): TWO}))
    with pytest.raises(RecipeError, match="holds a merge conflict") as caught:
        lockfile.read(path, "dxb.lock")
    assert caught.value.code == "DXB-R502"
    assert path.read_text().splitlines()[caught.value.where.line - 1].startswith("<<<<<<<")
    assert "git checkout --ours dxb.lock" in caught.value.hint


BLOCK = f'[cpu."a:n"]\nkey = "{"1" * 64}"\noutput = "{"2" * 64}"\nsize = 3\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("version = 2\n", "has no `version = 1`"),
        (BLOCK, "has no `version = 1`"),
        ("version = 1\nx", "not valid TOML"),
        (f"version = 1\n{BLOCK}{BLOCK}", "not valid TOML: Cannot declare"),
        ("version = 1\n[Fast]\n", "`Fast` in the lock file is not a profile"),
        ("version = 1\ncpu = 3\n", "`cpu` in the lock file is not a profile"),
        (f"version = 1\n{BLOCK.replace('a:n', 'a')}", "`a` in the lock file is not of the form"),
        (f"version = 1\n{BLOCK}more = 1\n", "does not have exactly"),
        (f"version = 1\n{BLOCK.replace('size = 3', 'size = -3')}", "does not have exactly"),
        (f"version = 1\n{BLOCK.replace('size = 3', 'size = true')}", "does not have exactly"),
        (f"version = 1\n{BLOCK.replace('1' * 64, '1' * 63)}", "does not have exactly"),
        ("version = 1\nnames = 3\n", "`names` in the lock file is not a table"),
        ('version = 1\n[names]\n"a:n" = 3\n', "`names` of `a:n` in the lock file is not a table"),
        ("version = 1\n[names.a]\n", "`a` in the lock file is not of the form"),
    ],
)
def test_what_is_not_a_lock_file_is_refused(tmp_path, text, message):
    path = tmp_path / LOCK
    path.write_text(text)
    with pytest.raises(RecipeError, match=message) as caught:
        lockfile.read(path)
    assert caught.value.code == "DXB-R503"


def test_the_place_of_a_fault_is_told(tmp_path):
    path = tmp_path / LOCK
    path.write_text("version = 1\n\nx\n")
    with pytest.raises(RecipeError) as caught:
        lockfile.read(path, "dxb.lock")
    assert str(caught.value.where) == "dxb.lock:3:2"


def test_what_cannot_be_read_or_written_is_said(tmp_path):
    path = tmp_path / LOCK
    path.write_bytes(b"\xff")
    with pytest.raises(RecipeError, match="cannot read the lock file"):
        lockfile.read(path)
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match="the lock file cannot be written") as unwritten:
        lockfile.write(tmp_path / "file" / LOCK, Lock())
    assert unwritten.value.code == "DXB-S107"
    assert unwritten.value.facts == {"system says": "Not a directory"}
    assert "build again" in (unwritten.value.hint or "")


def test_what_a_killed_process_left_beside_the_lock_file_goes(tmp_path):
    dead, fresh, own = (tmp_path / name for name in (".tmp-0a1b2c3d00000000", ".tmp-0a1b2c3d00000001", ".tmp-notes"))
    for path in (dead, fresh, own):
        path.write_text("half")
    for path in (dead, own):
        os.utime(path, (1.0, 1.0))
    lockfile.write(tmp_path / LOCK, Lock())
    assert [path.exists() for path in (dead, fresh, own)] == [False, True, True]


@pytest.mark.parametrize(
    "fields",
    [
        "at_px = [1, 2]",
        f'at_px = [1, -2], photograph = "{"1" * 64}"',
        f'at_px = [1, true], photograph = "{"1" * 64}"',
        f'at_px = [1, 2], photograph = "{"1" * 63}"',
        f'at_px = [1, 2], photograph = "{"1" * 64}", size = "big"',
    ],
)
def test_a_name_without_its_point_is_refused(tmp_path, fields):
    path = tmp_path / LOCK
    path.write_text(f'version = 1\n[names."a:n"]\nmug = {{ {fields} }}\n')
    with pytest.raises(RecipeError, match="the name `mug` in the lock file") as caught:
        lockfile.read(path)
    assert caught.value.code == "DXB-R504"
