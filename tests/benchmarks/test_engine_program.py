"""The program that measures dxb beside other tools: its checks would notice a fault, its tables have a form."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests.benchmarks.engine import measure, page, table
from tests.benchmarks.engine.dags import FACTOR, PRIME, SHAPES, Dag, evaluate
from tests.benchmarks.engine.extras import folder, graphs
from tests.benchmarks.engine.extras.row import Bench, Row
from tests.benchmarks.engine.phases import PHASES, Cell, Limits, course
from tests.benchmarks.engine.tools.all import TOOLS
from tests.benchmarks.engine.tools.make import Make
from tests.benchmarks.engine.tools.tool import REPO

QUICK = Limits(cell=60, repeats=1)


def run(*words: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "tests.benchmarks.engine", *words]
    return subprocess.run(command, cwd=REPO, capture_output=True, text=True)


def test_what_is_measured_has_byte_code_and_no_settings(monkeypatch):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("DXB_JOBS", "1")
    seen = measure.environment(HOME="/nowhere")
    assert not {"PYTHONDONTWRITEBYTECODE", "DXB_JOBS"} & set(seen)
    assert seen["HOME"] == "/nowhere"
    assert "PATH" in seen


@pytest.mark.slow
def test_dxb_and_make_on_thirty_nodes(tmp_path):
    stem = tmp_path / "results"
    words = ["--tools", "dxb,make", "--shapes", "layered", "--sizes", "30", "--repeats", "1", "--out", str(stem)]
    done = run(*words)
    assert done.returncode == 0, done.stdout + done.stderr
    results = json.loads(stem.with_suffix(".json").read_text())
    cells = {(cell["tool"], cell["phase"]): cell for cell in results["cells"]}
    assert set(cells) == {(tool, phase) for tool in ("dxb", "make") for phase in PHASES}
    assert all(cell["state"] == "ok" and cell["seconds"] > 0 and cell["rss_mib"] > 1 for cell in cells.values())
    reached = SHAPES["layered"](30).reached_from("l0")
    ran = {place: cell["ran"] for place, cell in cells.items()}
    assert ran["dxb", "cold"] == ran["make", "cold"] == 30
    assert ran["dxb", "no-op"] == ran["make", "no-op"] == 0
    assert ran["dxb", "leaf"] == ran["make", "leaf"] == ran["make", "comment"] == ran["make", "touched"] == reached
    assert [ran["dxb", phase] for phase in ("back", "comment", "touched", "deleted")] == [0, 1, 0, 0]
    assert done.stdout == stem.with_suffix(".md").read_text()
    assert "### layered, 30 nodes" in done.stdout
    row = r"\| (dxb|make) \|( [\d.]+ m?s \|){7} \d+ \| [\d /]+ \|"
    assert len(re.findall(row, done.stdout)) == 2
    assert {row["tool"] for row in results["rows"]} == {"python", "dxb", "make"}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("size", [1, 7, 30, 1000])
def test_graphs_have_the_size_and_every_value_follows_the_leaf(shape, size):
    dag = SHAPES[shape](size)
    assert len(dag.nodes) == size
    seen = set(dag.leaves)
    for node, inputs in dag.nodes.items():
        assert set(inputs) <= seen
        assert len(set(inputs)) == len(inputs) <= 3
        seen.add(node)
    before, after = evaluate(dag, dag.leaves), evaluate(dag, {**dag.leaves, "l0": dag.leaves["l0"] + 1})
    assert sum(before[node] != after[node] for node in dag.nodes) == dag.reached_from("l0")


def test_a_node_by_hand():
    dag = Dag("hand", {"l0": 5}, {"n0": ("l0",), "n1": ("l0", "n0")})
    assert evaluate(dag, dag.leaves) == {"l0": 5, "n0": 5 * FACTOR, "n1": (5 + 5 * FACTOR) * FACTOR % PRIME + 1}


class Careless(Make):
    """A make that does not know its leaves."""

    def write(self, dag: Dag, folder: Path) -> None:
        super().write(dag, folder)
        file = folder / "Makefile"
        file.write_text(file.read_text().replace("leaves/l0\n", "| leaves/l0\n").replace("in $^", "in $^ $|"))


class Eager(Make):
    """A make that claims to stop where nothing changed."""

    cutoff = True


class Broken(Make):
    """A tool that ends badly."""

    name = "ninja"

    def command(self, folder: Path) -> list[str]:
        return [*super().command(folder), "nothing-of-this-name"]


class Slow(Make):
    """A make that does not end."""

    def command(self, folder: Path) -> list[str]:
        return ["sh", "-c", "sleep 60 & sleep 60"]


def measured(tool: Make, work: Path, limits: Limits = QUICK) -> dict[str, Cell]:
    return {cell.phase: cell for cell in course(tool, SHAPES["chain"](5), work, limits, list(PHASES))}


def test_a_result_that_is_old_is_wrong(tmp_path):
    cell = measured(Careless(), tmp_path)["leaf"]
    assert (cell.state, cell.ran) == ("wrong", 0)
    assert cell.why.startswith("n4 is ")


def test_nodes_that_need_not_run_are_counted(tmp_path):
    cells = measured(Eager(), tmp_path)
    assert cells["comment"].why == "5 nodes ran, not 0 to 1"
    assert cells["no-op"].state == "ok"


def test_a_failure_ends_the_course_and_is_said(tmp_path):
    cells = measured(Broken(), tmp_path)
    assert cells["cold"].state == "failed"
    assert "nothing-of-this-name" in cells["cold"].why
    assert {cell.state for phase, cell in cells.items() if phase != "cold"} == {"skipped"}
    assert list(tmp_path.iterdir()) == []


def test_a_build_over_the_limit_is_ended_with_all_that_it_started(tmp_path):
    began = time.monotonic()
    cells = measured(Slow(), tmp_path, Limits(cell=0.3, repeats=1))
    assert time.monotonic() - began < 20
    assert cells["cold"].state == "slow"
    assert "> 0 s" in table.cells(list(cells.values()), 0.3)


@pytest.mark.slow
def test_a_program_that_is_ended_leaves_nothing_and_says_what_it_has(tmp_path):
    words = [
        sys.executable,
        "-m",
        "tests.benchmarks.engine",
        "--tools",
        "make",
        "--sizes",
        "20",
        "--shapes",
        "wide,chain",
    ]
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "cwd": REPO}
    program = subprocess.Popen([*words, "--repeats", "1000000", "--budget", "1", "--work", str(tmp_path)], **options)
    assert program.stderr.readline().startswith("wide 20 make cold: ")
    program.terminate()
    out, _ = program.communicate(timeout=60)
    assert program.returncode == 143
    assert "### wide, 20 nodes" in out
    assert "; broken off: " in out
    assert list(tmp_path.iterdir()) == []


@pytest.mark.medium
def test_cost_is_that_of_the_command(tmp_path):
    words = "import time; b = b'x' * 80_000_000; time.sleep(0.2); sum(range(3_000_000))"
    large = measure.cost([sys.executable, "-c", words], tmp_path, 60)
    small = measure.cost(["true"], tmp_path, 60)
    assert large.seconds > 0.2 + large.cpu / 4
    assert large.cpu > small.cpu
    assert large.rss_mib > 75 > small.rss_mib
    assert measure.cost(["sh", "-c", "echo no >&2; exit 3"], tmp_path, 60).why == "exit code 3: no"
    assert measure.cost(["sh", "-c", "kill -SEGV $$"], tmp_path, 60).why == "ended by SIGSEGV"
    assert measure.cost(["sleep", "60"], tmp_path, 0.1).why == "took too long"
    with pytest.raises(RuntimeError, match="`no-such-tool` cannot be started"):
        measure.cost(["no-such-tool"], tmp_path, 60)


def test_an_absent_tool_is_left_out_by_name(monkeypatch):
    class Absent(Make):
        def words(self) -> list[str]:
            return ["no-such-tool"]

    assert Absent().version() == ""
    text = table.header(
        {"memory": "1 GiB"}, {"make": "", "ninja": "1.11"}, {"make": Make(), "ninja": TOOLS["ninja"]}, "x"
    )
    assert "Absent, so left out: make." in text
    assert "| ninja | 1.11 |" in text


def test_the_tables_go_between_the_marks_of_a_page(tmp_path):
    file = tmp_path / "page.md"
    file.write_text(f"# Before\n\n{page.BEGIN}\nold\n{page.END}\n\nafter\n")
    page.insert(file, "new\n")
    page.insert(file, "newer\n")
    assert file.read_text() == f"# Before\n\n{page.BEGIN}\n\nnewer\n\n{page.END}\n\nafter\n"
    file.write_text("no marks\n")
    with pytest.raises(SystemExit, match="has no lines"):
        page.insert(file, "new\n")


@pytest.mark.parametrize(("seconds", "text"), [(0.0841, "84 ms"), (1.384, "1.38 s"), (97.2, "97 s")])
def test_durations(seconds, text):
    assert table.duration(seconds) == text


def test_a_table_of_a_run_that_was_broken_off():
    of_make = [Cell("make", "wide", 3, phase, "ok", 1.5, 1.0, 5.0, 3) for phase in ("cold", "leaf")]
    lines = table.cells([*of_make, Cell("dxb", "wide", 3, "cold", "ok", 0.2, 0.1, 7.0, 3)], 120, cpu=True).splitlines()
    assert "| make | 1.50 s (1.00 s) | 1.50 s (1.00 s) | 5 | 3 |" in lines
    assert "| dxb | 200 ms (100 ms) | - | 7 | - |" in lines


@pytest.mark.parametrize(("value", "text"), [(0.2871, "0.29"), (63.2, "63"), (4237.3, "4,237")])
def test_numbers(value, text):
    assert table.number(value) == text


def test_rows_take_what_was_measured_before(tmp_path):
    known = Cell("make", "wide", 3, "cold", "ok", 1.5, 1.0, 5.0, 3)
    bench = Bench({"make": Make()}, tmp_path, QUICK, [known])
    assert bench.cell(Make(), "wide", 3, "cold") is known
    assert bench.cell(Make(), "wide", 2, "cold").state == "ok"
    assert "| a | make | - | s | took too long |" in table.extras([Row("a", "make", None, "s", "took too long")])


@pytest.mark.parametrize(
    ("words", "text"),
    [(("--tools", "dxb,gulp"), "`gulp` is not one of dxb, ninja"), (("--phases", "warm"), "`warm` is not one of cold")],
)
def test_words_that_are_not_known(words, text):
    done = run(*words)
    assert done.returncode == 2
    assert text in done.stderr


@pytest.mark.slow
def test_a_large_folder_comes_back_whole(tmp_path, monkeypatch):
    monkeypatch.setattr(folder, "FILES", 50)
    monkeypatch.setattr(folder, "PER_FOLDER", 20)
    rows = list(folder.large_folder(Bench({"dxb": TOOLS["dxb"]}, tmp_path, QUICK)))
    assert [row.tool for row in rows] == ["sha256sum", "cp -r", "dxb", "dxb", "dxb"]
    assert all(row.value is not None and row.value > 0 and "wrong" not in row.note for row in rows), rows
    assert list(tmp_path.iterdir()) == []


@pytest.mark.medium
def test_rows_that_are_phases_of_graphs(tmp_path, monkeypatch):
    for name in ("RESTORED", "NODES", "LONG"):
        monkeypatch.setattr(graphs, name, 20)
    bench = Bench({"make": Make(), "ninja": Broken()}, tmp_path, QUICK)
    rows = [row for extra in (graphs.restore, graphs.pool, graphs.long_chain, graphs.memory) for row in extra(bench)]
    assert [(row.tool, row.unit) for row in rows if row.value is not None] == [("make", "s"), *[("make", "MiB")] * 3]
    assert [row.tool for row in rows if row.value is None] == ["ninja"] * 6
    assert all("nothing-of-this-name" in row.note for row in rows if row.value is None)
