"""Random projects whose rules import helper modules in every layout that Python knows, and random edits of them.

A project consists of files alone; a clean build, or a reference, starts from a copy of them.
"""

from __future__ import annotations

import os
import py_compile
import random
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path

import yaml

from tests.oracle.texts import BACKEND, CHILD, IMPORTS, MODULE, RULE

STAGE, PLUG = "rules/toy", "site/plug/rules/toy"
OUTSIDE = (".config", ".cache", "cache", "share")
INPUTS = ("data/one", "data/two", "data/tree/one")
TREE = ("data/tree/more", "data/tree/deep/more")
LINKED = ("rules", STAGE, PLUG, "src", "more", "site", "data", "data/tree", "recipes")
"""Folders that may become links."""
METADATA = "site/plug-1.0.dist-info/METADATA"
RECIPES = ("recipes/deep/g.yaml", "bundled/recipes/deep/g.yaml")
ENTRY_POINTS = "[dxb.rules]\nplug = plug.rules\n"

# Each module may import those before it.
MODULES = {
    "single.py": "src",
    "spread/part.py": "src",
    "spread/other.py": "more",
    "own/sub/leaf.py": "src",
    "own/sub/__init__.py": "src",
    "own/__init__.py": "src",
    "plain.py": "stage",
    "space/part.py": "stage",
    "lib/inner/leaf.py": "stage",
    "lib/inner/__init__.py": "stage",
    "lib/deep.py": "stage",
    "lib/__init__.py": "stage",
}
LATER = {
    "single/__init__.py": "src",
    "spread/__init__.py": "src",
    "own.py": "src",
    "fast.py": "stage",
    "plain/__init__.py": "stage",
    "lib.py": "stage",
    "lib/fast.py": "stage",
    "space/__init__.py": "stage",
    "space/fast/__init__.py": "stage",
    "__init__.py": "stage",
}
"""Modules that come and go: optional ones, and those that shadow, open or close another."""
BELOW = {"lib/__init__.py": "deep", "lib/inner/__init__.py": "leaf", "own/sub/__init__.py": "leaf"}
BELOW |= {"own/__init__.py": "sub", "space/__init__.py": "part", "spread/__init__.py": "part", "__init__.py": "plain"}
"""Packages that change a module of theirs while they are imported."""
FIRST = ("first/single.py", "first/single/__init__.py", "first/spread/part.py", "first/spread/__init__.py")
"""They come before others on the search path, in a folder that is not there at first."""


