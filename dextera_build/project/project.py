"""The folder that dxb works in: its recipes, its rules, its store, and where each setting comes from."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.errors import Place, RecipeError, UsageError, did_you_mean, listing
from dextera_build.project import settings
from dextera_build.project.remotes_table import Choice
from dextera_build.remotes.spec import Spec

if TYPE_CHECKING:
    # A build that does nothing reads the settings and no recipe; it need not wait for these.
    from dextera_build.code.loader import Library
    from dextera_build.recipe.schema import Recipe
    from dextera_build.workers.capacity import Capacity

MARKER = "dxb.toml"
LOCK = "dxb.lock"
_OVER = ("environment", "command line")  # origins of settings that are no file's
_BARE = "settings stand here without `tool.dxb`: `[resources]`, not `[tool.dxb.resources]`"


@dataclass(frozen=True)
class Setting:
    """A value with its origin, for `dxb show --config`."""

    value: Any
    origin: str


class Project:
    """A project folder.

    Args:
        root: The folder that holds `dxb.toml`, or a `pyproject.toml` with `[tool.dxb]`.
        flags: Settings from the command line; they win over all else.
        declared: False where no project was found and the current folder stands in.
    """

    def __init__(self, root: str | Path, flags: Mapping[str, Any] | None = None, *, declared: bool = True) -> None:
        self.root = Path(root)
        self.declared = declared
        self._recipes: dict[tuple[Path, int, int, int], Recipe] = {}
        self._looked_at: set[str] = set()
        self.remotes = Choice(self.root)
        """The remotes; known when `config` is."""
        self._flags = {name: value for name, value in (flags or {}).items() if value is not None}

    @cached_property
    def config(self) -> dict[str, Setting]:
        """Every setting: flags > `DXB_*` > `dxb.local.toml` > project > user > defaults."""
        found = {name: Setting(value, "default") for name, value in settings.DEFAULTS.items()}
        if not self.declared:
            home = os.path.expanduser(os.environ.get("XDG_CACHE_HOME", "~/.cache"))
            found["cache"] = Setting(f"{home}/dxb", "default outside a project")
        for origin, values in self._layers():
            for name, value in self.remotes.take(values, origin).items():
                if name not in settings.DEFAULTS:
                    raise RecipeError(
                        f"`{name}` is not a setting",
                        code="DXB-R401",
                        where=Place(origin),
                        facts={"settings": listing(settings.DEFAULTS)},
                        hint=_BARE if name == "tool" else did_you_mean(name, settings.DEFAULTS),
                    )
                settings.check(name, value, origin)
                found[name] = Setting(self._over(found, name, value, origin), origin)
        for name, setting in found.items():
            settings.choose(name, setting.value, setting.origin)
        del found["remotes"]
        return found | {name: Setting(value, origin) for name, (value, origin) in self.remotes.rows().items()}

    @staticmethod
    def _over(found: Mapping[str, Setting], name: str, value: Any, origin: str) -> Any:
        """The value of a setting over that of lower layers; resources add up by name."""
        if name != "resources":
            return value
        from dextera_build.workers.capacity import parse

        return {**found[name].value, **parse(value, origin)}

    @property
    def cache(self) -> Path:
        """The store's folder."""
        return self._path(str(self.config["cache"].value))

    @property
    def profile(self) -> str:
        """The profile in force."""
        return str(self.config["profile"].value)

    @property
    def own_profile(self) -> str:
        """The profile of the files, whatever the environment and the command line say."""
        if self.config["profile"].origin not in _OVER:
            return self.profile
        named = [values["profile"] for origin, values in self._layers() if "profile" in values and origin not in _OVER]
        return str(named[-1] if named else settings.DEFAULTS["profile"])

    @property
    def jobs(self) -> int:
        """Cores to share out among nodes; 0 in the settings means all that this process may use."""
        return int(self.config["jobs"].value) or len(os.sched_getaffinity(0))

    @property
    def executor(self) -> str:
        """Where nodes run: `local`, `ray`, or `ray:HOST:PORT`."""
        return str(self.config["executor"].value)

    @property
    def console(self) -> str:
        """What a build shows, or `auto`, which chooses between `live` and `plain`."""
        return str(self.config["console"].value)

    def capacity(self, *, gpus: bool) -> Capacity:
        """What this machine has to share out, or what the settings say that it has; `gpus`: look for devices."""
        from dextera_build.workers.capacity import measure

        said = dict(self.config["resources"].value)
        if self.config["jobs"].origin in _OVER:
            said.pop("cpu", None)
        return measure(self.jobs, said, gpus=gpus)

    @property
    def durable(self) -> bool:
        """Whether a build waits until what it made is on the disk."""
        return settings.is_on(self.config["durable"].value)

    @property
    def calls(self) -> str:
        """How calls of services are treated; see `calls.recorder.Recorder`."""
        return str(self.config["calls"].value)

    @property
    def asks_again(self) -> bool:
        """Whether nodes with recorded calls run although nothing changed."""
        return self.calls in ("refresh", "replace")

    @property
    def trusted_keys(self) -> list[Path]:
        """Files and folders with the public keys of trusted signers.

        Raises:
            UsageError: The settings name what is not there.
        """
        setting = self.config["trusted_keys"]
        named = setting.value if isinstance(setting.value, list) else [setting.value] if setting.value else []
        found = [self._path(str(name)) for name in named]
        for path in found:
            if not os.path.exists(path):
                raise UsageError(
                    f"`trusted_keys` names `{path}`, which is not there",
                    code="DXB-U149",
                    facts={"from": setting.origin},
                    hint=f"mkdir -p {path}",
                )
        user = settings.user_folder() / "trusted_keys"
        return [*found, user] if user.is_dir() else found

    @property
    def require_signed(self) -> bool:
        """Whether results from elsewhere are refused that no trusted key signed."""
        return settings.is_on(self.config["require_signed"].value)

    @property
    def used_remotes(self) -> list[Spec]:
        """The remotes that a build uses, in the order in which they are asked; raises what `allowed` raises."""
        return self.allowed(self.remotes.used if self.config else [])

    def allowed(self, remotes: list[Spec]) -> list[Spec]:
        """The same remotes, where the settings allow to use them.

        Raises:
            UsageError: Signatures are required, and results of one of them, which have none, would be read.
        """
        read = [spec.name for spec in remotes if "r" in spec.mode]
        if read and self.require_signed:
            raise UsageError(
                "`require_signed` is set, and results of remotes are not signed",
                code="DXB-U138",
                facts={"read": listing(read), "from": self.config["require_signed"].origin},
                hint="use no remote (`--cache local:rw`), or only write to them (mode `w`); "
                "`dxb bundle import FILE` imports signed results",
            )
        return remotes

    @cached_property
    def library(self) -> Library:
        """The rules of this project."""
        from dextera_build.code.loader import Library

        return Library(self.root)

    def recipe(self, address: str, extending: tuple[str, ...] = ()) -> Recipe | None:
        """The recipe of an address with all that it extends, the project's own first, or None.

        Raises:
            RecipeError: It is wrong, or extends what does not exist, or itself.
        """
        from dextera_build.recipe.schema import refuse_deep

        own = self._read(address)
        if own is None or own.extends is None:
            return own
        base, trail = str(own.extends.value), (*extending, address)
        refuse_deep(trail, own.extends.place)
        if base in trail:
            facts = {"extends": " -> ".join((*trail, base))}
            raise RecipeError("the recipe extends itself", code="DXB-R110", where=own.extends.place, facts=facts)
        found = self.recipe(base, trail)
        if found is None:
            message = f"no recipe is called `{base}`"
            raise RecipeError(message, code="DXB-R110", where=own.extends.place, hint="`dxb ls` shows all of them")
        return own.over(found)

    def _read(self, address: str) -> Recipe | None:
        from dextera_build.recipe.schema import read

        # Targets are written below a folder of the recipe's address, so that has one spelling.
        if {"", ".", ".."} & set(address.split("/")) or not address.isprintable():
            return None
        for folder in self.recipe_folders():
            file = folder / f"{address}.yaml"
            self._looked_at.add(str(file))
            # `Path.is_file` raises where a name is too long.
            if os.path.isfile(file) and file.resolve().is_relative_to(folder.resolve()):
                state = file.stat()
                # A recipe is asked for several times in one command; it is read once.
                place = (file, state.st_mtime_ns, state.st_size, state.st_ino)
                if place not in self._recipes:
                    self._recipes[place] = read(file, address, self.shown(file))
                return self._recipes[place]
        return None

    def looked_at(self) -> set[str]:
        """Files and folders that decided what its recipes mean; some of them are not there."""
        configuration = (settings.PYPROJECT, MARKER, "dxb.local.toml")
        return {*(str(self.root / name) for name in configuration), *self._looked_at, *self.library.looked_at()}

    def forget_recipes(self) -> None:
        """Let go of what was read: a plan holds all that a build needs, and a large recipe is large in memory."""
        self._recipes.clear()

    def recipes(self) -> Iterator[tuple[str, Path]]:
        """Every recipe: address and file."""
        from dextera_build.recipe.addresses import addresses

        yield from ((address, Path(file)) for address, file in addresses(map(str, self.recipe_folders())))

    def shown(self, path: Path) -> str:
        """A path as messages show it: relative where it lies below the current folder."""
        here = Path.cwd()
        return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)

    def _path(self, text: str) -> Path:
        """A path of the settings; unlike `Path.expanduser`, one of an unknown user is a name like any other."""
        return (self.root / os.path.expanduser(text)).absolute()

    def recipe_folders(self) -> list[Path]:
        """Where recipes lie, there or not; the project's own come first."""
        from dextera_build.code.loader import bundled

        return list(dict.fromkeys((self.root / "recipes", bundled("recipes"))))

    def _layers(self) -> Iterator[tuple[str, Mapping[str, Any]]]:
        own = [self.root / name for name in (settings.PYPROJECT, MARKER, "dxb.local.toml")]
        for file in (settings.user_folder() / "config.toml", *own):
            if file.is_file():
                yield self.shown(file), settings.read(file)
        said = {name: os.environ.get(f"DXB_{name.upper()}") for name in settings.DEFAULTS}
        yield _OVER[0], {name: value for name, value in said.items() if value}
        yield _OVER[1], self._flags


