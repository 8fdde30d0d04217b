"""Programs in builds: what is missing is told at plan time, files are part of keys, and nothing outlives the build."""

from __future__ import annotations

import os
import py_compile
import signal
import time
from pathlib import Path

import pytest

from dextera_build.errors import MachineError, RecipeError, RuleError
from dextera_build.outside import environments
from dextera_build.outside.program import Program
from dextera_build.outside.program_side import dxb_backend
from dextera_build.outside.running import Limits
from tests.e2e.space import Space
from tests.outside.conftest import ECHO, alive

RECIPE = "nodes: {photo: {rule: toy.grey}, out: {rule: toy.tint, image: $photo}}\ntargets: {default: [out]}\n"
GREY = '''
"""toy.grey: a picture."""
import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.rule import Context, rule


@rule(version=1, packages=("numpy",))
def grey(ctx: Context) -> Image:
    """Return a grey picture."""
    return Image(pixels=np.full((4, 4, 3), 99, np.uint8))
'''


@pytest.fixture
def space(toy):
    made = Space(toy.root)
    made.write("dxb.toml", 'cache = "cache"\n')
    made.write("rules/toy/grey.py", GREY.lstrip())
    made.write("recipes/say/tint.yaml", RECIPE)
    toy.program(ECHO)
    return made


@pytest.mark.medium
def test_a_build_logs_the_program_and_follows_its_files(space, toy):
    built = space.dxb("build", "say/tint")
    assert built.code == 0, built.err
    assert "looking at image.png" in space.dxb("log", "say/tint", "out").out
    again = space.dxb("build", "say/tint")
    assert "0 ran" in again.err or "up to date" in again.err, again.err
    toy.program(ECHO.replace("looking", "staring"))
    why = space.dxb("why", "say/tint:out").out
    assert "rules/toy/tint.program.py" in why
    assert space.dxb("build", "say/tint").code == 0
    assert "staring at" in space.dxb("log", "say/tint", "out").out


@pytest.mark.medium
def test_a_module_that_a_program_imports_is_part_of_it_though_nobody_declared_it(space, toy):
    toy.program("from tint_helper import WORD\n" + ECHO.replace('"looking', 'WORD, "looking'))
    space.write("rules/toy/tint_helper.py", "WORD = 'now'\n")
    assert space.dxb("build", "say/tint").code == 0
    space.write("rules/toy/tint_helper.py", "WORD = 'later'\n")
    assert "rules/toy/tint_helper.py" in space.dxb("why", "say/tint:out").out
    assert space.dxb("build", "say/tint").code == 0
    assert "later looking" in space.dxb("log", "say/tint", "out").out


@pytest.mark.slow
def test_byte_code_of_the_same_size_and_time_is_no_part_of_a_program(space, toy, monkeypatch):
    monkeypatch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
    toy.program("from tint_helper import WORD\n" + ECHO.replace('"looking', 'WORD, "looking'))
    helper = space.write("rules/toy/tint_helper.py", "WORD = 'old'\n")
    py_compile.compile(str(helper))
    before = helper.stat().st_mtime_ns
    helper.write_text("WORD = 'new'\n")
    os.utime(helper, ns=(before, before))
    assert space.dxb("build", "say/tint").code == 0
    assert "new looking" in space.dxb("log", "say/tint", "out").out


def test_an_error_shows_what_the_program_printed_last(space, toy):
    toy.program(ECHO.replace("    request.say", "    raise OSError('no camera')\n    request.say"))
    failed = space.dxb("build", "say/tint")
    assert failed.code == 1
    assert "OSError: no camera" in failed.err


@pytest.mark.medium
def test_a_declared_copy_of_the_programs_side_is_the_one_that_counts(space, toy):
    toy.program(ECHO, files=("dxb_backend.py",))
    assert "the file `dxb_backend.py` of the program" in space.dxb("build", "say/tint").err
    space.write("rules/toy/dxb_backend.py", Path(dxb_backend.__file__).read_text() + "\nprint('a copy')\n")
    assert space.dxb("build", "say/tint").code == 0
    assert "a copy" in space.dxb("log", "say/tint", "out").out
    space.edit("rules/toy/dxb_backend.py", "a copy", "another copy")
    assert "rules/toy/dxb_backend.py" in space.dxb("why", "say/tint:out").out


