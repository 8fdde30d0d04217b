"""A program is asked, its output passes on, and it ends with its call."""

from __future__ import annotations

import numpy as np
import pytest

from dextera_build.errors import MachineError, RuleError
from dextera_build.outside.program import SIDE
from dextera_build.rule import Context
from tests.outside.conftest import ECHO


def test_a_program_answers_with_files_of_the_field(toy, capfd):
    assert np.array_equal(toy.run().pixels, toy.image.pixels)
    assert "looking at image.png" in capfd.readouterr().out


def test_its_line_and_metrics_are_those_of_the_result(toy):
    toy.program(ECHO)
    runner = toy.runner()
    runner.run("toy.tint", image=toy.image)
    assert runner.outcome.line == "tinted"
    assert runner.outcome.metrics == {"gain": (2.0, "")}


def test_it_sees_options_seed_and_plain_inputs(toy, capfd):
    toy.run(ECHO.replace('print("looking', 'print(request.options, request.seed, request.inputs["words"]); print("'))
    out = capfd.readouterr().out
    assert "{'gain': 2.0, 'seed': 7} 7 ['a', " in out


def test_it_refuses_with_a_message_and_a_hint(toy):
    with pytest.raises(RuleError, match="too dark") as caught:
        toy.run(ECHO.replace("    return", '    raise dxb_backend.Refused("too dark", "take a lamp")\n    return'))
    assert (caught.value.code, caught.value.hint) == ("DXB-B378", "take a lamp")


def test_a_function_that_it_does_not_have_is_a_refusal(toy):
    with pytest.raises(RuleError, match="the program has no function `tint`"):
        toy.run(ECHO.replace("serve(tint=", "serve(paint="))


def test_it_does_not_inherit_the_module_search_path(toy, monkeypatch, capfd):
    monkeypatch.setenv("PYTHONPATH", "/somewhere")
    toy.run(ECHO.replace('print("looking', 'import os; print("path", os.environ.get("PYTHONPATH")); print("'))
    assert f"path {SIDE.parent}\n" in capfd.readouterr().out


def test_its_temporary_files_vanish(toy, capfd):
    toy.run(ECHO.replace("    return", "    import tempfile; print(tempfile.mkdtemp())\n    return"))
    assert f"{toy.root.parent}/tmp/dxb-outside-" in capfd.readouterr().out  # the fixture finds it gone


def test_a_command_that_does_not_exist_is_told(toy):
    with pytest.raises(MachineError, match="the program cannot be started: No such file") as caught:
        toy.run(command=("no-such-command",))
    assert caught.value.code == "DXB-E390"


def test_a_backend_without_a_program_cannot_ask(tmp_path):
    with pytest.raises(RuleError, match="declares no program") as caught:
        Context(scratch=tmp_path).outside("tint", str, word="a")
    assert caught.value.code == "DXB-B380"
    assert "command=" in str(caught.value.hint)