def find(start: Path | None = None, flags: Mapping[str, Any] | None = None) -> Project:
    """The project that `start` (the current folder) lies in; the folder itself where there is none.

    Raises:
        UsageError: The folder's path is not UTF-8, so that no log or record could name what lies there.
    """
    here = (start or Path.cwd()).absolute()
    try:
        os.fspath(here).encode()
    except UnicodeEncodeError:
        shown = os.fsencode(here).decode(errors="backslashreplace")
        hint = "rename the folder whose name shows \\x"
        raise UsageError(f"the path `{shown}` is not UTF-8", code="DXB-U194", hint=hint) from None
    for folder in (here, *here.parents):
        if _is_project(folder):
            return Project(folder, flags)
    return Project(here, flags, declared=False)


def deciding_files() -> list[str]:
    """Files that say to which project the current folder belongs and what its settings and pins are, there or not."""
    here = Path.cwd()
    found = [os.fspath(settings.user_folder() / "config.toml")]
    for folder in (here, *here.parents):
        found += [os.fspath(folder / name) for name in (MARKER, "dxb.local.toml", settings.PYPROJECT, LOCK)]
        if _is_project(folder):
            break
    return found


def _is_project(folder: Path) -> bool:
    return (folder / MARKER).is_file() or settings.declares(folder / settings.PYPROJECT)
