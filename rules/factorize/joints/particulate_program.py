"""Program of backend `particulate` of factorize.articulate; runs in the environment of Particulate.

The environment finds the repository's `infer.py`, which is called as its authors describe.
"""

from __future__ import annotations

import importlib.util
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_LEFT_OUT = shutil.ignore_patterns(".git", "__pycache__", "assets", "hunyuan3d-examples", "*.ckpt")


def articulate(request: Any) -> Any:
    """The folder of the URDF that infer.py writes for the mesh."""
    with tempfile.TemporaryDirectory() as scratch:
        clone, mesh, out = Path(scratch, "clone"), Path(scratch, "mesh.glb"), Path(scratch, "out")
        _clone(request, clone)
        _without_turn(request.inputs["mesh"].path, mesh)
        options = request.options
        command = [sys.executable, str(clone / "infer.py")]
        command += ["--input_mesh", str(mesh), "--output_dir", str(out), "--up_dir", "Z", "--export_urdf"]
        command += ["--ckpt_path", str(Path(str(request.weights["particulate"]), "model.pt"))]
        command += ["--num_points", str(options["points"])]
        command += ["--min_part_confidence", str(options["least_confidence"])]
        if not options["whole_components"]:
            command.append("--no_strict")
        subprocess.run(command, cwd=clone, check=True)
        # infer.py continues after an error, and the name of the folder contains the time.
        made = list(out.glob("urdf_*/model.urdf"))
        if len(made) != 1:
            raise RuntimeError("infer.py wrote no URDF; see its output")
        folder = request.file("urdf")
        shutil.copytree(made[0].parent, folder)
        return dxb_backend.value("Folder", file=folder)


def _clone(request: Any, folder: Path) -> None:
    """A copy of the repository with the weights of PartField at the expected path."""
    found = importlib.util.find_spec("infer")
    if found is None or found.origin is None:
        raise RuntimeError("the environment does not find `infer.py`; name the clone in a `.pth` file")
    shutil.copytree(Path(found.origin).parent, folder, ignore=_LEFT_OUT)
    weights = folder / "PartField" / "model" / "model_objaverse.ckpt"
    weights.parent.mkdir(parents=True, exist_ok=True)
    weights.symlink_to(Path(str(request.weights["partfield"]), weights.name))


def _without_turn(source: Path, target: Path) -> None:
    """A GLB whose vertices have z up, because infer.py ignores the transforms of the nodes."""
    import numpy as np
    import trimesh

    mesh: Any = trimesh.load(source, force="mesh")
    mesh.apply_transform(np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]))
    mesh.export(target)


dxb_backend.serve(articulate=articulate)
