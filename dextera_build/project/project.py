"""The project folder: its recipes, its rules, its store, and its settings with their origins."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dextera_build.calls import secrets
from dextera_build.errors import Place, RecipeError, UsageError, did_you_mean, listing
from dextera_build.project import settings
from dextera_build.project.remotes_table import Choice
from dextera_build.remotes.spec import Spec

if TYPE_CHECKING:
    # A no-op build reads settings but no recipe, and must not wait for these imports.
    from dextera_build.code.loader import Library
    from dextera_build.code.machine import Machine
    from dextera_build.models.model import Model
    from dextera_build.project.lockfile import Lock
    from dextera_build.recipe.profiles import Profile
    from dextera_build.recipe.schema import Recipe
    from dextera_build.workers.capacity import Capacity

MARKER = "dxb.toml"
LOCK = "dxb.lock"
_OVER = ("environment", "command line")  # origins that are not files
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
        flags: Settings from the command line; they take precedence over everything else.
        declared: False if no project was found and the current folder is used instead.
    """

    def __init__(self, root: str | Path, flags: Mapping[str, Any] | None = None, *, declared: bool = True) -> None:
        self.root = Path(root)
        self.declared = declared
        self._recipes: dict[tuple[Path, int, int, int, int], Recipe] = {}
        self._looked_at: set[str] = set()
        self.looked_for_gpus = False
        """Whether planning asked for the GPUs of this machine."""
        self.remotes = Choice(self.root)
        """The remotes; filled in by `config`."""
        self._flags = {name: value for name, value in (flags or {}).items() if value is not None}

    @cached_property
    def config(self) -> dict[str, Setting]:
        """Every setting: flags > `DXB_*` > `dxb.local.toml` > project > user > defaults."""
        secrets.hide_own()
        found = {name: Setting(value, "default") for name, value in settings.DEFAULTS.items()}
        home = os.path.expanduser(os.environ.get("XDG_CACHE_HOME", "~/.cache"))
        found["models"] = Setting(f"{home}/dxb/models", "default")
        if not self.declared:
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
            if name != "profile" or not self._has_profile(str(setting.value)):
                settings.choose(name, setting.value, setting.origin)
        del found["remotes"]
        return found | {name: Setting(value, origin) for name, (value, origin) in self.remotes.rows().items()}

    @staticmethod
    def _over(found: Mapping[str, Setting], name: str, value: Any, origin: str) -> Any:
        """A setting's value merged over that of lower layers; resources and services are merged by name."""
        if name == "services":
            from dextera_build.calls.services import over

            return over(found[name].value, value, origin)
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

    def _has_profile(self, name: str) -> bool:
        """Whether a profile is the project's own."""
        return settings.is_profile(name) and (self.root / "recipes" / "profile" / f"{name}.yaml").is_file()

    @property
    def preferences(self) -> Profile:
        """The backends that the profile in force prefers."""
        from dextera_build.recipe import profiles

        profile = profiles.read(self.profile, self.root, self.shown)
        self._looked_at.update(map(str, profile.files))
        return profile

    @property
    def own_profile(self) -> str:
        """The profile set in files, regardless of the environment and the command line."""
        if self.config["profile"].origin not in _OVER:
            return self.profile
        named = [values["profile"] for origin, values in self._layers() if "profile" in values and origin not in _OVER]
        return str(named[-1] if named else settings.DEFAULTS["profile"])

    @property
    def jobs(self) -> int:
        """Cores for nodes; 0 in the settings means every core available to this process."""
        return int(self.config["jobs"].value) or len(os.sched_getaffinity(0))

    @property
    def executor(self) -> str:
        """Where nodes run: `local`, `ray`, or `ray:HOST:PORT`."""
        return str(self.config["executor"].value)

    @property
    def console(self) -> str:
        """The console of a build; `auto` chooses between `live` and `plain`."""
        return str(self.config["console"].value)

    def capacity(self, *, gpus: bool) -> Capacity:
        """Resources of this machine, measured or from the settings; `gpus`: look for devices."""
        from dextera_build.workers.capacity import measure

        said = dict(self.config["resources"].value)
        if self.config["jobs"].origin in _OVER:
            said.pop("cpu", None)
        return measure(self.jobs, said, gpus=gpus)

    @property
    def durable(self) -> bool:
        """Whether a build waits until its results are flushed to disk."""
        return settings.is_on(self.config["durable"].value)

    @property
    def calls(self) -> str:
        """How calls of services are treated; see `calls.recorder.Recorder`."""
        return str(self.config["calls"].value)

    @property
    def max_cost(self) -> float | None:
        """The most that the calls of one command may cost [USD]; None: no limit."""
        text = str(self.config["max_cost"].value)
        return float(text) if text and text != "none" else None

    @property
    def asks_again(self) -> bool:
        """Whether nodes with recorded calls run even if nothing changed."""
        return self.calls in ("refresh", "replace")

    @property
    def trusted_keys(self) -> list[Path]:
        """Files and folders with the public keys of trusted signers.

        Raises:
            UsageError: A path in the settings does not exist.
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
        """Whether results from elsewhere are refused unless a trusted key signed them."""
        return settings.is_on(self.config["require_signed"].value)

    @property
    def used_remotes(self) -> list[Spec]:
        """The remotes that a build uses, in lookup order; raises the errors of `allowed`."""
        return self.allowed(self.remotes.used if self.config else [])

    def allowed(self, remotes: list[Spec]) -> list[Spec]:
        """Return `remotes` if the settings allow their use.

        Raises:
            UsageError: Signatures are required, and unsigned results of one of the remotes would be read.
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

        return Library(self.root, self.machine)

    @cached_property
    def machine(self) -> Machine:
        """The weights and devices of this machine, looked for when a backend needs them."""
        from dextera_build.code.machine import Machine
        from dextera_build.models.catalogue import Models
        from dextera_build.models.folders import ModelFolders
        from dextera_build.models.licences import Licences

        folders = ModelFolders(self.model_folders)
        licences = Licences(settings.user_folder() / "licences.json")
        return Machine(Models(cache(self.model), folders, licences), self._gpu_gb)

    def model(self, name: str) -> Model:
        """The description of a model.

        Raises:
            RecipeError: There is none of this name, or it is wrong.
        """
        from dextera_build.recipe import models

        self._looked_at.update(str(folder / f"{name}.yaml") for folder in models.folders(self.root))
        return models.read(name, self.root, self.shown)

    @property
    def model_folders(self) -> tuple[Path, ...]:
        """Folders with the weights of models; new ones go into the first."""
        value = self.config["models"].value
        named = value if isinstance(value, list) else str(value).split(os.pathsep)
        return tuple(self._path(str(name)) for name in named if name)

    def _gpu_gb(self) -> float:
        """Memory of the largest GPU [GiB]; infinity if it is not known before the build."""
        self.looked_for_gpus = True
        if self.executor.startswith("ray"):
            return math.inf  # the cluster places the call
        return max((gpu.memory_gb or math.inf for gpu in self.capacity(gpus=True).gpus), default=0.0)

    def recipe(self, address: str, extending: tuple[str, ...] = ()) -> Recipe | None:
        """The recipe of an address with the recipes that it extends, or None; the project's own come first.

        Raises:
            RecipeError: It is wrong, or extends itself or a recipe that does not exist.
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

        # Targets are written to a folder named by the address, so each recipe has only one spelling.
        if {"", ".", ".."} & set(address.split("/")) or not address.isprintable():
            return None
        for folder in self.recipe_folders():
            file = folder / f"{address}.yaml"
            self._looked_at.add(str(file))
            # `Path.is_file` raises if a name is too long.
            if os.path.isfile(file) and file.resolve().is_relative_to(folder.resolve()):
                state = file.stat()
                # One command looks a recipe up several times; it is read once.
                place = (file, state.st_mtime_ns, state.st_ctime_ns, state.st_size, state.st_ino)
                if place not in self._recipes:
                    self._recipes[place] = read(file, address, self.shown(file))
                return self._recipes[place]
        return None

    def lock(self) -> Lock | None:
        """The content of `dxb.lock`, or None if there is no such file.

        Raises:
            RecipeError: It is not valid.
        """
        path = self.root / LOCK
        if not path.exists():  # avoids the import in projects without a lock file
            return None
        from dextera_build.project import lockfile

        return lockfile.read(path, self.shown(path))

    def looked_at(self) -> set[str]:
        """Files and folders that determined the meaning of its recipes, including ones that do not exist."""
        configuration = (settings.PYPROJECT, MARKER, "dxb.local.toml")
        return {*(str(self.root / name) for name in configuration), *self._looked_at, *self.library.looked_at()}

    def forget_recipes(self) -> None:
        """Free the recipes read: a plan holds everything that a build needs, and large recipes take much memory."""
        self._recipes.clear()

    def recipes(self) -> Iterator[tuple[str, Path]]:
        """Every recipe: address and file."""
        from dextera_build.recipe.addresses import addresses

        yield from ((address, Path(file)) for address, file in addresses(map(str, self.recipe_folders())))

    def shown(self, path: Path) -> str:
        """A path as messages show it: relative if it is below the current folder."""
        here = Path.cwd()
        return str(path.relative_to(here)) if path.is_relative_to(here) else str(path)

    def _path(self, text: str) -> Path:
        """A path from the settings; unlike in `Path.expanduser`, `~` with an unknown user is kept as a plain name."""
        return (self.root / os.path.expanduser(text)).absolute()

    def recipe_folders(self) -> list[Path]:
        """Folders of recipes, existing or not, the project's own first."""
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
    """The project that contains `start` (the current folder); the folder itself if there is none.

    Raises:
        UsageError: The folder's path is not UTF-8, so logs and records could not name its files.
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
    """Files, existing or not, that determine the project of the current folder, its settings and its pins."""
    here = Path.cwd()
    found = [os.fspath(settings.user_folder() / "config.toml")]
    for folder in (here, *here.parents):
        found += [os.fspath(folder / name) for name in (MARKER, "dxb.local.toml", settings.PYPROJECT, LOCK)]
        if _is_project(folder):
            break
    return found


def _is_project(folder: Path) -> bool:
    return (folder / MARKER).is_file() or settings.declares(folder / settings.PYPROJECT)
