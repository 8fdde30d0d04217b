"""Robots of others, read by `dxb new robot`: whether they push and lift a cube in a twin, or a line that says why not.

`python -m tests.benchmarks.robots_at_work FOLDER --descriptions UNZIPPED --packages SITE [NAME ...]`. FOLDER keeps the
store, a project for each robot and a row for each robot; a robot with a row is left alone, so that a run goes on where
the last one ended. `--again` does the named robots again, `--table` prints the rows.
"""

from __future__ import annotations

import argparse
import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.benchmarks.robot_files import ROBOTS, Robot

DXB = str(Path(sys.executable).parent / "dxb")
TWIN, THING = "twin/box_table", "blue_cube"
TASKS = ("push", "lift")
LIMIT_S = 1800
_ERROR = re.compile(r"^error(?:\[DXB-[A-Z]\d+\])?: (?:(\S+) failed: )?(.*)$")
_FACT = re.compile(r"^ {3}(\S.*?) {2,}(\S.*)$")
_FILE = re.compile(r"^ {3}= (.*)$")


def dxb(project: Path, *words: str) -> tuple[int, str]:
    """Exit status, and what was written to both streams."""
    try:
        done = subprocess.run([DXB, *words], cwd=project, capture_output=True, text=True, timeout=LIMIT_S, check=False)
    except subprocess.TimeoutExpired:
        return 124, f"error: not done after {LIMIT_S} s\n"
    return done.returncode, done.stdout + done.stderr


def errors(output: str) -> Iterator[tuple[str, str]]:
    """Node, empty if there is none, and the message of each error with its facts in one line."""
    node, message, facts = "", "", list[str]()
    for line in output.splitlines():
        if (found := _ERROR.match(line)) is not None:
            if message:
                yield node, "; ".join([message, *facts])
            node, message, facts = found.group(1) or "", found.group(2), []
        elif message and (fact := _FACT.match(line)) is not None and fact.group(1) not in ("rule", "log", "first"):
            facts.append(f"{fact.group(1)}: {fact.group(2)}")
    if message:
        yield node, "; ".join([message, *facts])


def reason(output: str) -> str:
    """The first error, or the whole output if it has none."""
    return next((message for _, message in errors(output)), output.strip()[-300:])


def measured(place: Path, robot: Robot, files: list[Path]) -> dict[str, Any]:
    """The row of one robot, from a fresh project."""
    project = place / "projects" / robot.name
    shutil.rmtree(project, ignore_errors=True)
    project.mkdir(parents=True)
    (project / "dxb.toml").write_text('cache = "../../store"\n')
    row: dict[str, Any] = {"name": robot.name, "source": robot.source, "file": robot.path, "built": False}
    recipe = f"recipes/robot/{robot.name}.yaml"
    code, said = dxb(project, "new", "robot", *map(str, files), "--repair-inertias", "-o", recipe)
    row["guesses"] = [line.strip() for line in said.splitlines() if " = " in line or "gripper of" in line]
    if code:
        return row | {"why": reason(said)}
    code, said = dxb(project, "build", f"robot/{robot.name}", "--console", "plain")
    if code:
        return row | {"why": reason(said)}
    row["built"] = True
    code, said = dxb(project, "new", "task", TWIN, f"robot/{robot.name}", "-o", "recipes/task/work.yaml")
    if code:
        return row | {"why": reason(said)}
    written = (project / "recipes/task/work.yaml").read_text()
    row["base"] = re.findall(r"position_m: (\[.*?\])", written)[:1]
    nodes = {task: f"{task}_{THING}_shown" for task in TASKS if f"  {task}_{THING}_shown:" in written}
    targets = [f"task/work:{node}" for node in nodes.values()]
    _, said = dxb(project, "build", "-k", "-j", "1", *targets, "--console", "plain")
    (project / "build.txt").write_text(said)
    failed = dict(errors(said))
    for task, node in nodes.items():
        own = [message for key, message in failed.items() if key in (node, node.removesuffix("_shown"))]
        done = re.search(rf"^ *[+=.] *{node} .*$", said, re.MULTILINE)
        row[task] = not own and done is not None
        if not row[task]:
            row[f"{task}_why"] = own[0] if own else reason(said)
    return row


def table(rows: list[dict[str, Any]]) -> Iterator[str]:
    """The rows in Markdown, and their sums."""
    yield "| source | file | builds | pushes | lifts | why not |"
    yield "| --- | --- | --- | --- | --- | --- |"
    for row in rows:
        marks = [
            "yes" if row["built"] else "-",
            *("yes" if row.get(task) else "no" if task in row else "-" for task in TASKS),
        ]
        whys = [row["why"]] if "why" in row else []
        whys += [f"{task}: {row[f'{task}_why']}" for task in TASKS if f"{task}_why" in row]
        yield "| " + " | ".join([row["source"], f"`{row['file']}`", *marks, ". ".join(whys) or "-"]) + " |"
    built = [row for row in rows if row["built"]]
    works = [row for row in built if any(row.get(task) for task in TASKS)]
    told = {task: sum(bool(row.get(task)) for row in rows) for task in TASKS}
    yield ""
    yield f"{len(rows)} robots: {len(built)} built, {len(works)} of them push or lift {told}"


def main() -> None:
    """Measure the robots that have no row."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--descriptions", type=Path, required=True, help="example-robot-data, unzipped")
    parser.add_argument("--packages", type=Path, required=True, help="where the other distributions are installed")
    parser.add_argument("--again", action="store_true")
    parser.add_argument("--table", action="store_true")
    args = parser.parse_intermixed_args()
    rows = args.folder / "rows"
    rows.mkdir(parents=True, exist_ok=True)
    chosen = [robot for robot in ROBOTS if not args.names or robot.name in args.names]
    for robot in () if args.table else chosen:
        out = rows / f"{robot.name}.json"
        if out.exists() and not args.again:
            continue
        row = measured(args.folder.resolve(), robot, robot.files(args.descriptions, args.packages))
        out.write_text(json.dumps(row, indent=1))
        print(json.dumps(row), flush=True)
    known = [json.loads(file.read_text()) for robot in chosen if (file := rows / f"{robot.name}.json").exists()]
    print("\n".join(table(known)))


if __name__ == "__main__":
    main()
