"""References to pretrained models, and low-rank adapters of them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from pydantic import Field, PositiveFloat, PositiveInt, model_validator

from dextera_build import digest
from dextera_build.artifacts.base import Artifact
from dextera_build.artifacts.formats import unreadable
from dextera_build.artifacts.weights import Tensor, Weights
from dextera_build.errors import ArtifactError, listing

_DIGEST = "^[0-9a-f]{64}$"
_CONFIG, _ADAPTER, _TENSORS = "config.json", "adapter_config.json", "adapter_model.safetensors"
_DOWN, _UP = ".lora_A.weight", ".lora_B.weight"
_PREFIX = "base_model.model."
"""Prefix of the names of modules in files of PEFT."""
_BASE = "dxb_base"
"""Note in the header of an adapter's file: the digest of its base."""


class PretrainedModel(Artifact):
    """A pretrained model: its exact identity and its configuration."""

    reference: str = Field(min_length=1)
    """`hf:OWNER/NAME@REVISION`, an address, or its name in `dxb models`."""
    digest: str = Field(pattern=_DIGEST)
    """SHA-256 of the canonical JSON of `[[path, size, sha256], ...]` of its files, as shown by `dxb models`."""
    config: dict[str, Any]
    """The model's `config.json`."""
    weights: Weights | None = None
    """Its weights; None if the model is only a reference."""

    @classmethod
    def load(cls, folder: str | Path, reference: str) -> PretrainedModel:
        """The model in a folder with `config.json` and safetensors; all of its files are included in the digest.

        Raises:
            ArtifactError: A file is missing, damaged or may contain a pickle.
        """
        folder = Path(folder)
        paths = sorted(path for path in folder.rglob("*") if path.is_file())
        rows = [[path.relative_to(folder).as_posix(), path.stat().st_size, digest.of_file(path)] for path in paths]
        return cls(
            reference=reference,
            digest=digest.of_value(sorted(rows)),
            config=_json(folder / _CONFIG),
            weights=Weights.load(folder),
        )

    def facts(self) -> Iterator[str]:
        """Reference, digest, architecture, and the weights if it has them."""
        yield self.reference
        yield self.digest[:12]
        names = self.config.get("architectures") or [self.config.get("model_type")]
        yield from (str(name) for name in names if name)
        yield from self.weights.facts() if self.weights is not None else ("weights by reference",)

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write `config.json`, and the weights next to it if available, as expected by `from_pretrained`."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        written = [folder / _CONFIG]
        written[0].write_text(json.dumps(self.config, indent=2, sort_keys=True) + "\n")
        return [*written, *(self.weights.export(folder, stem) if self.weights is not None else [])]


class _Pair(NamedTuple):
    down: str
    up: str


