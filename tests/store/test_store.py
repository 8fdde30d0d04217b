"""The store's folder, locks, and placing blobs."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from dextera_build import digest
from dextera_build.store.blobs import MissingBlob
from dextera_build.store.store import Store

KEY, OTHER = digest.of_bytes(b"key"), digest.of_bytes(b"other")

_HOLD = """
import sys
from pathlib import Path
from dextera_build.store.locks import Locks
assert Locks(Path(sys.argv[1])).take(sys.argv[2])
print("held", flush=True)
sys.stdin.readline()
"""


@pytest.fixture
def store(tmp_path: Path) -> Store:
    return Store(tmp_path / "deep" / "store")


def hold(store: Store, key: str) -> subprocess.Popen[str]:
    root = str(Path(__file__).parents[2])
    child = subprocess.Popen(
        [sys.executable, "-c", _HOLD, str(store.local / "locks"), key],
        env={**os.environ, "PYTHONPATH": root},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "held\n"
    return child


def test_the_folder_is_marked_as_a_cache(store: Store) -> None:
    assert (store.root / "CACHEDIR.TAG").read_bytes().startswith(b"Signature: 8a477f597d28d172789f06886806bc55")


def test_size_counts_blobs_and_results(store: Store) -> None:
    assert store.size() == {"blobs": (0, 0), "actions": (0, 0), "keep": (0, 0)}
    store.blobs.put(b"12345")
    store.blobs.put(b"123")
    assert store.size() == {"blobs": (2, 8), "actions": (0, 0), "keep": (0, 0)}


def test_a_lock_excludes_other_processes_until_they_die(store: Store) -> None:
    child = hold(store, KEY)
    assert not store.locks.take(KEY)
    assert store.locks.take(OTHER)  # keys are locked separately
    child.kill()
    child.communicate()
    assert store.locks.take(KEY)
    store.locks.release(KEY)
    store.locks.release(OTHER)


def test_a_lock_excludes_others_of_this_process(store: Store) -> None:
    twin = Store(store.root)
    assert store.locks.take(KEY)
    assert not twin.locks.take(KEY)
    store.locks.release(KEY)
    assert twin.locks.take(KEY)
    twin.locks.release(KEY)


def test_waiting_ends_when_the_lock_is_given_back(store: Store) -> None:
    order: list[str] = []

    def second() -> None:
        with Store(store.root).locks.hold(KEY, patience_s=0.005):
            order.append("second")

    with store.locks.hold(KEY):
        thread = threading.Thread(target=second)
        thread.start()
        time.sleep(0.05)
        order.append("first")
    thread.join()
    assert order == ["first", "second"]


def test_locks_leave_no_files(store: Store) -> None:
    for number in range(50):
        key = digest.of_value(number)
        assert store.locks.take(key)
        store.locks.release(key)
    assert [path.name for path in store.local.iterdir()] == ["locks"]
    assert (store.local / "locks").stat().st_size == 0


def test_a_placed_blob_is_a_writable_copy(store: Store, tmp_path: Path) -> None:
    key = store.blobs.put(b"mesh")
    target = tmp_path / "out" / "mesh.obj"
    store.blobs.place(key, target)
    target.write_bytes(b"edited")
    assert store.blobs.get(key) == b"mesh"
    store.blobs.place(key, target)  # replaces the existing file
    assert target.read_bytes() == b"mesh"


def test_a_damaged_blob_is_not_placed(store: Store, tmp_path: Path) -> None:
    key = store.blobs.put(b"mesh")
    store.blobs.path(key).chmod(0o644)
    store.blobs.path(key).write_bytes(b"hsem")
    with pytest.raises(MissingBlob, match="damaged"):
        store.blobs.place(key, tmp_path / "mesh.obj")
    assert not (tmp_path / "mesh.obj").exists()
    with pytest.raises(MissingBlob, match="it is not there"):
        store.blobs.place(key, tmp_path / "mesh.obj")


def test_a_program_may_use_any_number_of_stores(store: Store, tmp_path: Path) -> None:
    def others_may_take_it() -> bool:
        root = str(Path(__file__).parents[2])
        words = [sys.executable, "-c", _HOLD, str(store.local / "locks"), KEY]
        return not subprocess.run(
            words, env={**os.environ, "PYTHONPATH": root}, input=b"", capture_output=True
        ).returncode

    assert store.locks.take(KEY)
    before = len(os.listdir("/proc/self/fd"))
    for number in range(300):
        other = Store(tmp_path / f"{number}")
        assert other.locks.take(KEY)
        other.locks.release(KEY)
    assert len(os.listdir("/proc/self/fd")) < before + 100
    assert not others_may_take_it()
    store.locks.release(KEY)
    assert others_may_take_it()
