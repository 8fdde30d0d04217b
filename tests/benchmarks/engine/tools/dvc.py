"""DVC."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

from tests.benchmarks.engine.dags import Dag
from tests.benchmarks.engine.tools.tool import PeerTool, shell_step


class Dvc(PeerTool):
    """DVC with its cache and run cache."""

    name = "dvc"
    step = "one `sh`"
    cutoff = True

    def write(self, dag: Dag, folder: Path) -> None:
        stages = {
            node: {"cmd": shell_step(" ".join(ins), str(number), out), "deps": ins, "outs": [out]}
            for number, node, ins, out in dag.steps()
        }
        (folder / "dvc.yaml").write_text(json.dumps({"stages": stages}))
        for words in (["init", "--no-scm", "-q"], ["config", "core.analytics", "false"]):
            subprocess.run([*self.words(), *words], cwd=folder, check=True, capture_output=True)
        subprocess.run([*self.words(), "config", "core.check_update", "false"], cwd=folder, check=True)

    def command(self, folder: Path) -> list[str]:
        return [*self.words(), "repro", "-q"]

    def environment(self, folder: Path) -> dict[str, str]:
        return {"DVC_SITE_CACHE_DIR": f"{folder}.site"}
