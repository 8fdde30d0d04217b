"""What programs do wrong: each ends in one error with a code and a next step, and leaves no process and no file."""

from __future__ import annotations

import os
import textwrap
import time
from typing import Any

import numpy as np
import pytest

from dextera_build.errors import MachineError, RuleError

ANSWER = """
def answer(output=None, **other):
    import json, pathlib, sys
    folder = pathlib.Path(sys.argv[-1]) / "response"
    message = {"protocol": 1, "status": "ok", "output": output, **other}
    (folder / "response.json").write_text(json.dumps(message))
    return folder

import os, signal, subprocess, sys, time
"""
"""A program without the helper."""
QUICK = {"timeout_s": 0.7}
HANG = "time.sleep(600)"
DAEMON = """
if os.fork() == 0:
    os.setsid()
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    if os.fork() == 0:
        os.closerange(0, 64)
        time.sleep(600)
    os._exit(0)
"""
DEAF = "for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP): signal.signal(number, signal.SIG_IGN)\n"
FORKS = """
for _ in range(30):
    if os.fork() == 0:
        os.setpgid(0, 0)
        while True:
            if os.fork() == 0:
                os.setsid()
                time.sleep(600)
            time.sleep(0.02)
"""
MESH = '{"type": "Mesh", "fields": {"vertices": {"type": "array", "file": "v.npy"}, "faces": %s}}'

CASES: dict[str, tuple[str, str, str, dict[str, Any]]] = {
    # name: program, code, message, literals of BACKEND
    "raises": ("raise ValueError('by hand')", "DXB-B370", r"exit code 1", {}),
    "exits": ("sys.exit(3)", "DXB-B370", r"exit code 3", {}),
    "kill -9": ("os.kill(os.getpid(), 9)", "DXB-B370", r"signal 9 \(SIGKILL\)", {}),
    "segmentation fault": ("import ctypes; ctypes.string_at(0)", "DXB-B370", r"signal 11 \(SIGSEGV\)", {}),
    "abort": ("os.abort()", "DXB-B370", r"signal 6 \(SIGABRT\)", {}),
    "hangs": (HANG, "DXB-B371", "longer than 0.7 s", QUICK),
    "hangs and is deaf": (DEAF + HANG, "DXB-B371", "longer than 0.7 s", QUICK),
    "spins": ("while True: pass", "DXB-B371", "longer than 0.7 s", QUICK),
    "answers, then hangs": ("answer(1); " + HANG, "DXB-B371", "longer than 0.7 s", QUICK),
    "stops itself": ("os.kill(os.getpid(), signal.SIGSTOP)", "DXB-B371", "longer than 0.7 s", QUICK),
    "forks on and on": (FORKS + HANG, "DXB-B371", "longer than 0.7 s", QUICK),
    "a child hangs": ("subprocess.run(['sleep', '600'])", "DXB-B371", "longer than 0.7 s", QUICK),
    "a daemon": (DAEMON + "answer(1)", "DXB-B377", "left 1 process running", {}),
    "a daemon and a crash": (DAEMON + "sys.exit(1)", "DXB-B370", "exit code 1", {}),
    "a deaf child": (DEAF + "answer(1); subprocess.Popen(['sleep', '600'])", "DXB-B377", "left 1 process", {}),
    "fills memory": ("held = bytearray(2 << 30); " + HANG, "DXB-B372", "more than 0.2 GiB", {"memory_gb": 0.2}),
    "children fill memory": (
        "[subprocess.Popen([sys.executable, '-c', 'x = b\"1\" * (150 << 20); import time; time.sleep(600)'])"
        f" for _ in range(3)]; {HANG}",
        "DXB-B372",
        "more than 0.3 GiB",
        {"memory_gb": 0.3},
    ),
    "fills the response": (
        "for n in range(9999):\n    (answer(1) / str(n)).write_bytes(bytes(1 << 20))\n    time.sleep(0.002)",
        "DXB-B373",
        "more than 0.05 GiB",
        {"disk_gb": 0.05},
    ),
    "files without a name": (
        "import tempfile\nfiles = []\nfor n in range(9999):\n    files.append(tempfile.TemporaryFile())\n"
        "    files[-1].write(bytes(1 << 20))\n    time.sleep(0.002)",
        "DXB-B373",
        "more than 0.05 GiB",
        {"disk_gb": 0.05},
    ),
    "one large file without a name": (
        "import tempfile\nfile = tempfile.TemporaryFile()\nwhile True:\n    file.write(bytes(1 << 20))",
        "DXB-B370",
        "exit code 1",
        {"disk_gb": 0.05},
    ),
    "one large file": (
        "with open(os.environ['TMPDIR'] + '/big', 'wb') as file:\n    while True: file.write(bytes(1 << 20))",
        "DXB-B373",
        "more than 0.05 GiB",
        {"disk_gb": 0.05},
    ),
    "no answer": ("pass", "DXB-B374", "without an answer", {}),
    "not JSON": ("(answer() / 'response.json').write_bytes(b'\\xff\\x00{')", "DXB-B375", "no response", {}),
    "another schema": ("answer(1, extra=2)", "DXB-B375", "no response of protocol 1", {}),
    "another protocol": ("answer(1, protocol=2)", "DXB-B375", "no response of protocol 1", {}),
    "a number for an image": ("answer(1)", "DXB-B376", "cannot be used", {}),
    "a missing file": ("answer({'type': 'Image', 'file': 'no.png'})", "DXB-B376", "there is no such file", {}),
    "a path outside": ("answer({'type': 'Image', 'file': '../request/image.png'})", "DXB-B376", "cannot be used", {}),
    "an absolute path": ("answer({'type': 'Image', 'file': '/etc/passwd'})", "DXB-B376", "cannot be used", {}),
    "a link outside": (
        "os.symlink('/etc/passwd', answer({'type': 'Image', 'file': 'a.png'}) / 'a.png')",
        "DXB-B376",
        "a link leads out",
        {},
    ),
    "a linked folder": (
        "os.symlink('/etc', answer({'type': 'Image', 'file': 'a/passwd'}) / 'a')",
        "DXB-B376",
        "a link leads out",
        {},
    ),
    "a pipe": (
        "os.mkfifo(answer({'type': 'Image', 'file': 'a.png'}) / 'a.png')",
        "DXB-B376",
        "no plain file",
        {},
    ),
    "a damaged picture": (
        "(answer({'type': 'Image', 'file': 'a.png'}) / 'a.png').write_bytes(b'\\x89PNG')",
        "DXB-B376",
        "cannot be read as a picture",
        {},
    ),
    "a mesh of NaN": (
        "import shutil\nf = answer({'type': 'Mesh', 'fields': {'vertices': {'type': 'array', 'file': 'v.npy'},"
        " 'faces': {'type': 'array', 'file': 'f.npy'}}})\n"
        "shutil.copy(os.environ['TOY_NAN'], f / 'v.npy'); shutil.copy(os.environ['TOY_FACES'], f / 'f.npy')",
        "DXB-B376",
        "9 of 9 numbers are not finite",
        {},
    ),
    "an unreadable folder": (
        "os.chmod(answer({'type': 'Image', 'file': 'a.png'}), 0o500); os.mkdir(os.environ['TMPDIR'] + '/a', 0o000)",
        "DXB-B376",
        "there is no such file",
        {},
    ),
}


