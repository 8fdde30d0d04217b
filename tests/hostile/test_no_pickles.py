"""Nothing that dxb reads can run: no pickle is loaded, by any road, and text is never evaluated."""

from __future__ import annotations

import ast
import io
import os
import pickle
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from dextera_build.artifacts.base import File, Folder
from dextera_build.digest import canonical, of_bytes
from dextera_build.errors import ArtifactError, RuleError
from dextera_build.store import headers
from dextera_build.testing import RuleRunner

REPO = Path(__file__).parents[2]
SOURCES = sorted(
    path
    for folder in ("dextera_build", "rules", "recipes", "examples")
    for path in (REPO / folder).rglob("*.py")
    if "_bundled" not in path.parts
)
MODULES = {
    *("pickle", "_pickle", "cPickle", "pickletools", "marshal", "shelve", "copyreg", "imp"),
    *("dill", "cloudpickle", "joblib", "jsonpickle", "hickle", "klepto", "pandas"),
}
"""Whoever imports one of these may run what it reads; `pandas` has `read_pickle`, and nothing here needs it."""
OWN = {
    # Warp's own, of kernels that stand in this package.
    "dextera_build/gaussians/rasteriser/raster.py": "names load_module",
}
"""Names that mean something else there."""
CALLS = {"eval", "exec", "compile", "__import__"}
"""Builtins that run text."""
LOADERS = {"torch": ("weights_only", True), "numpy": ("allow_pickle", False)}
"""`load` of these opens pickles unless it is told otherwise."""
NEVER = {
    "read_pickle",
    "unsafe_load",
    "full_load",
    "UnsafeLoader",
    "FullLoader",
    "load_module",
    "find_class",
    "Unpickler",
}

WORDS = re.compile(rf"\b({'|'.join([*MODULES, *CALLS, *NEVER, 'load', 'PackageImporter', 'allow_pickle', 'PIL'])})\b")
"""A source without any of these words has no fault, and need not be parsed."""


def aliases(tree: ast.AST) -> dict[str, str]:
    """Name in this file -> what it stands for."""
    found = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for name in node.names:
                found[name.asname or name.name.split(".")[0]] = name.name if name.asname else name.name.split(".")[0]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            found |= {name.asname or name.name: f"{node.module}.{name.name}" for name in node.names}
    return found


def named(node: ast.expr, known: dict[str, str]) -> str:
    """`numpy.load` for `np.load`; "" for what is no plain name."""
    if isinstance(node, ast.Attribute):
        inner = named(node.value, known)
        return f"{inner}.{node.attr}" if inner else f"?.{node.attr}"
    return known.get(node.id, node.id) if isinstance(node, ast.Name) else ""


def faults(text: str) -> Iterator[str]:
    """What in a source text may load a pickle or run text."""
    if not WORDS.search(text):
        return
    tree = ast.parse(text)
    known = aliases(tree)
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom):
            names = [name.name for name in node.names] if isinstance(node, ast.Import) else [str(node.module)]
            yield from (f"{node.lineno}: imports {name}" for name in names if name.split(".")[0] in MODULES)
        elif isinstance(node, ast.Attribute | ast.Name):
            name = node.attr if isinstance(node, ast.Attribute) else node.id
            if name in NEVER:
                yield f"{node.lineno}: names {name}"
        if isinstance(node, ast.Call):
            yield from _call(node, named(node.func, known))


def _call(node: ast.Call, name: str) -> Iterator[str]:
    package, _, method = name.partition(".")
    told = {word.arg: word.value for word in node.keywords}
    if name in CALLS:
        yield f"{node.lineno}: calls {name}"
    if package in LOADERS and method in ("load", "jit.load", "hub.load", "package.PackageImporter"):
        word, value = LOADERS[package]
        given = told.get(word)
        if method != "load" or not (isinstance(given, ast.Constant) and given.value is value):
            yield f"{node.lineno}: calls {name} without {word}={value}"
    elif "allow_pickle" in told and not (
        isinstance(told["allow_pickle"], ast.Constant) and told["allow_pickle"].value is False
    ):
        yield f"{node.lineno}: allows pickles"
    if name == "PIL.Image.open" and "formats" not in told:
        yield f"{node.lineno}: opens pictures of every format, and Pillow starts Ghostscript for some"
    if name == "yaml.load":
        yield f"{node.lineno}: calls yaml.load"


