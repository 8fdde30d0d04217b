"""Plug-ins of pydantic are found as ever, and what reads them is loaded with the look for them."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

_SAY = """
import sys
import dextera_build.artifacts.base
before = "importlib.metadata" in sys.modules
import importlib.metadata
import pydantic.plugin._loader as loader
plugins = [type(found).__name__ for found in loader.get_plugins()]
print(before, importlib.metadata.version("pydantic") > "2", plugins)
"""

_LISTED = """
class Listed:
    def new_schema_validator(self, *arguments, **more):
        return None, None, None

found = Listed()
"""


@pytest.mark.parametrize(
    ("turned_off", "said"), [("__all__", "False True []"), (None, "True True ['Listed']")], ids=["off", "on"]
)
def test_plug_ins_are_found_where_they_are_not_turned_off(tmp_path: Path, turned_off: str | None, said: str) -> None:
    (tmp_path / "listed.py").write_text(_LISTED)
    info = tmp_path / "listed-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: listed\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[pydantic]\nlisted = listed:found\n")
    env = {name: value for name, value in os.environ.items() if name != "PYDANTIC_DISABLE_PLUGINS"}
    env["PYTHONPATH"] = f"{Path(__file__).parents[2]}:{tmp_path}"
    if turned_off:
        env["PYDANTIC_DISABLE_PLUGINS"] = turned_off
    done = subprocess.run([sys.executable, "-c", _SAY], env=env, capture_output=True, text=True)
    assert done.stdout.strip() == said, done.stderr