@pytest.fixture
def arrays(tmp_path, monkeypatch):
    np.save(tmp_path / "nan.npy", np.full((3, 3), np.nan, np.float32))
    np.save(tmp_path / "faces.npy", np.array([[0, 1, 2]], np.int32))
    monkeypatch.setenv("TOY_NAN", str(tmp_path / "nan.npy"))
    monkeypatch.setenv("TOY_FACES", str(tmp_path / "faces.npy"))


@pytest.mark.medium
@pytest.mark.parametrize("case", CASES)
def test_it_is_one_error_with_a_next_step_and_nothing_is_left(toy, arrays, case):
    """The fixture `toy` looks for processes and files afterwards."""
    program, code, message, words = CASES[case]
    began = time.monotonic()
    with pytest.raises(RuleError, match=message) as caught:
        toy.run(ANSWER + textwrap.dedent(program), **words)
    assert caught.value.code == code
    assert caught.value.hint
    assert time.monotonic() - began < 30


@pytest.mark.parametrize("then", ["answer(1)", HANG, "os.setsid(); time.sleep(600)"])
def test_a_program_that_kills_its_guard_dies_too(toy, then):
    with pytest.raises(MachineError, match="the process that watches a program was killed") as caught:
        toy.run(ANSWER + DAEMON + "os.kill(os.getppid(), 9)\n" + then)
    assert caught.value.code == "DXB-E391"
    assert caught.value.hint


def test_the_error_shows_the_end_of_the_log(toy):
    with pytest.raises(RuleError) as caught:
        toy.run("for n in range(100): print('line', n)\nraise ValueError('by hand')")
    lines = caught.value.facts["printed"].splitlines()
    assert len(lines) <= 4
    assert lines[-1] == "ValueError: by hand"


FLOOD = """
import os
for count in range(3000):
    os.write(1, b"%07d " % count + b"x" * 9991 + b"\\n")
raise ValueError("after the flood")
"""


def test_a_flood_of_output_is_kept_up_to_a_bound_and_the_rest_counted(toy, capfd):
    with pytest.raises(RuleError) as caught:
        toy.run(FLOOD)
    out = capfd.readouterr().out
    assert len(out) < (2 << 20)
    assert out.startswith("0000000 x")
    assert "bytes of output left out]" in out
    assert "ValueError: after the flood" in out
    left_out = int(caught.value.facts["output"].split()[0].replace(",", ""))
    assert len(out) + left_out == pytest.approx(3000 * 10_000, rel=0.01)


@pytest.mark.medium
def test_a_line_without_an_end_fills_no_memory(toy, capfd):
    with pytest.raises(RuleError, match="longer than"):
        toy.run("import os\nwhile True: os.write(1, b'x' * 65536)", timeout_s=1.5)
    assert len(capfd.readouterr().out) < (2 << 20)


def test_bytes_that_are_no_text_are_shown(toy, capfd):
    with pytest.raises(RuleError, match="without an answer"):
        toy.run("import os; os.write(1, b'\\xff\\xfe\\n@dxb {broken\\n@dxb [1]\\n@dxb {\"progress\": 1}\\n')")
    assert "\ufffd\ufffd\n@dxb {broken" in capfd.readouterr().out


@pytest.mark.slow
def test_ten_gigabytes_are_stopped_at_the_usual_limit(toy):
    """`disk_gb` as declared; the disk of the test needs as much space."""
    free = os.statvfs(toy.root)
    if free.f_bavail * free.f_frsize < 12 << 30:
        pytest.skip("less than 12 GiB of disk space")
    name = "os.environ['TMPDIR'] + '/%d' % n"
    write = f"with open({name}, 'wb') as file:\n        for _ in range(1024): file.write(bytes(1 << 20))"
    with pytest.raises(RuleError, match="more than 8 GiB") as caught:
        toy.run(ANSWER + f"for n in range(10):\n    {write}", disk_gb=8.0)
    assert caught.value.code == "DXB-B373"