class RandomProject:
    """A project that can be edited; equal seeds give equal projects and edits.

    Args:
        seed: Of the generator.
        root: Its folder.
        spawns: Whether rules call functions in processes that their workers start.
    """

    def __init__(self, seed: int, root: Path, *, spawns: bool = False) -> None:
        self.random = random.Random(seed)
        self.spawns = spawns
        self.root = root
        self.main = self.random.choice((STAGE, STAGE, PLUG))
        """The stage that has all rules; a project without rules of its own may get some later."""
        self.rules = [f"r{number}" for number in range(self.random.randint(2, 3))]
        self.edits: list[str] = []
        for path, text in self._files().items():
            self.put(path, text)

    def files(self) -> dict[str, str]:
        """What the project is now: path -> text."""
        return files(self.root)

    def restore(self, wanted: Mapping[str, str]) -> None:
        """Let the project be what it was; byte code stays where it lies."""
        for path in self.files().keys() - wanted.keys():
            self._remove(path)
        for path, text in wanted.items():
            if not (self.root / path).is_file() or (self.root / path).read_text() != text:
                self.put(path, text)

    def put(self, path: str, text: str) -> None:
        """Write one file."""
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def edit(self) -> str:
        """Change one thing; returns what, and "harmless: ..." for what no node may run for."""
        kinds = ["number"] * 5 + ["appear"] * 4 + ["vanish", "vanish", "rewire", "backend", "shadow", "shadow"]
        kinds += ["shadow"] * 6 * (self.main == PLUG) + [
            "move",
            "move",
            "recipe_shadow",
            "input",
            "input",
            "option",
            "link",
            "harmless",
            "harmless",
            "path",
            "tree",
            "switch",
            "switch",
            "version",
        ]
        kept = self._folders() if self.random.random() < 0.5 else {}
        done = ""
        while not done:
            done = getattr(self, f"_{self.random.choice(kinds)}")()
        for folder, stamp in kept.items():
            if folder.is_dir():
                os.utime(folder, ns=(stamp, stamp))
        self.edits.append(f"{done}, times of folders kept" if kept else done)
        return done

    def _folders(self) -> dict[Path, int]:
        """Every folder -> its time of modification."""
        found = {self.root / path for path in self.files()}
        return {folder: folder.stat().st_mtime_ns for file in found for folder in file.parents[: -len(self.root.parts)]}

    def _number(self) -> str:
        """Another number in one source: as many bytes and, mostly, the same time, with byte code of the old text."""
        paths = list(self.sources())
        above = [path for path in paths if path.endswith("/__init__.py")]  # imports run these, too
        path = self.random.choice(self.random.choice((paths, above)))
        return self.alter(path, self.random.choice(("kept", "kept", "compiled", "compiled", "unchecked", "now")))

    def alter(self, path: str, how: str) -> str:
        """Write another number of as many digits into a file."""
        file = self.root / path
        old, before = file.read_text(), file.stat().st_mtime_ns
        if how == "compiled":
            py_compile.compile(str(file))
        elif how == "unchecked":
            py_compile.compile(str(file), invalidation_mode=py_compile.PycInvalidationMode.UNCHECKED_HASH)
        head, mark, tail = old.partition("NUMBER = " if path.endswith(".py") else "number ")
        file.write_text(f"{head}{mark}{(int(tail[0]) + self.random.randint(1, 8)) % 10}{tail[1:]}")
        if how != "now":
            os.utime(file, ns=(before, before))
        return f"{path} {how}"

    def _move(self) -> str:
        """A statement of a module goes below the next one."""
        path = self.random.choice([path for path, text in self.files().items() if "STEPS.reverse" in text])
        self._swap(path, "STEPS.")
        return f"{path} statements moved"

    def _swap(self, path: str, *heads: str) -> None:
        """Let a line that begins with one of `heads` and the next such line change places."""
        lines = (self.root / path).read_text().splitlines(keepends=True)
        places = [place for place, line in enumerate(lines) if line.startswith(heads)]
        first = self.random.randrange(len(places) - 1)
        here, there = places[first : first + 2]
        lines[here], lines[there] = lines[there], lines[here]
        self.put(path, "".join(lines))

    def _input(self) -> str:
        return self.alter(self.random.choice(INPUTS), self.random.choice(("kept", "now")))

    def _tree(self) -> str:
        return self._toggle(self.random.choice(TREE), f"number {self.random.randrange(10)}")

    def _switch(self) -> str:
        """A folder, or the link that it is, becomes a link to a copy, or a copy; a number may differ there."""
        path = self.random.choice([path for path in LINKED if (self.root / path).is_dir()])
        place = self.root / ".cache" / "linked"
        copy = place / str(len(list(place.glob("*"))))
        shutil.copytree(self.root / path, copy)
        inside = [file for file in copy.rglob("*") if file.is_file() and file.suffix != ".pyc"]
        counted = sorted(file for file in inside if "number " in (text := file.read_text()) or "NUMBER = " in text)
        done = f"harmless: {path} is switched"
        if counted and self.random.random() < 0.7:
            done = self.alter(str(self.random.choice(counted).relative_to(self.root)), "kept")
        os.rename(self.root / path, copy.with_suffix(".old"))
        if self.random.random() < 0.7:
            (self.root / path).symlink_to(copy)
        else:
            os.rename(copy, self.root / path)
        return f"{done} for {path}"

    def _version(self) -> str:
        """A distribution changes its version in place."""
        before = (self.root / METADATA).stat().st_mtime_ns
        self.put(METADATA, f"Metadata-Version: 2.1\nName: plug\nVersion: 1.{self.random.randrange(1000, 9999)}\n")
        os.utime(self.root / METADATA, ns=(before, before))
        return "version of plug"

    def _appear(self) -> str:
        at_stage = [f"{self.main}/{name}" for name, place in LATER.items() if place == "stage"]
        missing = [*at_stage, *(f"src/{name}" for name, place in LATER.items() if place == "src"), *FIRST]
        path = self.random.choice([path for path in missing if not (self.root / path).exists()] or [""])
        if path:
            self.put(path, self._module(path))
        return path and f"{path} appears"

    def _vanish(self) -> str:
        later = {f"{self.main}/{name}" for name in LATER} | {f"src/{name}" for name in LATER} | {*FIRST}
        there = sorted(later & self.files().keys())
        path = self.random.choice(there or [""])
        if path:
            self._remove(path)
        return path and f"{path} vanishes"

    def _rewire(self) -> str:
        path = self.random.choice([path for path in self.sources() if "_fast" not in path])
        alone = not path.startswith(f"{self.main}/")
        name = Path(path).stem
        self.put(path, self._rule(name, alone=alone) if name in self.rules else self._module(path))
        return f"{path} imports others"

    def _backend(self) -> str:
        path = f"{self.main}/{self.random.choice(self.rules)}_{self.random.choice(('fast', 'able'))}.py"
        return self._toggle(path, BACKEND.format(self.random.randrange(10)))

    def _shadow(self) -> str:
        """The first rules of a project, or more of them, before those that a distribution brings."""
        if self.main == STAGE:
            return ""
        return self._toggle(f"{STAGE}/{self.random.choice(self.rules)}.py", "")

    def _recipe_shadow(self) -> str:
        if (self.root / RECIPES[0]).exists() and not (self.root / RECIPES[1]).exists():
            return ""
        return self._toggle(RECIPES[0], self._recipe())

    def _option(self) -> str:
        return self._change_node("add", self.random.randrange(10))

    def _link(self) -> str:
        return self._change_node(self.random.choice("ab"), self.random.choice(("$one", "$two")))

    def _path(self) -> str:
        """A distribution that is installed as editable moves, or goes."""
        there = self.random.choice(("", "../more\n", "../elsewhere\n"))
        self.put("site/more.pth", there)
        return f"site/more.pth leads to {there!r}"

    def _harmless(self) -> str:
        path = self.random.choice(list(self.sources()))
        file = self.root / path
        kind = self.random.choice(("comment", "touched", "no byte code", "other byte code", "functions moved"))
        if kind == "functions moved":
            if "def two" not in file.read_text():
                return ""
            self._swap(path, "def one", "def two")
        elif kind == "comment":
            self.put(path, f"{file.read_text()}# a comment\n")
        elif kind == "touched":
            os.utime(file)
        else:
            poison(file, b"" if kind == "no byte code" else None)
        return f"harmless: {path} {kind}"

    def _change_node(self, word: str, value: object) -> str:
        path = next(path for path in RECIPES if (self.root / path).exists())
        recipe = yaml.safe_load((self.root / path).read_text())
        name = self.random.choice(list(recipe["nodes"]))
        recipe["nodes"][name][word] = value
        self.put(path, yaml.safe_dump(recipe, sort_keys=False))
        return f"{name}.{word} = {value}"

    def _toggle(self, path: str, text: str) -> str:
        if (self.root / path).exists():
            self._remove(path)
            return f"{path} vanishes"
        self.put(path, text or self._rule(Path(path).stem, alone=True))
        return f"{path} appears"

    def _remove(self, path: str) -> None:
        file = self.root / path
        file.unlink()
        while file.parent != self.root and not [each for each in file.parent.iterdir() if each.name != "__pycache__"]:
            file = file.parent
            file.unlink() if file.is_symlink() else shutil.rmtree(file)

    def sources(self) -> Iterator[str]:
        """Paths of files with a number in Python."""
        return (path for path, text in self.files().items() if path.endswith(".py") and "NUMBER = " in text)

    def _files(self) -> dict[str, str]:
        made = {path: f"number {self.random.randrange(10)}" for path in INPUTS}
        made |= {"dxb.toml": 'cache = "cache"\n', "bundled/rules/none": ""}
        made |= {"site/plug/__init__.py": "", "site/plug/rules/__init__.py": "", "site/more.pth": "../more\n"}
        made |= {METADATA: "Metadata-Version: 2.1\nName: plug\nVersion: 1.0\n"}
        made |= {"site/plug-1.0.dist-info/entry_points.txt": ENTRY_POINTS}
        folders = {"stage": self.main, "src": "src", "more": "more"}
        for name, place in MODULES.items():
            made[f"{folders[place]}/{name}"] = self._module(f"{folders[place]}/{name}")
        made["elsewhere/spread/other.py"] = self._module("elsewhere/spread/other.py")
        for name in self.rules:
            made[f"{self.main}/{name}.py"] = self._rule(name)
        return {**made, self.random.choice(RECIPES): self._recipe()}

    def _recipe(self) -> str:
        nodes: dict[str, dict[str, object]] = {}
        for number in range(self.random.randint(3, 6)):
            known = ["$one", "$two", *(f"${name}" for name in nodes)]
            inputs = {slot: self.random.choice(known) for slot in self.random.sample("ab", self.random.randint(0, 2))}
            inputs |= {"tree": "$tree"} if self.random.random() < 0.4 else {}
            nodes[f"n{number}"] = {"rule": f"toy.{self.random.choice(self.rules)}", **inputs}
        made = {"inputs": {"one": INPUTS[0], "two": INPUTS[1], "tree": "data/tree"}, "nodes": nodes}
        return yaml.safe_dump({**made, "targets": {"default": list(nodes)}}, sort_keys=False)

    def _rule(self, name: str, *, alone: bool = False) -> str:
        """The text of a rule; `alone`: it imports nothing of its stage."""
        known = [each for each in MODULES if not (alone and MODULES[each] == "stage")]
        return self._text(RULE, name, known, [] if alone else ["fast.py", "lib/fast.py"])

    def _module(self, path: str) -> str:
        stage = path.removeprefix(f"{self.main}/") if path.startswith(f"{self.main}/") else ""
        inner = stage or path.partition("/")[2]
        order = list(MODULES)
        known = order[: order.index(inner)] if inner in order else []
        if not stage:
            known = [each for each in known if MODULES[each] != "stage"]
        below = BELOW.get(inner, "")
        tail = f"try:\n    from . import {below}\n    {below}.SEEN = NUMBER\nexcept ImportError:\n    pass\n"
        optional = ["lib/fast.py", "space/fast/__init__.py"] if inner in ("plain.py", "space/part.py") else []
        name = inner.replace("/", ".")
        return self._text(MODULE, name, known, optional, "." * inner.count("/"), tail if below else "")

    def _text(
        self, form: str, name: str, known: list[str], optional: list[str], relative: str = "", tail: str = ""
    ) -> str:
        asked = self.random.sample(known, min(len(known), self.random.choice((1, 2, 2, 3))))
        asked += [each for each in optional if self.random.random() < 0.4]
        lines = {"imports": "", "inner": ""}
        for number, module in enumerate(asked):
            word = f"v{number}"
            # What may vanish, or be hidden by what appears, is not relied on.
            how = IMPORTS[1] if module in optional or module.startswith("spread/") else self.random.choice(IMPORTS)
            text = how.format(self._import(module, word, relative), word)
            where = self.random.choice(("imports", "imports", "inner"))
            lines[where] += text if where == "imports" else "".join(f"    {line}\n" for line in text.splitlines())
        calls = [f"v{number}.value()" for number in range(len(asked))]
        # Another process does not know the folders of stages.
        far = [n for n, module in enumerate(asked) if MODULES.get(module, "stage") != "stage"]
        if form is RULE and self.spawns and far:
            calls[far[0]] = f"child(v{far[0]}.value)"
        values = ", ".join(f"v{number} and {call}" for number, call in enumerate(calls))
        lines["child"] = CHILD if self.spawns else ""
        number = self.random.randrange(10)
        return form.format(name=name, Name=name.title(), number=number, values=values, tail=tail, **lines)

    def _import(self, module: str, word: str, relative: str) -> str:
        stem = module.removesuffix("/__init__.py").removesuffix(".py").replace("/", ".")
        above, _, last = stem.rpartition(".")
        if module in LATER or MODULES[module] == "stage":
            return f"from .{relative}{above} import {last} as {word}"
        if above:
            return self.random.choice((f"from {above} import {last} as {word}", f"import {stem} as {word}"))
        return f"import {stem} as {word}"


