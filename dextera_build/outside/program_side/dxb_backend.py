"""The program's side of dxb backend protocol 1: copy this one file into the folder of your program.

    import dxb_backend

    def complete(request):
        image = request.inputs["image"].path          # a PNG; arrays are .npy, meshes .glb
        model = load(request.weights["trellis"], request.device)
        path = request.file("mesh.glb")               # a new file of the response
        model(image, seed=request.seed).export(path)
        return dxb_backend.value("Mesh", file=path)

    dxb_backend.serve(complete=complete)

It needs Python 3.8 or newer and nothing else. The output of the program goes to the log of the node.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

PROTOCOL = 1
_SIGN = "@dxb "


class Refused(Exception):  # noqa: N818
    """The program cannot work with these inputs: `raise Refused("the mask is empty", "raise `area_px`")`."""

    def __init__(self, message: str, hint: str = "") -> None:
        super().__init__(message)
        self.message, self.hint = message, hint


class Value:
    """An input that is no plain JSON value.

    Attributes:
        type: Name of its type: `Image`, `array`, `bytes`, `map`, ...
        path: Its file or folder, if it has one.
        parts: Its fields or items by name, if it has any.
    """

    def __init__(
        self, type: str, path: Path | None = None, parts: Mapping[str, Any] | None = None, part: str = "fields"
    ) -> None:
        self.type, self.path, self.parts, self._part = type, path, parts or {}, part

    def __getitem__(self, name: str) -> Any:
        """A part by its name."""
        return self.parts[name]

    def __getattr__(self, name: str) -> Any:
        try:
            return self.__dict__["parts"][name]
        except KeyError:
            raise AttributeError(f"a {self.type} has no field `{name}`") from None


def value(type: str, file: str | Path | None = None, **fields: Any) -> Value:
    """An output: a type with a file, or with fields."""
    return Value(type, Path(file)) if file is not None else Value(type, parts=fields)


def items(parts: Mapping[str, Any]) -> Value:
    """An output that is a dict."""
    return Value("map", parts=dict(parts), part="items")


class Request:
    """A request of dxb.

    Attributes:
        function, rule, backend: The function to run, its rule and its backend.
        inputs: Name -> plain value or `Value`.
        options, weights, device, seed: See docs/outside.md.
    """

    def __init__(self, folder: str) -> None:
        self._folder = Path(folder)
        self._response = self._folder / "response"
        self._line = ""
        self._metrics: dict[str, Any] = {}
        with open(str(self._folder / "request" / "request.json"), encoding="utf-8") as told:
            message = json.load(told)
        if message["protocol"] != PROTOCOL:
            raise SystemExit(f"dxb speaks protocol {message['protocol']}, this program {PROTOCOL}")
        self.function: str = message["function"]
        self.rule: str = message["rule"]
        self.backend: str = message["backend"]
        self.options: dict[str, Any] = message["options"]
        self.weights: dict[str, str] = message["weights"]
        self.device: str = message["device"]
        self.seed: int = message["seed"]
        self.inputs = {name: self._input(raw) for name, raw in message["inputs"].items()}

    def file(self, name: str) -> Path:
        """The path of a new file of the response."""
        return self._response / name

    def say(self, line: str) -> None:
        """Set the summary of the result in the build log."""
        self._line = str(line)

    def metric(self, name: str, number: float, unit: str = "") -> None:
        """Add a number to the report."""
        self._metrics[name] = [float(number), unit]

    def progress(self, done: int, total: int, what: str = "") -> None:
        """Report progress."""
        _tell({"progress": [int(done), int(total), str(what)]})

    def answer(self, output: Any) -> None:
        """Write the response."""
        self._write({"status": "ok", "output": self._output(output), "line": self._line, "metrics": self._metrics})

    def refuse(self, error: Refused) -> None:
        """Write a refusal."""
        self._write({"status": "refused", "message": error.message, "hint": error.hint})

    def _input(self, raw: Any) -> Any:
        if isinstance(raw, list):
            return [self._input(part) for part in raw]
        if not isinstance(raw, dict):
            return raw
        part = "items" if "items" in raw else "fields"
        path = raw.get("file", raw.get("folder"))
        parts = {name: self._input(each) for name, each in raw.get(part, {}).items()}
        return Value(raw["type"], None if path is None else self._folder / "request" / path, parts, part)

    def _output(self, output: Any) -> Any:
        if isinstance(output, (list, tuple)):
            return [self._output(part) for part in output]
        if isinstance(output, dict):
            output = items(output)
        if not isinstance(output, Value):
            return output
        if output.path is None:
            return {"type": output.type, output._part: {k: self._output(v) for k, v in output.parts.items()}}
        part = "folder" if output.path.is_dir() else "file"
        return {"type": output.type, part: self._inside(output.path)}

    def _inside(self, path: Path) -> str:
        """The name of a file of the response; a file from elsewhere is copied into it."""
        path = Path(os.path.abspath(str(path)))
        root = Path(os.path.abspath(str(self._response)))
        if root in path.parents:
            return path.relative_to(root).as_posix()
        target, count = root / path.name, 0
        while target.exists():
            count += 1
            target = root / f"{count}-{path.name}"
        if path.is_dir():
            shutil.copytree(str(path), str(target))
        else:
            shutil.copyfile(str(path), str(target))
        return target.name

    def _write(self, message: dict[str, Any]) -> None:
        text = json.dumps({"protocol": PROTOCOL, **message}, allow_nan=False)
        aside = self._response / "response.json.part"
        aside.write_text(text, encoding="utf-8")
        os.replace(str(aside), str(self._response / "response.json"))


def serve(**functions: Callable[[Request], Any]) -> None:
    """Answer the request in the folder that the command line names; without one, those that come in, one per line."""
    if len(sys.argv) > 1:
        _answer(sys.argv[-1], functions)
        return
    for line in sys.stdin:
        folder = json.loads(line)["folder"]
        _answer(folder, functions)
        _tell({"done": folder})


def _answer(folder: str, functions: Mapping[str, Callable[[Request], Any]]) -> None:
    request = Request(folder)
    try:
        if request.function not in functions:
            raise Refused(f"the program has no function `{request.function}`", f"`serve({request.function}=...)`")
        request.answer(functions[request.function](request))
    except Refused as error:
        request.refuse(error)


def _tell(message: dict[str, Any]) -> None:
    sys.stdout.write("\n" + _SIGN + json.dumps(message) + "\n")
    sys.stdout.flush()
