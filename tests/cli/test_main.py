"""The exit codes of commands that are cut short."""

from __future__ import annotations

import pytest

from dextera_build.cli import streams
from dextera_build.cli.main import main
from dextera_build.runs import snapshot


@pytest.mark.parametrize(("interrupt", "code"), [(KeyboardInterrupt, 130), (streams.Terminated, 143)])
def test_an_interrupt_while_a_class_is_made_is_no_internal_error(
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    interrupt: type[KeyboardInterrupt],
    code: int,
) -> None:
    class Interrupting:
        def __set_name__(self, owner: type, name: str) -> None:
            raise interrupt

    def answer(words: list[str]) -> bool:
        class Made:
            """Python 3.11 wraps what is raised here in a RuntimeError."""

            field = Interrupting()

        return Made is None

    monkeypatch.setattr(snapshot, "answer", answer)
    assert main(["build"]) == code
    assert "interrupted; finished results are kept" in capsys.readouterr().err
