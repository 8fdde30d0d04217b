"""Histories of edits, builds, failures, kills, refusals, collections and damage, against the reference.

After each build: every node that is done has the output that the reference has; what ran was stale; and another build
runs nothing.
"""

from __future__ import annotations

import os
import shutil
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, precondition, rule, run_state_machine_as_test

from dextera_build import digest
from dextera_build.engine.eventlog import EventLog
from dextera_build.engine.events import fan_out
from dextera_build.engine.execute import RunResult, build
from dextera_build.engine.graph import Address
from dextera_build.engine.key import Writer
from dextera_build.engine.tasks import Executor
from dextera_build.errors import DxbError
from dextera_build.store import failpoints
from dextera_build.store.choose import Limits
from dextera_build.store.collect import collect
from dextera_build.store.store import Store
from dextera_build.store.verify import verify
from tests.chaos.clocks import clock
from tests.engine.tiny import Record
from tests.oracle.graphs import RandomGraph
from tests.oracle.reference import Reference
from tests.oracle.shuffled import Shuffled
from tests.store.stores import age_all

SEEDS = st.integers(0, 2**32 - 1)
JOBS = st.integers(1, 4)
REACHED = ("file.made", "file.written", "file.moved", "folder.made", "result.blobs", "result.published", "leaves.save")
REACHED += ("log.made", "log.event", "lock.taken", "running.announced", "running.ended", "use.noted")
POINTS = st.sampled_from(REACHED)
REFUSED = st.sampled_from([name for name in REACHED if failpoints.POINTS[name].fails])
COUNTS = st.sampled_from([1, 1, 2, 3, 5, 8, 13, 21, 34])


class Expected(Reference):
    """The reference, which remembers what it called."""

    def __post_init__(self) -> None:
        super().__post_init__()
        self.calls: dict[str, str] = {}
        self._writer = Writer()

    def result(self, address: str, call: Any, inputs: dict[str, Any]) -> str | None:
        output = super().result(address, call, inputs)
        self.calls[self.keys[address]] = digest.of_bytes(self._writer.document(call, inputs))
        return output


