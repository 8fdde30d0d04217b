"""Bazel."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import Tool, first_version, shell_step

STEP = """def _step(ctx):
    out = ctx.actions.declare_file(ctx.label.name + ".out")
    paths = " ".join([file.path for file in ctx.files.srcs])
    ctx.actions.run_shell(inputs = ctx.files.srcs, outputs = [out], command = COMMAND)
    return [DefaultInfo(files = depset([out]))]

step = rule(
    implementation = _step,
    attrs = {"srcs": attr.label_list(allow_files = True), "number": attr.int()},
)
"""


class Bazel(Tool):
    """Debian's Bazel with a disk cache."""

    name = "bazel"
    step = "one `bash`, no sandbox"
    cutoff = True
    note = "its server stays up between builds and is started by the cold one; `--disk_cache`, `--spawn_strategy=local`"

    def words(self) -> list[str]:
        return ["bazel", "--host_jvm_args=-Xmx6g"]

    def version(self) -> str:
        found = first_version(["bazel", "--version"])
        if found != "?" or shutil.which("dpkg-query") is None:
            return found
        # Debian's says `no_version`.
        command = ["dpkg-query", "--show", "--showformat", "${Version}", "bazel-bootstrap"]
        return subprocess.run(command, capture_output=True, text=True).stdout.strip() or found

    def write(self, dag: Dag, folder: Path) -> None:
        body = shell_step("PATHS", "NUMBER", "OUT")
        command = f'"{body}"'.replace("PATHS", '" + paths + "').replace("NUMBER", '" + str(ctx.attr.number) + "')
        (folder / "step.bzl").write_text(STEP.replace("COMMAND", command.replace("OUT", '" + out.path + "')))
        lines = ['load(":step.bzl", "step")\n']
        for number, (node, inputs) in enumerate(dag.nodes.items()):
            srcs = ", ".join(f'"leaves/{name}"' if name[0] == "l" else f'":{name}"' for name in inputs)
            lines.append(f'step(name = "{node}", srcs = [{srcs}], number = {number})\n')
        (folder / "BUILD").write_text("".join(lines))
        (folder / "WORKSPACE").write_text("")

    def command(self, folder: Path) -> list[str]:
        flags = ["--noshow_progress", "--show_result=0", "--color=no", "--spawn_strategy=local"]
        return [*self._start(folder), "build", *flags, f"--disk_cache={folder}.disk", "//:all"]

    def _start(self, folder: Path) -> list[str]:
        return [*self.words(), f"--output_user_root={folder}.root", f"--output_base={folder}.root/base"]

    def output(self, folder: Path, node: str) -> Path:
        return folder / "bazel-bin" / f"{node}.out"

    def memory_mib(self, folder: Path) -> float:
        pid = Path(f"{folder}.root/base/server/server.pid.txt")
        status = Path(f"/proc/{pid.read_text().strip()}/status") if pid.exists() else pid
        lines = status.read_text().splitlines() if status.exists() else []
        return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)

    def stop(self, folder: Path) -> None:
        if Path(f"{folder}.root").exists():
            subprocess.run([*self._start(folder), "shutdown"], cwd=folder, capture_output=True)
