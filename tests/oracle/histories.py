"""A project with a store, and what may happen to it: edits, builds, failures, kills, refusals, collections, damage.

After each build: every node that is done has the output that the reference has; what ran was stale; and another build
runs nothing.
"""

from __future__ import annotations

import os
import random
import shutil
import tempfile
import time
import traceback
from contextlib import nullcontext
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from dextera_build import digest
from dextera_build.engine.graph import Address
from dextera_build.engine.key import Writer
from dextera_build.engine.policy import RunPolicy
from dextera_build.engine.run import RunResult, build
from dextera_build.errors import DxbError
from dextera_build.gc.choose import Limits
from dextera_build.gc.collect import collect
from dextera_build.gc.verify import verify
from dextera_build.runs.events import fan_out
from dextera_build.runs.log import EventLog
from dextera_build.store import failpoints
from dextera_build.store.store import Store
from dextera_build.workers.capacity import Capacity
from dextera_build.workers.pool import LocalExecutor
from dextera_build.workers.protocol import Executor
from tests.chaos.clocks import clock
from tests.engine.tiny import RUNNER, Record
from tests.oracle.graphs import RandomGraph
from tests.oracle.reference import Reference
from tests.oracle.shuffled import Shuffled
from tests.store.stores import age_all

SEEDS = st.integers(0, 2**32 - 1)
JOBS = st.integers(1, 4)
REACHED = ("file.made", "file.written", "file.moved", "folder.made", "result.blobs", "result.published", "leaves.save")
REACHED += ("log.made", "log.event", "lock.taken", "running.announced", "running.ended", "use.noted")
REFUSED = [name for name in REACHED if failpoints.POINTS[name].fails]
CHANGES = st.sampled_from([*["rewrite"] * 4, "edit", "edit", "tree", "roll", "roll", "clock", "break_one", "mend"])
DISTURBED = st.sampled_from(
    ["while_a_worker_dies", "while_a_file_is_edited", "and_be_killed", "and_be_killed", "and_be_refused"]
)
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

    @rule(kinds=st.lists(CHANGES, min_size=1, max_size=4), seed=SEEDS)
    def change(self, kinds: list[str], seed: int) -> None:
        """Things that may matter, or may not."""
        chance = random.Random(seed)
        for kind in kinds:
            self.change_one(kind, chance)

    def change_one(self, kind: str, chance: random.Random) -> None:
        if kind == "rewrite":
            for path in chance.sample(self.graph.files, chance.randint(1, 3)):
                self.rewrite(path, chance)
        elif kind == "tree":
            self.graph.plant(chance.choice(["a", "b", "c/d"]), chance.choice([None, "1", "2"]))
        elif kind == "roll" and not self.is_damaged:
            self.dice.write_text(str(chance.randrange(10)))
            self.was_rolled = True
        elif kind == "clock":
            self.offset_s = chance.choice([0.0, -3601.0, -1e8, 60.0, 86400.0, 1e8])
        elif kind in ("edit", "break_one", "mend"):
            getattr(self.graph, kind)()

    def rewrite(self, path: Path, chance: random.Random) -> None:
        """With as many bytes as before and, as far as anyone may set it, the time that it had, or a wrong one."""
        stamp = path.stat().st_mtime_ns + chance.choice([0, 0, 0, 0, 0, 0, -86400, 86400]) * 10**9
        path.write_text(f"content {chance.randrange(4)}")
        os.utime(path, ns=(stamp, stamp))

    @rule(jobs=JOBS, seed=SEEDS, keep_going=st.booleans(), force=st.booleans())
    def build(self, jobs: int, seed: int, keep_going: bool, force: bool) -> None:
        """Nothing goes wrong but what was broken by hand."""
        targets, found = self.expect(seed)
        named = sorted(name for name, output in found.outputs.items() if output)
        forced = frozenset(random.Random(seed).sample(named, min(4, len(named)))) if force else frozenset()
        result, record = self.go(targets, self.executor(jobs, seed), keep_going=keep_going, force=forced)
        assert result.ok == (not found.failed)
        stale = found.ran | {found.keys[name] for name in forced}
        ran = self.check(found, result, record, stale)
        if (result.ok or keep_going) and not self.is_damaged:
            assert set(ran) == stale
            assert {name: node.output for name, node in result.nodes.items()} == found.outputs
        if result.ok:
            again, record = self.go(targets, self.executor(jobs, seed + 1))
            assert again.ok
            assert record.with_status("ran") == []
            assert {name: n.output for name, n in again.nodes.items()} == found.outputs

    @rule(how=DISTURBED, jobs=JOBS, seed=SEEDS, count=COUNTS)
    def disturbed(self, how: str, jobs: int, seed: int, count: int) -> None:
        """What is done is right, whatever is not; and what was published is."""
        targets, found = self.expect(seed)
        getattr(self, f"build_{how}")(targets, found, jobs, random.Random(seed), count)

    def build_while_a_worker_dies(
        self, targets: list[Address], found: Expected, jobs: int, chance: random.Random, count: int
    ) -> None:
        executor = Shuffled(jobs, chance.random(), lambda number: number == count)
        self.check(found, *self.go(targets, executor, keep_going=True), found.ran)

    def build_while_a_file_is_edited(
        self, targets: list[Address], found: Expected, jobs: int, chance: random.Random, count: int
    ) -> None:
        """Outputs are those of the old content, or the node fails; none is published for the wrong one."""
        path, text = chance.choice(self.graph.files), f"meanwhile {chance.randrange(3)}"

        def disturb(number: int) -> bool:
            if number == count:
                path.write_text(text)
            return False

        result, record = self.go(targets, Shuffled(jobs, chance.random(), disturb), keep_going=True)
        if self.is_damaged:
            self.learn(found)  # files whose bytes were lost are read again, some of them after the edit
        else:
            self.check(found, result, record, found.ran)
        codes = {node.error.code for name, node in result.nodes.items() if node.error and name not in found.failed}
        assert codes <= {"DXB-B304"}

    def build_and_be_killed(
        self, targets: list[Address], found: Expected, jobs: int, chance: random.Random, count: int
    ) -> None:
        pid = os.fork()
        if pid == 0:
            try:
                failpoints.arm(f"{chance.choice(REACHED)}:kill:{count}")
                self.go(targets, Shuffled(jobs, chance.random()), keep_going=True)
                os._exit(0)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(1)
        assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) in (0, -9)
        self.learn(found)

    def build_and_be_refused(
        self, targets: list[Address], found: Expected, jobs: int, chance: random.Random, count: int
    ) -> None:
        """Whatever the system refuses, errors have codes and nothing wrong is published."""
        failpoints.arm(f"{chance.choice(REFUSED)}:{chance.choice(sorted(failpoints.ERRORS))}:{count}")
        try:
            result, record = self.go(targets, Shuffled(jobs, chance.random()), keep_going=True)
            failpoints.arm("")
            self.check(found, result, record, found.ran)
        except DxbError:
            self.learn(found)
        finally:
            failpoints.arm("")

    @rule(seed=SEEDS)
    def upset(self, seed: int) -> None:
        """Collect, or damage a store whose rules always give the same."""
        chance = random.Random(seed)
        if chance.random() < 0.3 and not self.was_rolled:
            self.damage(chance)
        else:
            self.collect(aged=chance.random() < 0.5)

    def collect(self, *, aged: bool) -> None:
        if aged and self.root.exists():
            age_all(Store(self.root), time.time() - 2 * 86400)
        collect(Store(self.root), dict, Limits(size=0), dry=False)
        actions = Store(self.root).actions
        self.cache = {name: output for name, output in self.cache.items() if actions.get(self.keys[name]) is not None}

    def damage(self, chance: random.Random) -> None:
        """Harm some blobs and entries."""
        self.is_damaged = True
        for path in sorted(path for kind in ("cas", "ac") for path in (self.root / kind).glob("??/*")):
            if chance.random() < 0.2:
                data = path.read_bytes()
                middle = chance.randrange(len(data)) if data else 0
                flipped = data[:middle] + bytes(byte ^ 1 for byte in data[middle : middle + 1]) + data[middle + 1 :]
                path.unlink()
                left = chance.choice([None, flipped, flipped, data[:middle], bytes(len(data))])
                if left is not None:
                    path.write_bytes(left)

    def executor(self, jobs: int, seed: int) -> Executor:
        """What carries out an undisturbed build."""
        return Shuffled(jobs, seed)

    def expect(self, seed: int) -> tuple[list[Address], Expected]:
        """Some or all calls, and what the reference makes of them from what is published."""
        plan = self.graph.graph()
        targets = [Address(path) for path, _ in plan.calls()] if seed % 4 else self.graph.targets()
        found = Expected(plan, dict(self.cache))
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
        workers = executor if isinstance(executor, LocalExecutor) else nullcontext()
        with clock(self.offset_s), EventLog(store) as log, workers:
            listen = fan_out(log, record)
            plan = self.graph.graph()
            done = build(
                plan, targets, store=store, executor=executor, listen=listen, policy=RunPolicy(keep_going, force)
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
            assert len(ran) == len(set(ran))
        self.learn(found)
        return ran

    def learn(self, found: Expected) -> None:
        """Take over what was published; all of it must be what the reference makes."""
        actions = Store(self.root).actions
        for name, key in found.calls.items():
            known = actions.known(key)
            # A flipped bit may have made another digest of an entry that no build has looked at since.
            assert known is None or known.output == found.cache.get(name) or self.is_damaged
            if known is not None and known.output == found.cache.get(name):
                self.cache[name], self.keys[name] = known.output, key
            else:
                assert name not in self.cache or self.is_damaged
                self.cache.pop(name, None)


class HistoriesWithWorkers(Histories):
    """Undisturbed builds run in processes of their own, which publish what they make."""

    def executor(self, jobs: int, seed: int) -> Executor:
        return LocalExecutor(RUNNER, Capacity(jobs, 4.0), {"TINY_DICE": str(self.dice)})
