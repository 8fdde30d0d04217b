"""Resources for backends on the machine that plans a build."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from dextera_build.errors import RecipeError, install_extra
from dextera_build.models.catalogue import Models
from dextera_build.models.folders import ModelFolders
from dextera_build.models.licences import Licences

if TYPE_CHECKING:
    from dextera_build.rule import Backend


def _nothing(name: str) -> NoReturn:
    raise RecipeError(f"no model is called `{name}`", code="DXB-R213")


def _none() -> Models:
    return Models(_nothing, ModelFolders(()), Licences(Path("/dev/null")))


@dataclass(frozen=True)
class Machine:
    """Weights and devices for backends."""

    models: Models = field(default_factory=_none)
    gpu_gb: Callable[[], float] = lambda: 0.0
    """Memory of the largest GPU [GiB]: 0 for none, infinity if unknown. Called only for backends that need one."""

    def lacks(self, facts: Backend, absent: list[str]) -> dict[str, str]:
        """Requirements of a backend that this machine lacks -> the next step.

        Args:
            facts: The backend's declaration.
            absent: Distributions that it needs and that are not installed.

        Raises:
            RecipeError: It names weights that nothing describes.
        """
        step = install_extra(facts.extra) if facts.extra else f"`pip install {' '.join(absent)}`"
        found = dict.fromkeys(absent, step) | self.models.lacking(facts.weights)
        if facts.gpu_gb and not facts.cpu and self.gpu_gb() < facts.gpu_gb:
            found[f"a GPU with {facts.gpu_gb:g} GiB"] = "build on a machine that has one"
        return found

    def memory_gb(self, facts: Backend) -> float:
        """Main memory for the models of a backend [GiB]; 0 if they run on a GPU."""
        if self.device_gb(facts):
            return 0.0
        return sum(self.models.describe(name).memory_gb for name in facts.weights)

    def device_gb(self, facts: Backend) -> float:
        """GPU memory to reserve for a call [GiB]; 0 if it runs on the CPU."""
        return 0.0 if facts.cpu and self.gpu_gb() < facts.gpu_gb else facts.gpu_gb
