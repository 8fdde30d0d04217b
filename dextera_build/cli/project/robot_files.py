"""Files of a robot for `dxb new robot`: read where they are, and copied if they are outside of the project."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.errors import UsageError, listing
from dextera_build.project.project import Project

if TYPE_CHECKING:
    from dextera_build.sim.model.imported.source import Source

_HIGHEST = 3
"""Folders in which meshes are searched: the description's, its package's, and that of packages."""
_PARTS = ("arm", "hand")
"""Folders of the copies of two files."""


@dataclass
class Part:
    """A description that was read."""

    file: Path
    """The URDF or MJCF."""
    folder: Path
    """The folder that holds it and its meshes."""
    source: Source
    root: str
    """Its root link."""
    whole: bool
    """Whether several roots were put into one link."""
    used: set[str]
    """Paths, in the folder, of the files that were read."""
    below: str = ""
    """Its folder in the recipe's files, with `/` at the end; empty for the folder itself."""

    @property
    def path(self) -> str:
        """Path of the description in the recipe's files."""
        return self.below + str(self.file.relative_to(self.folder))


def read(file: Path, project: Project, repair: bool, attached: bool = False) -> Part:
    """The parsed description.

    Args:
        file: An absolute path.
        project: The project.
        repair: Replace moments of inertia that no body has.
        attached: It is a hand, whose names have a prefix.

    Raises:
        RuleError: It is no description of a robot, or a file that it names is missing.
    """
    from dextera_build.errors import RuleError
    from dextera_build.sim.model.imported import mjcf, roots, urdf
    from dextera_build.sim.model.imported.source import WHOLE

    wrong: RuleError | None = None
    robot = b"<robot" in file.read_bytes()[:4096] or file.suffix == ".urdf"
    folders = list(file.parents[:_HIGHEST])
    if inside(project, file):
        folders = [folder for folder in folders if inside(project, folder)]
    for folder in folders:
        path, files = str(file.relative_to(folder)), _Lazy(folder)
        try:
            source = urdf.read(path, files, repair) if robot else mjcf.read(path, files)
            tops = [body.name for body in source.spec.worldbody.bodies]
            whole = len(tops) > 1
            if whole:
                source = mjcf.read(path, files, whole=True)
            root = WHOLE if whole else tops[0]
            source.renamed = {} if attached else roots.free_base(source.spec, root)
            return Part(file, folder, source, root, whole, files.used)
        except RuleError as error:
            wrong = wrong or error
            if "missing" not in error.message:
                raise
    assert wrong is not None
    raise wrong


def gathered(parts: Sequence[Part], project: Project, name: str) -> tuple[str, dict[Path, bytes]]:
    """The folder for the recipe's input, relative to the project, and copies: path -> content.

    Files are copied if they are outside of the project, and files of two parts also if their folders differ, because a
    recipe takes one folder.

    Raises:
        UsageError: The project has another file at the path of a copy.
    """
    folders = {part.folder for part in parts}
    if len(folders) == 1 and inside(project, parts[0].folder):
        return str(parts[0].folder.relative_to(project.root.resolve())), {}
    place = project.root / "robots" / name
    copied: dict[Path, bytes] = {}
    for part, below in zip(parts, _PARTS if len(folders) > 1 else ("", ""), strict=False):
        part.below = f"{below}/" if below else ""
        for path in sorted(part.used | _licences(part)):
            copied[place / below / path] = (part.folder / path).read_bytes()
    _refuse_others(copied, project, name)
    return f"robots/{name}", copied


def _refuse_others(copied: dict[Path, bytes], project: Project, name: str) -> None:
    """Refuse to write over the files of another robot: its recipe would build this one."""
    others = [path for path, data in copied.items() if path.exists() and path.read_bytes() != data]
    if others:
        raise UsageError(
            f"`robots/{name}` holds the files of another robot",
            code="DXB-U191",
            facts={"would be overwritten": listing(map(project.shown, others), most=5)},
            hint=f"`-o recipes/robot/OTHER.yaml` copies to `robots/OTHER`; or remove `robots/{name}`",
        )


def _licences(part: Part) -> set[str]:
    """Licence files next to the description, or in a folder above it that belongs to its files."""
    from dextera_build.sim.model.published import stated

    found = set()
    for folder in part.file.parents:
        names = {each.name: each for each in folder.iterdir() if each.is_file()} if folder.is_dir() else {}
        found |= {str(names[name].relative_to(part.folder)) for name in stated(names)}
        if folder == part.folder or found:
            break
    return found


def inside(project: Project, path: Path) -> bool:
    """Whether a path is in the project."""
    return path.is_relative_to(project.root.resolve())


class _Lazy(dict[str, bytes]):
    """Path -> content of the files of a folder, read on demand."""

    def __init__(self, folder: Path) -> None:
        files = (each for each in folder.rglob("*") if each.is_file())
        super().__init__({str(each.relative_to(folder)): b"" for each in files})
        self._folder = folder
        self.used: set[str] = set()
        """Paths of the files that were read."""

    def __getitem__(self, path: str) -> bytes:
        """The bytes of a file."""
        self.used.add(path)
        return (self._folder / path).read_bytes()