def files(root: Path) -> dict[str, str]:
    """What a project holds but for what builds leave and byte code: path -> text."""
    found: dict[str, str] = {}
    for folder, below, names in os.walk(root, followlinks=True):
        here = os.path.relpath(folder, root)
        below[:] = sorted(name for name in below if name != "__pycache__" and (here != "." or name not in OUTSIDE))
        for name in sorted(names):
            if not name.endswith(".pyc") and not name.startswith("."):
                found[os.path.normpath(f"{here}/{name}")] = Path(folder, name).read_text()
    return found


def poison(file: Path, code: bytes | None) -> None:
    """Lay byte code beside a source that Python would take for the source's: of another number, or of other bytes."""
    source, state = file.read_text(), file.stat()
    place = Path(file.parent, "__pycache__", f"{file.stem}.{sys.implementation.cache_tag}.pyc")
    place.parent.mkdir(exist_ok=True)
    if code is not None:
        place.write_bytes(code)
        return
    file.write_text(source.replace("NUMBER = ", "NUMBER = 4"))
    py_compile.compile(str(file), cfile=str(place))
    file.write_text(source)
    os.utime(file, ns=(state.st_atime_ns, state.st_mtime_ns))
    # Byte code is known by the second and the size of its source.
    made = place.read_bytes()
    head = made[:8] + (state.st_mtime_ns // 10**9 & 0xFFFFFFFF).to_bytes(4, "little")
    place.write_bytes(head + (state.st_size & 0xFFFFFFFF).to_bytes(4, "little") + made[16:])
