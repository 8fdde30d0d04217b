"""Standard output and standard error that nobody reads end no build; where they cannot be written, it is no success."""

from __future__ import annotations

import json
import shlex
import subprocess
import sys

import pytest

from tests.e2e.space import Answer, Space

DXB = f"{shlex.quote(sys.executable)} -m dextera_build"
RECIPE = """
nodes:
  start: {rule: toy.start, text: one}
  slow: {rule: toy.slow, text: $start, seconds: 0.0}
targets: {default: [slow]}
"""


def shell(space: Space, line: str) -> Answer:
    """Run a line of bash, with the exit code of `dxb`."""
    command = ["bash", "-c", f"set -o pipefail; {line.replace('dxb', DXB)}"]
    done = subprocess.run(command, cwd=space.root, env=space.environment(), text=True, capture_output=True, timeout=120)
    return Answer(done.returncode, done.stdout, done.stderr)


@pytest.fixture
def slow(space: Space) -> Space:
    space.write("recipes/slow.yaml", RECIPE)
    return space


@pytest.fixture
def slower(slow: Space) -> Space:
    """A build that lasts after its reader has left."""
    slow.edit("recipes/slow.yaml", "seconds: 0.0", "seconds: 0.7")
    return slow


@pytest.mark.medium
@pytest.mark.parametrize(("do", "code"), [("work", 0), ("raise", 1)])
@pytest.mark.parametrize("console", ["plain", "jsonl"])
def test_a_build_goes_on_though_nobody_reads_and_ends_with_its_own_code(
    slower: Space, console: str, do: str, code: int
) -> None:
    answer = shell(slower, f"dxb build slow --console {console} --set slow.do={do} 2>&1 | head -1")
    assert answer.code == code
    assert "Traceback" not in answer.out + answer.err
    ended = json.loads((slower.root / "cache/runs/0001/events.jsonl").read_text().splitlines()[-1])
    assert (ended["event"], ended["ok"]) == ("run_finished", code == 0)
    if not code:  # the answer of a snapshot has no reader either
        assert shell(slower, f"dxb build slow --set slow.do={do} 2>&1 | true").code == 0


@pytest.mark.medium
def test_results_are_printed_though_nobody_reads_errors(slower: Space) -> None:
    answer = shell(slower, "{ dxb build slow --console plain 2>&1 1>&3 | head -1; } 3>&1")
    assert answer.code == 0
    assert answer.out.endswith("slow\tcache/out/slow/slow/slow\n")


@pytest.mark.medium
@pytest.mark.parametrize(("to", "why"), [(">&-", "Bad file descriptor"), ("> /dev/full", "No space left on device")])
def test_results_that_cannot_be_printed_are_no_success(slow: Space, to: str, why: str) -> None:
    for _ in range(3):  # what was built stays; the answer of a snapshot cannot be printed either
        answer = shell(slow, f"dxb build slow {to}")
        assert answer.code == 1
        assert answer.err.endswith(f"error: standard output cannot be written: {why}\n")
        assert "Traceback" not in answer.err
    assert "up to date" in answer.err
    assert slow.dxb("build", "slow").out == "slow\tcache/out/slow/slow/slow\n"


@pytest.mark.medium
@pytest.mark.parametrize(("to", "why"), [("2>&-", "Bad file descriptor"), ("2> /dev/full", "No space left on device")])
def test_events_that_cannot_be_printed_are_no_success(slow: Space, to: str, why: str) -> None:
    for _ in range(2):
        answer = shell(slow, f"dxb build slow --console plain {to}")
        assert (answer.code, answer.out) == (1, f"error: standard error cannot be written: {why}\n")
    assert shell(slow, f"dxb build slow:nothing {to}").code != 0
    # Who wants silence may have it.
    assert shell(slow, f"dxb build slow --console none {to}").code == 0


@pytest.mark.medium
def test_all_streams_closed(slow: Space) -> None:
    answer = shell(slow, "dxb build slow --console plain <&- >&- 2>&-")
    assert answer.code == 1
    assert slow.dxb("build", "slow").code == 0
    assert slow.dxb("cache", "verify").code == 0


@pytest.mark.slow
def test_a_list_that_is_cut_off_is_mute(slow: Space) -> None:
    slow.dxb("build", "slow")
    answer = shell(slow, "dxb ls rules --json | head -c 1")
    assert answer.err == ""
    assert answer.code in (0, 141)  # it may have been written before the reader went