def test_what_is_missing_is_told_with_the_next_step(space, toy):
    toy.program(ECHO, environment="venv:.envs/tint", lock="envs/tint.lock", files=("model/*.py",))
    planned = space.dxb("plan", "say/tint")
    assert "out\tmissing\ttoy.tint\tprogram" in planned.out
    refused = space.dxb("build", "say/tint")
    assert refused.code == 4
    for word in (
        "the virtual environment `.envs/tint`",
        "the lock file `envs/tint.lock`",
        "the file `model/*.py` of the program",
        "`python -m venv .envs/tint`, install the program's packages with `.envs/tint/bin/pip`",
        "`mkdir -p envs && .envs/tint/bin/pip freeze --all > envs/tint.lock`",
    ):
        assert word in refused.err


def test_an_environment_with_a_lock_file_is_made_from_it(space, toy):
    space.write("envs/tint.lock", "")
    toy.program(ECHO, environment="venv:.envs/tint", lock="envs/tint.lock")
    refused = space.dxb("build", "say/tint")
    assert "hint: `python -m venv .envs/tint && .envs/tint/bin/pip install -r envs/tint.lock`\n" in refused.err


@pytest.mark.medium
def test_a_virtual_environment_is_used_and_its_lock_file_enters_the_key(space, toy, capfd):
    python = toy.root / ".envs" / "tint" / "bin" / "python"
    python.parent.mkdir(parents=True)
    python.write_text(f'#!/bin/sh\necho "in the environment"\nexec {os.path.realpath("/proc/self/exe")} "$@"\n')
    python.chmod(0o755)
    space.write("envs/tint.lock", "numpy==2.0.0\n")
    toy.run(environment="venv:.envs/tint", lock="envs/tint.lock")
    assert "in the environment" in capfd.readouterr().out
    assert space.dxb("build", "say/tint").code == 0
    space.edit("envs/tint.lock", "2.0.0", "2.0.1")
    assert "envs/tint.lock" in space.dxb("why", "say/tint:out").out


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ({"environment": "poetry:x"}, "is none of"),
        ({"environment": "docker:image:latest"}, "with its digest"),
        ({"environment": "venv:.envs/x"}, "without its lock file"),
        ({"files": ("../other.py",)}, "leads out of the folder"),
        ({"files": ("/etc/passwd",)}, "leads out of the folder"),
    ],
)
def test_a_wrong_declaration_is_told(toy, words, why):
    with pytest.raises(RecipeError, match=why) as caught:
        toy.run(**words)
    assert caught.value.code == "DXB-R260"
    assert "BACKEND" in str(caught.value.hint)


def test_a_program_that_is_edited_while_it_runs_is_refused(toy):
    text = ECHO.replace("    return", "    open(__file__, 'a').write('# edited')\n    return")
    with pytest.raises(RuleError, match="it was edited while the build ran") as caught:
        toy.run(text)
    assert (caught.value.code, caught.value.facts["files"]) == ("DXB-B379", "rules/toy/tint.program.py")


def test_what_vanishes_after_planning_is_told_by_the_worker(toy):
    toy.program(ECHO)
    program = toy.runner().find("toy.tint").backends["program"].program
    (toy.folder / "tint.program.py").unlink()
    with pytest.raises(MachineError, match=r"needs the file `tint.program.py` of the program") as caught:
        program.check({})
    assert caught.value.code == "DXB-E392"


WAITING = ECHO.replace("    return", "    import time; time.sleep(60)\n    return")


