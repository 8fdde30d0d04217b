"""Every tool, in the order of the tables."""

from __future__ import annotations

from tests.benchmarks.engine.tools.bazel import Bazel
from tests.benchmarks.engine.tools.doit import Doit
from tests.benchmarks.engine.tools.dvc import Dvc
from tests.benchmarks.engine.tools.dxb import Dxb
from tests.benchmarks.engine.tools.make import Make
from tests.benchmarks.engine.tools.ninja import Ninja
from tests.benchmarks.engine.tools.redun import Redun
from tests.benchmarks.engine.tools.scons import SCons
from tests.benchmarks.engine.tools.snakemake import Snakemake
from tests.benchmarks.engine.tools.tool import Tool
from tests.benchmarks.engine.tools.tup import Tup

_TOOLS = (Dxb, Ninja, Make, Tup, Doit, SCons, Bazel, Snakemake, Dvc, Redun)
TOOLS: dict[str, Tool] = {kind.name: kind() for kind in _TOOLS}