class Adapter(Artifact):
    """A low-rank adapter of a model (LoRA, Hu et al. 2021): W + alpha / rank * B A for some of its matrices."""

    base: str = Field(pattern=_DIGEST)
    """`PretrainedModel.digest` of its only base model."""
    base_reference: str
    """`reference` of the base, for readers and other programs."""
    weights: Weights
    """`MODULE.lora_A.weight` (rank, inputs) and `MODULE.lora_B.weight` (outputs, rank), named as PEFT does."""
    rank: PositiveInt
    """Rank of the change."""
    alpha: PositiveFloat
    """Its strength; the update is scaled by alpha / rank."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        known = self.weights.tensors
        strange = [name for name in known if not name.endswith((_DOWN, _UP))]
        lonely = [
            f"{module}{end}" for module in self._modules() for end in (_DOWN, _UP) if f"{module}{end}" not in known
        ]
        if strange or lonely or not known:
            facts = {"unknown": listing(strange, 4), "missing": listing(lonely, 4)}
            raise ArtifactError(
                "the tensors of an adapter are not pairs of `lora_A.weight` and `lora_B.weight`",
                code="DXB-A415",
                facts={name: text for name, text in facts.items() if text != "none"},
                hint="only low-rank changes of matrices are adapters here; store others as `Weights`",
            )
        for pair in self._modules().values():
            self._check_pair(known[pair.down], known[pair.up], pair)
        return self

    def _check_pair(self, down: Tensor, up: Tensor, pair: _Pair) -> None:
        if len(down.shape) != 2 or len(up.shape) != 2 or down.shape[0] != self.rank or up.shape[1] != self.rank:
            raise ArtifactError(
                f"`{pair.down}` is {down.shape} and `{pair.up}` is {up.shape}, but the rank is {self.rank}",
                code="DXB-A415",
                hint="A is (rank, inputs), B is (outputs, rank)",
            )

    def _modules(self) -> dict[str, _Pair]:
        names = {name.removesuffix(_DOWN).removesuffix(_UP) for name in self.weights.tensors}
        return {name: _Pair(f"{name}{_DOWN}", f"{name}{_UP}") for name in sorted(names)}

    @property
    def modules(self) -> tuple[str, ...]:
        """Names of the changed modules in the base."""
        return tuple(name.removeprefix(_PREFIX) for name in self._modules())

    def facts(self) -> Iterator[str]:
        """Base, rank, alpha and number of changed modules."""
        yield f"of {self.base_reference} ({self.base[:12]})"
        yield f"rank {self.rank}"
        yield f"alpha {self.alpha:g}"
        yield f"{len(self.modules):,} modules"
        yield f"{self.weights.parameters:,} parameters"

    def check_base(self, model: PretrainedModel) -> None:
        """Raise for a model that is not the base of this adapter.

        Raises:
            ArtifactError: Its digest differs, or its weights lack an adapted matrix of this shape.
        """
        facts = {
            "adapter": f"{self.base_reference} {self.base[:12]}",
            "model": f"{model.reference} {model.digest[:12]}",
        }
        if model.digest != self.base:
            raise ArtifactError(
                "the adapter belongs to another model", code="DXB-A416", facts=facts, hint="use the model that it names"
            )
        for name, pair in self._modules().items() if model.weights is not None else ():
            known = self.weights.tensors
            shape = (known[pair.up].shape[0], known[pair.down].shape[1])
            matrix = model.weights.tensors.get(f"{name.removeprefix(_PREFIX)}.weight") if model.weights else None
            if matrix is None or matrix.shape != shape:
                found = "none" if matrix is None else str(matrix.shape)
                raise ArtifactError(
                    f"the adapter changes `{name.removeprefix(_PREFIX)}.weight` {shape}, which the model does not have",
                    code="DXB-A416",
                    facts={**facts, "the model has": found},
                )

    def delta(self, module: str) -> np.ndarray:
        """Alpha / rank * B A of a module, (outputs, inputs) float32, to be added to its `weight`.

        Raises:
            ArtifactError: The adapter does not change this module.
        """
        name = module if module in self._modules() else f"{_PREFIX}{module}"
        up, down = (self.weights.array(f"{name}{end}").astype(np.float32) for end in (_UP, _DOWN))
        return np.asarray(np.float32(self.alpha / self.rank) * (up @ down))

    @classmethod
    def load(cls, folder: str | Path, base: PretrainedModel) -> Adapter:
        """Read an adapter in the layout of PEFT: `adapter_config.json` and `adapter_model.safetensors`.

        Raises:
            ArtifactError: A file is damaged, the adapter is no plain LoRA, or it names another base.
        """
        folder = Path(folder)
        said, weights = _json(folder / _ADAPTER), Weights.load(folder / _TENSORS)
        odd = [
            name
            for name in ("use_dora", "use_rslora", "rank_pattern", "alpha_pattern", "modules_to_save")
            if said.get(name)
        ]
        if said.get("peft_type") != "LORA" or said.get("bias", "none") != "none" or odd:
            why = f"it is {said.get('peft_type')} with {listing(odd) if odd else 'biases'}, not plain LoRA"
            raise unreadable(folder / _ADAPTER, "a LoRA adapter", why)
        try:
            rank, alpha = int(said["r"]), float(said["lora_alpha"])
        except (KeyError, TypeError, ValueError) as error:
            raise unreadable(folder / _ADAPTER, "a LoRA adapter", f"no number {error}") from None
        named = weights.notes.get(_BASE, base.digest)
        made = cls(base=named, base_reference=base.reference, weights=weights, rank=rank, alpha=alpha)
        made.check_base(base)
        return made

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write `adapter_config.json` and `adapter_model.safetensors` as in PEFT, the base's digest in the latter."""
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        config = {
            "peft_type": "LORA",
            "base_model_name_or_path": self.base_reference.removeprefix("hf:").partition("@")[0],
            "r": self.rank,
            "lora_alpha": self.alpha,
            "target_modules": sorted(self.modules),
            "lora_dropout": 0.0,
            "bias": "none",
        }
        (folder / _ADAPTER).write_text(json.dumps(config, indent=2, sort_keys=True) + "\n")
        noted = self.weights.noted({**self.weights.notes, "format": "pt", _BASE: self.base})
        return [folder / _ADAPTER, *noted.save(folder / _TENSORS)]


def _json(path: Path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text("utf-8"))
        if not isinstance(found, dict):
            raise ValueError("it is no object")
    except (OSError, ValueError) as error:
        raise unreadable(path, "JSON", error) from None
    return found