@pytest.mark.medium
def test_no_source_loads_a_pickle_or_runs_text():
    found = []
    for path in SOURCES:
        name, text = path.relative_to(REPO).as_posix(), path.read_text()
        found += [f"{name}:{fault}" for fault in faults(text) if not fault.endswith(OWN.get(name, "\n"))]
        found += [f"{name}: marshal.load"] if "marshal.load(" in text else []
    assert len(SOURCES) > 1000
    assert found == []


@pytest.mark.parametrize(
    "text",
    [
        "import pickle",
        "from pickle import loads",
        "def f():\n    import cloudpickle as c",
        "import torch\ntorch.load(x)",
        "import torch as t\nt.load(x, weights_only=False)",
        "from torch import load\nload(x)",
        "import torch\ntorch.jit.load(x)",
        "import numpy as np\nnp.load(x)",
        "import numpy as np\nnp.load(x, allow_pickle=flag)",
        "from numpy import load as read\nread(x)",
        "import numpy as np\nnp.lib.format.read_array(x, allow_pickle=True)",
        "import yaml\nyaml.load(x, Loader=yaml.Loader)",
        "import yaml\nyaml.unsafe_load(x)",
        "from PIL import Image\nImage.open(x)",
        "from PIL import Image as Pillow\nPillow.open(x)",
        "import PIL.Image\nPIL.Image.open(x)",
        "eval(x)",
        "exec(x)",
    ],
)
def test_the_search_finds_what_it_looks_for(text):
    assert list(faults(text)) != []


@pytest.mark.parametrize(
    "text",
    [
        "import numpy as np\nnp.load(x, allow_pickle=False)",
        "import torch\ntorch.load(x, weights_only=True)",
        "from PIL import Image\nImage.open(x, formats=('PNG',))",
        "a.eval()",
    ],
)
def test_the_search_leaves_alone_what_is_safe(text):
    assert list(faults(text)) == []


class Trap:
    """Writes a file when somebody opens the pickle of it."""

    def __init__(self, place: Path) -> None:
        self.place = place

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self.place),)


def npy(value: object) -> bytes:
    out = io.BytesIO()
    np.save(out, np.array([value], dtype=object), allow_pickle=True)
    return out.getvalue()


def test_the_trap_snaps(tmp_path):
    pickle.loads(pickle.dumps(Trap(tmp_path / "ran")))
    assert (tmp_path / "ran").is_dir()


def test_a_depth_image_that_is_a_pickle_does_not_run(tmp_path):
    from tests.rules.capture.test_folder import files

    captured = files(depth__png=None, depth__npy=npy(Trap(tmp_path / "ran")))
    with pytest.raises(RuleError, match="one number of metres per pixel"):
        RuleRunner(tmp_path / "runner").run("capture.folder", folder=captured)
    assert not (tmp_path / "ran").exists()


@pytest.mark.medium
def test_weights_that_are_a_pickle_do_not_run(tmp_path):
    torch = pytest.importorskip("torch")
    from dextera_build.learning import weights

    out = io.BytesIO()
    torch.save({"w": Trap(tmp_path / "ran")}, out)
    for data in (out.getvalue(), pickle.dumps(Trap(tmp_path / "ran"))):
        with pytest.raises(RuleError, match="not a safetensors file"):
            weights.from_bytes(data)
    assert not (tmp_path / "ran").exists()


@pytest.mark.parametrize(
    "dtype", ["O", "object", "|O8", "O,O", "V", "", "f8,O", "m8[", "x" * 1000, None, 3, "a", "f4", "S5"]
)
def test_an_array_of_objects_is_refused(tmp_path, dtype):
    """A header may name any dtype; the bytes behind it are never taken for objects."""
    from dextera_build.artifacts.cameras.image import Image
    from dextera_build.artifacts.table import Table

    data = pickle.dumps(Trap(tmp_path / "ran"))
    for kind in (Image, Table):
        field = next(iter(kind.model_fields))
        text = canonical({"artifact": kind.name(), "fields": {field: {"$array": [dtype, [1], of_bytes(data)]}}})
        blobs = {of_bytes(data): data, of_bytes(text): text}
        with pytest.raises(ArtifactError), headers.reading("a test"):
            kind.decode(of_bytes(text), blobs.__getitem__)
    assert not (tmp_path / "ran").exists()


def test_content_is_bytes_and_stays_bytes(tmp_path):
    data = pickle.dumps(Trap(tmp_path / "ran"))
    assert File(data=data).data == data
    assert Folder(files={"a.pkl": data}).files == {"a.pkl": data}
    assert not (tmp_path / "ran").exists()