class Histories(RuleBasedStateMachine):
    """One project with one store."""

    @initialize(seed=SEEDS)
    def begin(self, seed: int) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="dxb-history-"))
        self.root = self.folder / "store"
        self.graph = RandomGraph(seed, self.folder, wild=True)
        self.dice = self.folder / "dice"
        self.dice.write_text("0")
        os.environ["TINY_DICE"] = str(self.dice)
        self.cache: dict[str, str] = {}
        self.keys: dict[str, str] = {}
        """What the reference calls a key -> key."""
        self.is_damaged = self.was_rolled = False
        self.offset_s = 0.0

    def teardown(self) -> None:
        if hasattr(self, "folder"):
            assert self.is_damaged or verify(Store(self.root)).is_whole
            shutil.rmtree(self.folder)

    @rule()
    def edit(self) -> None:
        self.graph.edit()

    @rule(place=st.integers(0, 2), digit=st.integers(0, 9), shift_s=st.sampled_from([None, 0, -86400, 86400]))
    def write_a_file(self, place: int, digit: int, shift_s: int | None) -> None:
        """With as many bytes as before and, as far as anyone may set it, the time that it had, or a wrong one."""
        path = self.graph.files[place]
        before = path.stat()
        path.write_text(f"content {digit}")
        if shift_s is not None:
            stamp = before.st_mtime_ns + shift_s * 10**9
            os.utime(path, ns=(stamp, stamp))

    @rule(name=st.sampled_from(["a", "b", "c/d"]), text=st.sampled_from([None, "1", "2"]))
    def change_the_folder(self, name: str, text: str | None) -> None:
        self.graph.plant(name, text)

    @rule(offset_s=st.sampled_from([0.0, -3601.0, -1e8, 60.0, 86400.0, 1e8]))
    def set_the_clock(self, offset_s: float) -> None:
        """That of the builds, and not that of the file system."""
        self.offset_s = offset_s

    @rule()
    def break_one(self) -> None:
        self.graph.break_one()

    @rule()
    def mend(self) -> None:
        self.graph.mend()

    @precondition(lambda self: not self.is_damaged)
    @rule(digit=st.integers(0, 9))
    def roll(self, digit: int) -> None:
        self.dice.write_text(str(digit))
        self.was_rolled = True

    @rule(jobs=JOBS, seed=SEEDS, keep_going=st.booleans(), force=st.booleans())
    def build(self, jobs: int, seed: int, keep_going: bool, force: bool) -> None:
        """Nothing goes wrong but what was broken by hand."""
        targets, found = self.expect()
        named = sorted(name for name, output in found.outputs.items() if output)
        forced = frozenset(named[seed % len(named) :][:2]) if force and named else frozenset()
        result, record = self.go(targets, Shuffled(jobs, seed), keep_going=keep_going, force=forced)
        assert result.ok == (not found.failed)
        stale = found.ran | {found.keys[name] for name in forced}
        ran = self.check(found, result, record, stale)
        if (result.ok or keep_going) and not self.is_damaged:
            assert set(ran) == stale
            assert {name: node.output for name, node in result.nodes.items()} == found.outputs
        if result.ok:
            again, record = self.go(targets, Shuffled(jobs, seed + 1))
            assert again.ok
            assert record.with_status("ran") == []
            assert {name: n.output for name, n in again.nodes.items()} == found.outputs

    @rule(jobs=JOBS, seed=SEEDS, number=COUNTS)
    def build_while_a_worker_dies(self, jobs: int, seed: int, number: int) -> None:
        targets, found = self.expect()
        result, record = self.go(targets, Shuffled(jobs, seed, lambda count: count == number), keep_going=True)
        self.check(found, result, record, found.ran)

    @rule(jobs=JOBS, seed=SEEDS, number=COUNTS, place=st.integers(0, 2))
    def build_while_a_file_is_edited(self, jobs: int, seed: int, number: int, place: int) -> None:
        """Outputs are those of the old content, or the node fails; none is published for the wrong one."""
        targets, found = self.expect()

        def disturb(count: int) -> bool:
            if count == number:
                self.graph.files[place].write_text(f"meanwhile {seed % 3}")
            return False

        result, record = self.go(targets, Shuffled(jobs, seed, disturb), keep_going=True)
        self.check(found, result, record, found.ran)
        codes = {node.error.code for name, node in result.nodes.items() if node.error and name not in found.failed}
        assert codes <= {"DXB-B304"}

    @rule(jobs=JOBS, seed=SEEDS, point=POINTS, count=COUNTS)
    def kill_a_build(self, jobs: int, seed: int, point: str, count: int) -> None:
        targets, found = self.expect()
        pid = os.fork()
        if pid == 0:
            try:
                failpoints.arm(f"{point}:kill:{count}")
                self.go(targets, Shuffled(jobs, seed), keep_going=True)
                os._exit(0)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) in (0, -9)
        self.learn(found)

    @rule(jobs=JOBS, seed=SEEDS, point=REFUSED, does=st.sampled_from(sorted(failpoints.ERRORS)), count=COUNTS)
    def refuse_a_build(self, jobs: int, seed: int, point: str, does: str, count: int) -> None:
        """Whatever the system refuses, errors have codes and nothing wrong is published."""
        targets, found = self.expect()
        failpoints.arm(f"{point}:{does}:{count}")
        try:
            result, record = self.go(targets, Shuffled(jobs, seed), keep_going=True)
            failpoints.arm("")
            self.check(found, result, record, found.ran)
        except DxbError:
            self.learn(found)
        finally:
            failpoints.arm("")

    @rule(aged=st.booleans())
    def collect(self, aged: bool) -> None:
        if aged and self.root.exists():
            age_all(Store(self.root), time.time() - 2 * 86400)
        collect(Store(self.root), dict, Limits(size=0), dry=False)
        actions = Store(self.root).actions
        self.cache = {name: output for name, output in self.cache.items() if actions.get(self.keys[name]) is not None}

    @precondition(lambda self: not self.was_rolled)
    @rule(place=st.floats(0, 1, exclude_max=True), how=st.sampled_from(["deleted", "flipped", "short", "zeros"]))
    def damage(self, place: float, how: str) -> None:
        """A blob or an entry."""
        found = sorted(path for kind in ("cas", "ac") for path in (self.root / kind).glob("??/*"))
        if not found:
            return
        self.is_damaged = True
        path = found[int(place * len(found))]
        data = path.read_bytes()
        path.unlink()
        if how != "deleted":
            middle = len(data) // 2
            flipped = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
            path.write_bytes({"flipped": flipped, "short": data[:middle], "zeros": bytes(len(data))}[how])

    def expect(self) -> tuple[list[Address], Expected]:
        """Some targets, and what the reference makes of them from what is published."""
        targets, found = self.graph.targets(), Expected(self.graph.graph(), dict(self.cache))
        found.build(targets)
        return targets, found

    def go(
        self,
        targets: list[Address],
        executor: Executor,
        *,
        keep_going: bool = False,
        force: frozenset[str] = frozenset(),
    ) -> tuple[RunResult, Record]:
        """Build as a new process would, with a log."""
        record, store = Record(), Store(self.root)
        # Of two writes in one step of the file system's clock only a clock that agrees with it can tell.
        time.sleep(0.01 if self.offset_s > 0 else 0)
        with clock(self.offset_s), EventLog(store) as log:
            listen = fan_out(log, record)
            plan = self.graph.graph()
            done = build(
                plan, targets, store=store, executor=executor, listen=listen, keep_going=keep_going, force=force
            )
        return done, record

    def check(self, found: Expected, result: RunResult, record: Record, stale: set[str]) -> list[str]:
        """Compare what is done with the reference; returns what ran, by the names that the reference gives keys."""
        for name, node in result.nodes.items():
            if node.status in ("ran", "cached"):
                assert node.output == found.outputs[name], name
        ran = [found.keys[name] for name in record.with_status("ran")]
        if not self.is_damaged:
            assert set(ran) <= stale
            assert {name for name, times in Counter(ran).items() if times > 1} <= stale - found.ran
        self.learn(found)
        return ran

    def learn(self, found: Expected) -> None:
        """Take over what was published; all of it must be what the reference makes."""
        actions = Store(self.root).actions
        for name, key in found.calls.items():
            outline = actions.outline(key)
            if outline is not None:
                assert outline[0] == found.cache[name]
                self.cache[name], self.keys[name] = outline[0], key
            else:
                assert name not in self.cache or self.is_damaged
                self.cache.pop(name, None)


def play(histories: int, steps: int) -> None:
    """Try so many histories; a failing one is said as it was found, then made smaller."""
    run_state_machine_as_test(
        Histories,
        settings=settings(
            max_examples=histories,
            stateful_step_count=steps,
            deadline=None,
            database=None,
            phases=(Phase.generate, Phase.shrink),
            suppress_health_check=list(HealthCheck),
        ),
    )


def test_a_few_histories_end_as_the_reference_says() -> None:
    """Promise: after any history a build is what a build of everything would be, and runs only what is stale."""
    play(12, 8)


@pytest.mark.slow
@pytest.mark.timeout(3000)
@pytest.mark.parametrize("part", range(4))
def test_thousands_of_histories_end_as_the_reference_says(part: int) -> None:
    """Promise: the same, 500 histories in each of four parts."""
    play(500, 12)
