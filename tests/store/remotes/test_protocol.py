"""Our messages beside the code that protobuf's own compiler made from the published files."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dextera_build import digest
from dextera_build.store import reapi, wire
from tests.store.remotes import buildgrid_server
from tests.store.remotes.messages import CLASSES, THEIRS, messages, numbered, plain

pytestmark = pytest.mark.slow

Ask = Callable[[str, bytes], dict[str, Any]]
FIXTURE = settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow], deadline=None)
PATHS = st.text(min_size=1, max_size=9)
OUTPUTS = st.builds(reapi.OutputFile, PATHS, st.just("a" * 64), st.integers(0, 1 << 50), st.just(b"")) | st.builds(
    lambda path, contents: reapi.OutputFile(path, digest.of_bytes(contents), len(contents), contents),
    PATHS,
    st.binary(max_size=200),
)
# Fields of a result that dxb does not know: exit code, stdout, symlinks, metadata with time stamps, executable files.
RICH = {
    "output_files": [
        {"path": "bin/tool", "digest": {"hash": "a" * 64, "size_bytes": "9"}, "is_executable": True},
        {"path": "empty", "digest": {"hash": "b" * 64}, "node_properties": {"unix_mode": 420}},
    ],
    "output_symlinks": [{"path": "link", "target": "bin/tool"}],
    "output_directories": [{"path": "dir", "tree_digest": {"hash": "c" * 64, "size_bytes": "80"}}],
    "stdout_raw": "aGVsbG8=",
    "execution_metadata": {"worker": "w1", "queued_timestamp": "2024-05-01T10:00:00.5Z"},
}


@pytest.fixture(scope="module")
def ask() -> Iterator[Ask]:
    """What the protobuf runtime makes of bytes."""
    command = [buildgrid_server.python(), str(Path(__file__).with_name("peer.py"))]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as peer:
        assert peer.stdin is not None
        assert peer.stdout is not None
        outgoing, incoming = peer.stdin, peer.stdout

        def question(name: str, data: bytes) -> dict[str, Any]:
            outgoing.write(json.dumps({"name": name, "hex": data.hex()}) + "\n")
            outgoing.flush()
            return json.loads(incoming.readline())

        yield question
        outgoing.close()


def name(kind: type) -> str:
    return THEIRS.get(kind.__name__, kind.__name__)


@FIXTURE
@given(st.sampled_from(CLASSES).flatmap(messages))
def test_protobuf_reads_what_we_write_and_we_read_what_it_writes(ask: Ask, message: Any) -> None:
    theirs = ask(name(type(message)), wire.encode(message))
    assert theirs["fields"] == plain(message)
    assert wire.decode(type(message), bytes.fromhex(theirs["hex"])) == message


@FIXTURE
@given(st.sampled_from(CLASSES).flatmap(messages), st.data())
def test_what_we_take_for_a_message_is_one(ask: Ask, message: Any, data: st.DataObject) -> None:
    """We may be stricter than protobuf, but never read what it refuses, nor read it differently."""
    changed = bytearray(wire.encode(message))
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(changed)))
        changed[place : place + data.draw(st.integers(0, 2))] = data.draw(st.binary(max_size=3))
    try:
        ours = plain(wire.decode(type(message), bytes(changed)))
    except ValueError:
        return
    theirs = ask(name(type(message)), bytes(changed))
    if "error" in theirs:
        theirs = ask(name(type(message)), _named(type(message), bytes(changed)))
    assert "error" not in theirs
    assert _within(ours, theirs["fields"])


@FIXTURE
@given(st.lists(OUTPUTS, max_size=4))
def test_results_of_ours_are_results(ask: Ask, outputs: list[reapi.OutputFile]) -> None:
    theirs = ask("ActionResult", reapi.encode(outputs))
    sizes = [int(file.get("2", {}).get("2", 0)) for file in theirs["fields"].get("2", [])]
    assert sizes == [file.size for file in outputs]
    if outputs:
        assert reapi.decode(bytes.fromhex(theirs["hex"])) == outputs


def test_results_of_other_tools_are_read_or_refused() -> None:
    script = (
        "import json, sys\n"
        "from google.protobuf import json_format\n"
        "from buildgrid._protos.build.bazel.remote.execution.v2.remote_execution_pb2 import ActionResult\n"
        "print(json_format.ParseDict(json.load(sys.stdin), ActionResult()).SerializeToString().hex())"
    )

    def made(**changes: Any) -> bytes:
        text = json.dumps({**RICH, **changes})
        done = subprocess.run(
            [buildgrid_server.python(), "-c", script], input=text, capture_output=True, text=True, check=True
        )
        return bytes.fromhex(done.stdout)

    assert [(file.path, file.size) for file in reapi.decode(made())] == [("bin/tool", 9), ("empty", 0)]
    with pytest.raises(ValueError, match="failed action"):
        reapi.decode(made(exit_code=1))
    with pytest.raises(ValueError, match="failed action"):
        reapi.decode(made(exit_code=-9))
    with pytest.raises(ValueError, match="no output files"):
        reapi.decode(made(output_files=[]))


def _named(kind: type, data: bytes) -> bytes:
    """A message without the fields that we do not name: what is passed over may be text that is none."""
    known = {number: inner for number, (_, inner, _) in numbered(kind).items()}
    parts = []
    for number, value in wire.fields(data):
        if isinstance(value, int):
            parts.append(wire.varint(number << 3) + wire.varint(value))
        elif number in known:
            inner = known[number]
            parts.append(wire.field(number, _named(inner, value) if is_dataclass(inner) else value))
    return b"".join(parts)


def _within(ours: Any, theirs: Any) -> bool:
    """Whether both say the same wherever we know the field; numbers of 32 bits lose the rest in protobuf."""
    if isinstance(ours, dict):
        return all(_within(body, (theirs or {}).get(number)) for number, body in ours.items())
    if isinstance(ours, list):
        return len(ours) == len(theirs or []) and all(map(_within, ours, theirs))
    if isinstance(ours, int):
        return (ours - int(theirs or 0)) % (1 << 32) == 0
    return bool(ours == theirs)
