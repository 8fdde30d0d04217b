"""For authors of rules: runs one rule as the engine would, without a store on disk or a recipe."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.building import examples
from dextera_build.code.companions import of_paths
from dextera_build.code.loader import Library, RuleFile
from dextera_build.code.machine import Machine
from dextera_build.engine import missing
from dextera_build.errors import Place
from dextera_build.models.catalogue import Models, folder_of
from dextera_build.models.folders import ModelFolders
from dextera_build.models.licences import Licences
from dextera_build.recipe import models, profiles
from dextera_build.recipe.backends import Wish, choose
from dextera_build.recipe.calls import facts_of
from dextera_build.rule import Context, Outcome
from dextera_build.rule.pretrained import Pretrained
from dextera_build.running.called import as_called, named, only_keyed, others, running
from dextera_build.running.runner import ProjectReads, outside, parted
from dextera_build.store.store import Store

_MODELS = "models"


class RuleRunner:
    """Runs rules on artifacts, with the encoding used by the store.

    Args:
        scratch: A folder for the rule's temporary files (`tmp_path` in pytest).
        project: A project whose rules are also available.
        keep: The folder for `ctx.keep`, removed after a successful call as in a build; None for one below `scratch`.
        calls: Answers `ctx.call`: a `Recorder` with a store, or a function that returns a service's answer.
        files: The folder that `ctx.read`, `ctx.glob` and `ctx.exists` search; None for that of `project`.
        weights: Model -> folder with its files, copied to the scratch folder as if they had been installed.
        gpu_gb: Memory of this machine's assumed GPU [GiB]; a backend that needs one gets the device `cuda`.
        made_by: Slot -> path of the rule that made its artifact, `{"checkpoint": "learn.act"}`, for rules that run
            it; in a build the recipe has this. A `TaskBundle` names its primitive itself.
    """

    def __init__(
        self,
        scratch: str | Path,
        project: str | Path | None = None,
        keep: str | Path | None = None,
        calls: Callable[..., bytes] | None = None,
        files: str | Path | None = None,
        weights: Mapping[str, str | Path] | None = None,
        gpu_gb: float = 0.0,
        made_by: Mapping[str, str] | None = None,
    ) -> None:
        self._scratch = Path(scratch)
        self._keep = Path(keep or self._scratch / "keep")
        project = Path(project) if project is not None else None
        self._calls = calls
        self._made_by = dict(made_by or {})
        self._library = Library(project, self._machine(project, weights or {}, gpu_gb))
        self._blobs: dict[str, bytes] = {}
        self.outcome = Outcome()
        """Line, previews and metrics of the last call."""
        self._files = Path(files or project or scratch)
        self.reads: list[list[str]] = []
        """Discovered inputs of the last call: (`file`, `there` or `names`, question, answer), in order."""

    def find(self, path: str) -> RuleFile:
        """The rule called `path`."""
        return self._library.find(path)

    def run(
        self,
        path: str,
        *,
        backend: str | None = None,
        profile: str = "cpu",
        options: Mapping[str, Any] | None = None,
        **inputs: Artifact,
    ) -> Any:
        """Call a rule and return its artifact as a later rule would receive it.

        Raises:
            DxbError: The rule is unknown, refuses its inputs, or fails one of its checks.
        """
        found = self.find(path)
        where = Place("RuleRunner.run")
        wish = Wish((backend,), "the caller", where) if backend is not None else None
        prefers = profiles.read(profile, self._library.project)
        chosen = choose(found, wish, prefers, where, self._library.machine, fallback=False)
        companions = of_paths(self._library, self._run_by(found, options or {}, inputs))
        facts = facts_of(self._library, found, chosen, companions)
        if facts.missing:
            missing.refuse([facts])
        rule = found.rule
        common, own = parted(found, chosen.backend.name if chosen else None, dict(options or {}))
        reads = ProjectReads(self._files, Store(self._scratch / "store")) if rule.discovers else None
        ctx = Context(
            as_called(found, facts.backend),
            own,
            scratch=self._scratch,
            keep=self._keep,
            calls=self._calls,
            reads=reads,
            pretrained=Pretrained(
                facts.weights,
                partial(folder_of, [self._scratch / _MODELS]),
                "cuda" if facts.gpu_gb else "cpu",
                program=outside(found, facts.backend, facts.program),
                others=others(found, facts.backend),
            ),
            companions=running(companions),
            named=named(found, options or {}),
        )
        keyword = {"options": common} if rule.takes_options else {}
        with only_keyed(companions):
            result = rule(ctx, **inputs, **keyword)
        self.outcome = ctx.outcome
        self.reads = reads.finish() if reads is not None else []
        shutil.rmtree(self._keep, ignore_errors=True)
        return type(result).decode(self.encode(result), self._blobs.__getitem__)

    def _run_by(
        self, found: RuleFile, options: Mapping[str, Any], inputs: Mapping[str, Artifact]
    ) -> dict[str, list[str]]:
        """Slot -> paths of the companions that run its artifact; option -> path of the file in its folder."""
        from dextera_build.artifacts.tasks.task import TaskBundle

        tasks = {slot: each for slot, each in inputs.items() if isinstance(each, TaskBundle)}
        makers = {slot: f"primitives/{bundle.task.primitive}" for slot, bundle in tasks.items()} | self._made_by
        runs = {slot: stems for slot, stems in found.rule.runs.items() if slot in makers}
        folders = {option: f"{folder}/{options[option]}" for option, folder in found.rule.folders.items()}
        return {
            **{slot: [f"{makers[slot]}/{stem}" for stem in stems] for slot, stems in runs.items()},
            **{option: [f"{folder}/{option}"] for option, folder in folders.items()},
        }

    def example(self, path: str) -> tuple[dict[str, Artifact], dict[str, Any]]:
        """Inputs and options of a rule, as the first recipe that calls it gives them with the profile `stub`.

        Recipes of the project come first, then those of dxb; a recipe that needs inputs of its own is passed over. The
        nodes before the call are built in the scratch folder, which takes seconds to minutes.

        Returns:
            Slot -> artifact, and the options of the rule without those of its backends.

        Raises:
            UsageError: No recipe calls the rule.
            DxbError: The build of the example failed.
        """
        return examples.of(self.find(path), self._library.project, self._scratch / "example")

    def _machine(self, project: Path | None, weights: Mapping[str, str | Path], gpu_gb: float) -> Machine:
        """A machine that has the given weights, with their licences accepted."""
        found = Models(
            lambda name: models.read(name, project),
            ModelFolders([self._scratch / _MODELS]),
            Licences(self._scratch / "licences.json"),
        )
        for name, folder in weights.items():
            found.folders.install(name, partial(_copied, folder))
            found.licences.accept(found.describe(name))
        return Machine(found, lambda: gpu_gb)

    def encode(self, artifact: Artifact) -> str:
        """Digest of an artifact; equal artifacts have equal digests."""
        return artifact.encode(self._put)

    def _put(self, data: bytes) -> str:
        key = digest.of_bytes(data)
        self._blobs[key] = data
        return key


def _copied(folder: str | Path, target: Path) -> str:
    shutil.copytree(folder, target, dirs_exist_ok=True)
    return "a test"
