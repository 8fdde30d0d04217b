"""A program that code without a context keeps: it answers, refuses, and ends with all that it started."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from dextera_build.errors import MachineError, RuleError
from dextera_build.rule.standing import StandingProgram
from tests.rules.learn import stand_in

SCRIPT = """
import os
import dxb_backend
import numpy as np

CALLS = []

def add(request):
    CALLS.append(1)
    if request.inputs["more"] < 0:
        raise dxb_backend.Refused("it is negative", "add something")
    path = request.file("sum.npy")
    seen = request.inputs["observation"]["joints"]
    np.save(path, np.load(seen.path) + request.inputs["more"] + 100 * len(CALLS))
    return dxb_backend.value("array", file=path)

def pid(request):
    return os.getpid()

if __name__ == "__main__":
    dxb_backend.serve(add=add, pid=pid)
"""


def test_it_remembers_answers_refuses_and_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    inner = tmp_path / "project" / "inner"
    inner.mkdir(parents=True)
    monkeypatch.chdir(inner)  # of the project whose environment it is
    with pytest.raises(MachineError, match=r"\.envs/adder"):
        StandingProgram("an adder", script, ".envs/adder", "envs/adder.lock")
    stand_in.environment(tmp_path / "project", "adder", {})
    program = StandingProgram("an adder", script, ".envs/adder", "envs/adder.lock")
    try:
        joints = {"joints": np.arange(3.0)}
        for call in (1, 2):
            found = program.ask("add", np.ndarray, observation=joints, more=0.5)
            np.testing.assert_array_equal(found, np.arange(3.0) + 0.5 + 100 * call)
        with pytest.raises(RuleError, match="it is negative") as caught:
            program.ask("add", np.ndarray, observation=joints, more=-1)
        assert (caught.value.code, caught.value.hint) == ("DXB-B378", "add something")
        number = program.ask("pid", int)
        assert Path(f"/proc/{number}").exists()
    finally:
        program.end()
    with pytest.raises(ProcessLookupError):
        os.kill(number, 0)