@pytest.mark.medium
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL], ids=["ctrl-c", "kill"])
def test_the_program_ends_with_the_build(space, toy, tmp_path, number, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    toy.program(WAITING)
    build = space.start("build", "say/tint")
    _wait(lambda: any("tint.program.py" in line for line in alive(tmp_path, 0)))
    build.send_signal(number)
    build.wait(30)
    build.communicate()
    assert alive(tmp_path, 15) == []
    _wait(lambda: not list((tmp_path / "tmp").glob("dxb-outside-*")))
    for left in (tmp_path / "tmp").iterdir():  # of a worker that was killed: an empty folder
        left.rmdir()


@pytest.mark.slow
def test_the_program_ends_when_its_worker_is_killed(space, toy, tmp_path, monkeypatch):
    monkeypatch.setenv("TMPDIR", str(tmp_path / "tmp"))
    toy.program(WAITING)
    build = space.start("build", "say/tint")
    _wait(lambda: any("tint.program.py" in line for line in alive(tmp_path, 0)))
    worker = next(pid for pid in _pids(tmp_path) if b"dextera_build.workers.worker" in _command(pid))
    os.kill(worker, signal.SIGKILL)
    _, err = build.communicate(timeout=60)
    assert "error[DXB-B301]: " in err
    assert err.count("error[") == 1
    assert alive(tmp_path, 15) == []


def _wait(holds, limit_s: float = 60.0) -> None:
    deadline = time.monotonic() + limit_s
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def _command(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def _pids(mark: object) -> list[int]:
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                if f"TOY_MARK={mark}".encode() in (folder / "environ").read_bytes():
                    found.append(int(folder.name))
            except OSError:
                continue
    return found


def test_a_container_sees_the_exchange_its_program_and_its_weights_and_no_network(tmp_path):
    place = environments.named("podman:lab/tint@sha256:abc", tmp_path)
    root = tmp_path / "dxb-outside-x_y"
    words = place.argv(
        environments.Start(
            ("{python}", "infer.py"), tmp_path / "here", root, tmp_path / "side", (tmp_path / "weights",), True, 4.0
        )
    )
    text = " ".join(words)
    assert words[:2] == ["podman", "run"]
    assert "--network none" in text
    assert f"--volume {root}:{root} " in text
    assert f"--volume {tmp_path}/weights:{tmp_path}/weights:ro" in text
    assert f"--env PYTHONPATH={tmp_path}/side " in text
    assert f"--volume {tmp_path}/side:{tmp_path}/side:ro" in text
    assert "--memory 4g" in text
    assert text.endswith("lab/tint@sha256:abc python infer.py")
    assert place.last(root) == ["podman", "rm", "--force", "dxb-outside-x-y"]


def test_conda_is_entered_by_the_tool_that_is_there(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CONDA_EXE", raising=False)
    monkeypatch.setenv("MAMBA_ROOT_PREFIX", str(tmp_path / "mamba"))
    place = environments.named("conda:tint", tmp_path)
    assert "conda or micromamba" in place.lacking("a.lock")
    tool = tmp_path / "micromamba"
    tool.write_text("#!/bin/sh\n")
    tool.chmod(0o755)
    assert place.lacking("a.lock") == {
        "the conda environment `tint`": "`micromamba create -n tint --file a.lock`",
    }
    (tmp_path / "mamba" / "envs" / "tint").mkdir(parents=True)
    assert place.lacking("a.lock") == {}
    start = environments.Start(("{python}", "infer.py"), tmp_path, tmp_path, tmp_path)
    assert place.argv(start) == [str(tool), "run", "-n", "tint", "python", "infer.py"]


def test_a_missing_container_tool_or_image_is_told(tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    place = environments.named("podman:lab/tint@sha256:abc", tmp_path)
    assert place.lacking("") == {"podman": "install podman"}
    tool = tmp_path / "podman"
    tool.write_text("#!/bin/sh\nexit 1\n")
    tool.chmod(0o755)
    assert place.lacking("") == {
        "the image `lab/tint@sha256:abc`": "`podman pull lab/tint@sha256:abc`",
    }


def test_files_of_an_installed_program_have_names_of_their_own(tmp_path):
    for folder in ("net", "data"):
        (tmp_path / "installed" / folder).mkdir(parents=True)
        (tmp_path / "installed" / folder / "load.py").write_text(folder)
    words = ("{python}", "net/load.py")
    file = tmp_path / "installed" / "tint_lab.py"
    program = Program(
        "lab of toy.tint", file, tmp_path / "project", words, ("*/load.py",), "", "", False, Limits(60.0, 0.0, 1.0)
    )
    assert sorted(program.digests()) == ["data/load.py", "dxb_backend.py", "net/load.py"]
