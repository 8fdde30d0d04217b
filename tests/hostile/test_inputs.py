"""Files of other programs that were damaged, or made to do harm: each reader reads them, or refuses with one error.

What each form can name outside of the input, and what it can expand to, is tried beside its reader: files of meshes in
`tests/formats/test_named_files.py` and `test_stage_files.py`, robots in `tests/sim/model/imported`, recordings in
`tests/formats/test_mcap.py` and `tests/rules/capture/test_bag.py`.
"""

from __future__ import annotations

import functools
import gc
import os
import resource
import signal
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.errors import DxbError
from dextera_build.formats import lens as lens_files
from dextera_build.formats import mesh as mesh_files
from dextera_build.sim.model.imported import collada, mjcf, urdf
from tests import factories
from tests.hostile.test_fuzz import FEW, MANY
from tests.hostile.values import torn
from tests.rules.simulate.robot_files import ARM, HAND, PRISM, cube

PICTURE = Image(pixels=np.arange(16 * 24 * 3, dtype=np.uint8).reshape(16, 24, 3))
MESH = factories.box_mesh((-0.1, -0.2, 0.0), (0.1, 0.2, 0.3))
PAINTED = MESH.model_copy(update={"uv": np.zeros((12, 3, 2), np.float32), "texture": PICTURE})
CAMERA = Camera(width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5)

Reader = Callable[[Path], Any]
ROOM_BYTES = 8 << 30


def robot(path: Path) -> Any:
    """A robot whose description has the content of a file."""
    files = {path.name: path.read_bytes(), "assets/cube.stl": cube(), "meshes/cube.stl": cube()}
    files["meshes/prism.dae"] = PRISM.encode()
    return (urdf if path.suffix == ".urdf" else mjcf).read(path.name, files)


READERS: dict[str, Reader] = {
    **dict.fromkeys(("a.obj", "a.mtl", "a.glb", "a.ply", "a.stl", "a.usda", "a.usdc"), mesh_files.load),
    "a.dae": lambda path: collada.as_obj(path.name, path.read_bytes()),
    "a.yaml": lens_files.load,
    "a.urdf": robot,
    "a.xml": robot,
}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A valid file of each form, with the files beside it."""
    folder = tmp_path_factory.mktemp("whole")
    for name in ("a.obj", "a.glb", "a.usda", "a.usdc"):
        PAINTED.save(folder / name)
    for name in ("a.ply", "a.stl"):
        MESH.save(folder / name)
    CAMERA.save(folder / "a.yaml")
    (folder / "a.dae").write_text(PRISM)
    (folder / "a.urdf").write_text(ARM)
    (folder / "a.xml").write_text(HAND)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def tried(whole: dict[str, bytes], folder: Path, name: str, data: st.DataObject) -> None:
    """Read a file that was torn; nothing but an error of dxb's may come out."""
    for other, content in whole.items():
        (folder / other).write_bytes(torn(content, data) if other == name else content)
    path = folder / name
    read = functools.partial(READERS[name], path.with_suffix(".obj") if name == "a.mtl" else path)
    if name == "a.usdc":
        assert ended(read) in (0, -signal.SIGSEGV, -signal.SIGBUS, -signal.SIGABRT)
        return
    with suppress(DxbError):
        read()


def ended(read: Callable[[], Any]) -> int:
    """Exit status of a process that reads: USD reads beyond a torn binary layer, which ends a worker, not a build."""
    child = os.fork()
    if not child:
        gc.disable()  # it would write to, and so copy, all memory of this process
        resource.setrlimit(resource.RLIMIT_DATA, (ROOM_BYTES, ROOM_BYTES))  # else USD takes what a torn table says
        status = 1
        try:
            with suppress(DxbError):
                read()
            status = 0
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


@pytest.mark.medium
@pytest.mark.parametrize("name", sorted(READERS))
@FEW
@given(data=st.data())
def test_a_torn_file_is_read_or_refused(whole, tmp_path, name, data):
    tried(whole, tmp_path, name, data)


@pytest.mark.slow
@pytest.mark.timeout(1800)  # USD takes room for what a torn table says, in a process for each file
@pytest.mark.parametrize("name", sorted(READERS))
@MANY
@given(data=st.data())
def test_a_torn_file_is_read_or_refused_at_length(whole, tmp_path, name, data):
    tried(whole, tmp_path, name, data)
