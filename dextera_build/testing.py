"""For authors of rules: runs one rule as the engine would, without a store on disk or a recipe."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.build.runner import ProjectReads, parted
from dextera_build.code.loader import Library, RuleFile
from dextera_build.engine import missing
from dextera_build.errors import Place
from dextera_build.recipe import profiles
from dextera_build.recipe.backends import Wish, choose
from dextera_build.recipe.calls import facts_of
from dextera_build.rule import Context, Outcome
from dextera_build.store.store import Store


class RuleRunner:
    """Runs rules on artifacts, with the encoding used by the store.

    Args:
        scratch: A folder for the rule's temporary files (`tmp_path` in pytest).
        project: A project whose rules are also available.
        keep: The folder for `ctx.keep`, removed after a successful call as in a build; None for one below `scratch`.
        calls: Answers `ctx.call`: a `Recorder` with a store, or a function that returns a service's answer.
        files: The folder that `ctx.read`, `ctx.glob` and `ctx.exists` search; None for that of `project`.
    """

    def __init__(
        self,
        scratch: str | Path,
        project: str | Path | None = None,
        keep: str | Path | None = None,
        calls: Callable[..., bytes] | None = None,
        files: str | Path | None = None,
    ) -> None:
        self._scratch = Path(scratch)
        self._keep = Path(keep or self._scratch / "keep")
        project = Path(project) if project is not None else None
        self._calls = calls
        self._library = Library(project)
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
        chosen = choose(found, wish, profiles.read(profile, self._library.project), where, fallback=False)
        if chosen is not None and chosen.missing:
            missing.refuse([facts_of(self._library, found, chosen)])
        rule = found.rule
        common, own = parted(found, chosen.backend.name if chosen else None, dict(options or {}))
        reads = ProjectReads(self._files, Store(self._scratch / "store")) if rule.discovers else None
        ctx = Context(
            chosen.backend.module if chosen else None,
            own,
            scratch=self._scratch,
            keep=self._keep,
            calls=self._calls,
            reads=reads,
        )
        keyword = {"options": common} if rule.takes_options else {}
        result = rule(ctx, **inputs, **keyword)
        self.outcome = ctx.outcome
        self.reads = reads.finish() if reads is not None else []
        shutil.rmtree(self._keep, ignore_errors=True)
        return type(result).decode(self.encode(result), self._blobs.__getitem__)

    def encode(self, artifact: Artifact) -> str:
        """Digest of an artifact; equal artifacts have equal digests."""
        return artifact.encode(self._put)

    def _put(self, data: bytes) -> str:
        key = digest.of_bytes(data)
        self._blobs[key] = data
        return key
