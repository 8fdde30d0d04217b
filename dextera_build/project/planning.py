"""Plans a request of a project: takes the plan of an earlier command, or resolves the recipe and keeps the plan."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

from dextera_build.calls import secrets
from dextera_build.errors import DxbError, Place, UsageError, did_you_mean, nearest
from dextera_build.project.project import LOCK, Project

# A no-op build loads none of these.
if TYPE_CHECKING:
    from dextera_build.project.lockfile import Bindings
    from dextera_build.recipe.kept import Kept, Plans
    from dextera_build.recipe.plan import Plan
    from dextera_build.store.signature import Watch


@dataclass(frozen=True)
class Added:
    """Additions of a request to a recipe, as written."""

    inputs: Mapping[str, str] = field(default_factory=dict)
    """Input of the recipe -> path, or target of another recipe."""
    settings: tuple[str, ...] = ()
    """`body[mug].mesh.primitives.wall_m=0.004`."""
    backends: Mapping[str, str] = field(default_factory=dict)
    """Rule -> backend."""

    def __post_init__(self) -> None:
        """Refuse secrets, because options enter keys.

        Raises:
            RecipeError: A setting holds one.
        """
        for setting in self.settings:
            secrets.refuse_written(setting, f"--set {setting.partition('=')[0]}")

    def __bool__(self) -> bool:
        return bool(self.inputs or self.settings or self.backends)


class Planning:
    """Plans one request.

    Args:
        project: The project.
        recipe: The recipe's address.
        added: Additions of the request.
        names: Names that `dxb.lock` binds, by node.
        reads: Read all sources also if the plan is that of an earlier command, because workers may run them.
    """

    def __init__(self, project: Project, recipe: str, added: Added, names: Bindings, *, reads: bool) -> None:
        self._project, self._recipe, self._added, self._names, self._reads = project, recipe, added, names, reads
        self._recalled: Kept | None = None
        self._has_looked = False
        """Whether the next `plan` need not look for the plan of an earlier command."""

    def recall(self, watch: Watch | None = None) -> bool:
        """Take the plan of an earlier command if planning would give it again; the next `plan` returns it."""
        self._recalled = self._kept.find(watch, reads=self._reads) if self._kept is not None else None
        self._has_looked = True
        return self._recalled is not None

    def plan(self, *, incomplete: bool = False, watch: Watch | None = None) -> Kept:
        """The plan and its warnings; see `Session.plan`."""
        if not self._has_looked:
            self.recall(watch)
        found, self._recalled, self._has_looked = self._recalled, None, False
        return found or self.resolve(incomplete=incomplete, watch=watch)

    def resolve(self, *, incomplete: bool = False, watch: Watch | None = None) -> Kept:
        """The plan, resolved again and kept for later commands."""
        from dextera_build.code.distributions import note_packages
        from dextera_build.recipe import settings
        from dextera_build.recipe.kept import Kept, is_lasting
        from dextera_build.recipe.plan import Request, plan
        from dextera_build.store.signature import Watch
        from dextera_build.store.store import Store

        project, added, own = self._project, self._added, Watch()
        if project.recipe(self._recipe) is None:
            raise no_recipe(project, self._recipe)
        texts = map(settings.parse, added.settings)
        names = {node.removeprefix(f"{self._recipe}:"): bound for node, bound in self._names.items()}
        lock = Place(project.shown(project.root / LOCK))
        request = Request(project.preferences, added.inputs, tuple(texts), added.backends, incomplete, names, lock)
        project.library.warnings.clear()  # those of other recipes
        with project.library.code.kept_in(Store(project.cache, make=False).state):
            made = plan(self._recipe, project.recipe, project.library, project.root, request)
        project.forget_recipes()
        found, looked_at = Kept(made, list(project.library.warnings.values())), project.looked_at()
        if watch is not None:
            _note(watch, made, looked_at)
        if self._kept is not None and is_lasting(made) and not project.looked_for_gpus:
            own.started_ns = min(own.started_ns, project.library.since_ns)
            note_packages(own, doubts=True)
            _note(own, made, looked_at)
            self._kept.keep(found, own)
        return found

    @cached_property
    def _kept(self) -> Plans | None:
        """The plans that earlier commands kept of this request; None if machines of a cluster need the code."""
        from dextera_build.recipe.kept import Plans
        from dextera_build.store.store import Store

        project = self._project
        if project.executor.startswith("ray"):
            return None
        request = (str(project.root), self._recipe, self._added, project.profile, project.model_folders, self._names)
        return Plans(Store(project.cache, make=False).state, request)


def _note(watch: Watch, plan: Plan, looked_at: Iterable[str]) -> None:
    """Add the files that planning read: recipes, code, configuration, and folders in which new files may appear."""
    from dextera_build.code.modules import was_read
    from dextera_build.recipe.kept import note_absent

    recipes = {str(path) for path in plan.recipes}
    for path in (*recipes, *looked_at):
        if os.path.isdir(path):
            watch.folder(path)
        else:
            watch.file(path)
        watch.doubt(path, was_read=path in recipes or was_read(path))
    note_absent(plan, watch)


def refuse_unknown(project: Project, name: str) -> None:
    """Raise `no_recipe` if no recipe has this address; for verbs that read without planning."""
    if project.recipe(name) is None:
        raise no_recipe(project, name)


def inputs_to_give(project: Project, name: str) -> str:
    """` --input NAME=PATH` for each input of a recipe that must be given; "" for none, and if the recipe is wrong."""
    with suppress(DxbError):
        found = project.recipe(name)
        inputs = found.inputs if found is not None else {}
        needed = [each for each, decl in inputs.items() if decl.default is None and not decl.optional]
        return "".join(f" --input {each}=PATH" for each in needed)
    return ""


def no_recipe(project: Project, name: str) -> UsageError:
    """The error for a recipe that does not exist."""
    known = [address for address, _ in project.recipes()]
    near = nearest(name, known, 8, cutoff=0.5)
    return UsageError(
        f"no recipe is called `{name}`",
        code="DXB-U108",
        facts={
            **({"the nearest": ", ".join(near)} if near else {}),
            "recipes": f"{len(known)}, `dxb ls` shows all of them",
        },
        hint=did_you_mean(name, known),
    )
