"""Weights of networks in safetensors files, optionally sharded with Hugging Face's index."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import BinaryIO, ClassVar, Literal, Self

import numpy as np
from pydantic import Field, NonNegativeInt, model_validator

from dextera_build.artifacts import tensors as files
from dextera_build.artifacts.base import Artifact, File, Value
from dextera_build.artifacts.describe import size as size_text
from dextera_build.artifacts.formats import unreadable
from dextera_build.errors import ArtifactError, did_you_mean, listing

_FORM = "safetensors"
_PICKLES = (".bin", ".pt", ".pth", ".ckpt", ".pkl", ".pickle")
INDEX = ".safetensors.index.json"
"""Suffix of the file that maps tensors to shards."""
SHARD_BYTES = 5_000_000_000
"""Maximum size of a shard made by `Weights.of`, unless one tensor is larger [bytes]."""


Kind = Literal[
    "BOOL", "U8", "I8", "F8_E5M2", "F8_E4M3", "U16", "I16", "F16", "BF16", "U32", "I32", "F32", "U64", "I64", "F64"
]
"""Numeric types, as in safetensors: the keys of `tensors.BITS`."""


class Tensor(Value):
    """One tensor of weights."""

    dtype: Kind
    """Type of its numbers, as in safetensors."""
    shape: tuple[NonNegativeInt, ...]
    """Its sizes; () for a single number."""
    shard: str
    """Its file."""

    @property
    def bytes(self) -> int:
        """Its size [bytes]."""
        return math.prod(self.shape) * files.BITS[self.dtype] // 8


class Weights(Artifact):
    """Tensors by name. Large files stay in the store until they are used."""

    saves: ClassVar[tuple[str, ...]] = (".safetensors", ".json")

    shards: dict[str, File]
    """File name -> safetensors file: `model.safetensors`, or `model-00001-of-00002.safetensors`, ..."""
    tensors: dict[str, Tensor] = Field(min_length=1)
    """Name -> type, shape and file, as stated in the files."""
    notes: dict[str, str] = Field(default_factory=dict)
    """Plain text in the header of the files: `format: pt`."""

    @model_validator(mode="after")
    def _check(self) -> Self:
        wrong = [name for name in self.shards if "/" in name or not name.endswith(".safetensors")]
        if wrong:
            raise ArtifactError(
                f"Weights.shards: {wrong[0]!r} is no name of a safetensors file",
                code="DXB-A411",
                hint="a name has no folder and ends in `.safetensors`",
            )
        used = {tensor.shard for tensor in self.tensors.values()}
        if used != self.shards.keys():
            raise ArtifactError(
                f"the tensors are in {listing(used)}, but the shards are {listing(self.shards)}", code="DXB-A411"
            )
        return self

    def facts(self) -> Iterator[str]:
        """Tensors, parameters, types of numbers, files and their size."""
        yield f"{len(self.tensors):,} tensors"
        yield f"{self.parameters:,} parameters"
        yield from sorted({tensor.dtype for tensor in self.tensors.values()})
        yield f"{len(self.shards)} files" if len(self.shards) != 1 else "1 file"
        yield size_text(self.bytes)

    @property
    def parameters(self) -> int:
        """Number of numbers."""
        return sum(math.prod(tensor.shape) for tensor in self.tensors.values())

    @property
    def bytes(self) -> int:
        """Size of all tensors."""
        return sum(tensor.bytes for tensor in self.tensors.values())

    def array(self, name: str) -> np.ndarray:
        """One tensor, read separately; BF16 as float32.

        Raises:
            ArtifactError: There is no such tensor, NumPy has no such type, or its file contradicts the index.
        """
        if name not in self.tensors:
            raise ArtifactError(
                f"the weights have no tensor `{name}`", code="DXB-A412", hint=did_you_mean(name, self.tensors)
            )
        tensor = self.tensors[name]
        try:
            with self.shards[tensor.shard].open() as file:
                span = self._spans(tensor.shard)[name]
                if (span.dtype, span.shape) != (tensor.dtype, tensor.shape):
                    raise ValueError(f"tensor `{name}` is not as the weights say")
                return files.array(b"".join(files.pieces(file, span)), span.dtype, span.shape)
        except ValueError as error:
            raise unreadable(tensor.shard, _FORM, error) from None

    @classmethod
    def of(
        cls, arrays: Mapping[str, np.ndarray], notes: Mapping[str, str] | None = None, shard_bytes: int = SHARD_BYTES
    ) -> Weights:
        """Arrays by name as weights, split into files of at most `shard_bytes`; equal arrays give equal files.

        Raises:
            ArtifactError: The format has no such type.
        """
        groups: list[dict[str, np.ndarray]] = [{}]
        for name in sorted(arrays):
            if groups[-1] and sum(array.nbytes for array in groups[-1].values()) + arrays[name].nbytes > shard_bytes:
                groups.append({})
            groups[-1][name] = arrays[name]
        shards: dict[str, File] = {}
        tensors: dict[str, Tensor] = {}
        for number, group in enumerate(groups):
            file = _shard_name(number, len(groups))
            try:
                kinds = {name: (files.type_of(array), array.shape) for name, array in group.items()}
            except ValueError as error:
                raise ArtifactError(str(error), code="DXB-A413", hint="convert the array first") from None
            little = (array.astype(array.dtype.newbyteorder("<")).tobytes() for array in group.values())
            shards[file] = File(data=files.header(kinds, notes or {}) + b"".join(little))
            tensors |= {name: Tensor(dtype=kind, shape=shape, shard=file) for name, (kind, shape) in kinds.items()}
        return cls(shards=shards, tensors=tensors, notes=dict(notes or {}))

    @classmethod
    def load(cls, path: str | Path) -> Weights:
        """Weights in a `.safetensors` file, the files named in an `.index.json`, or a folder with one of these.

        Only the indices are read; the files must not change until the weights are stored.

        Raises:
            ArtifactError: A file is missing, damaged or may contain a pickle, or a tensor is in two files.
        """
        path = Path(path)
        if path.suffix in _PICKLES:
            raise _pickle(path)
        names = {path.name: path}
        if path.is_dir():
            path = _main_file(path)
            names = {path.name: path}
        if path.name.endswith(".json"):
            names = {name: path.parent / name for name in sorted(set(_weight_map(path).values()))}
        shards: dict[str, File] = {}
        tensors: dict[str, Tensor] = {}
        notes: dict[str, str] = {}
        for name, file in names.items():
            spans, said = _indexed(file)
            notes |= said
            if double := tensors.keys() & spans.keys():
                raise unreadable(file, _FORM, f"another file has tensor `{min(double)}` too")
            shards[name] = File.of(file)
            tensors |= {key: Tensor(dtype=span.dtype, shape=span.shape, shard=name) for key, span in spans.items()}
        if path.name.endswith(".json"):
            _compare(path, tensors)
        return cls(shards=shards, tensors=dict(sorted(tensors.items())), notes=notes)

    def export(self, folder: str | Path, stem: str) -> list[Path]:
        """Write the files under their own names, with the index if there are several, as for `from_pretrained`."""
        folder = Path(folder)
        if len(self.shards) == 1:
            return self.save(folder / next(iter(self.shards)))
        return self.save(folder / f"model{INDEX}")

    def _write(self, path: Path) -> list[Path]:
        """One `.safetensors` file with all tensors, or the index `.json` with the files next to it."""
        if path.suffix.lower() == ".json":
            for name, file in self.shards.items():
                file.place(path.parent / name)
            where = {name: tensor.shard for name, tensor in sorted(self.tensors.items())}
            text = json.dumps({"metadata": {"total_size": self.bytes}, "weight_map": where}, indent=2, sort_keys=True)
            path.write_text(text + "\n")
            return [path, *(path.parent / name for name in self.shards)]
        if len(self.shards) == 1:
            next(iter(self.shards.values())).place(path)
            return [path]
        with path.open("wb") as out:
            self._merge(out, self.notes)
        return [path]

    def noted(self, notes: Mapping[str, str]) -> Weights:
        """The same tensors in one file with other notes, created in memory."""
        out = io.BytesIO()
        self._merge(out, notes)
        name = _shard_name(0, 1)
        tensors = {key: tensor.model_copy(update={"shard": name}) for key, tensor in self.tensors.items()}
        return Weights(shards={name: File(data=out.getvalue())}, tensors=tensors, notes=dict(notes))

    def _merge(self, out: BinaryIO, notes: Mapping[str, str]) -> None:
        kinds = {name: (tensor.dtype, tensor.shape) for name, tensor in sorted(self.tensors.items())}
        out.write(files.header(kinds, notes))
        spans = {shard: self._spans(shard) for shard in self.shards}
        for name in kinds:
            shard = self.tensors[name].shard
            with self.shards[shard].open() as source:
                for data in files.pieces(source, spans[shard][name]):
                    out.write(data)

    def _spans(self, shard: str) -> dict[str, files.Span]:
        with self.shards[shard].open() as file:
            total = file.seek(0, 2)
            file.seek(0)
            return files.index(file, total)[0]


def _shard_name(number: int, count: int) -> str:
    return "model.safetensors" if count == 1 else f"model-{number + 1:05d}-of-{count:05d}.safetensors"


def _pickle(path: Path) -> ArtifactError:
    return ArtifactError(
        f"`{path.name}` may hold a pickle, which runs code when it is read",
        code="DXB-A414",
        hint="take the `.safetensors` of the same model; most repositories have it",
    )


def _main_file(folder: Path) -> Path:
    """The index of a folder, or its only safetensors file."""
    indices, single = sorted(folder.glob(f"*{INDEX}")), sorted(folder.glob("*.safetensors"))
    found = indices or single
    if len(found) == 1:
        return found[0]
    pickles = sorted(each for each in folder.iterdir() if each.suffix in _PICKLES)
    if not found and pickles:
        raise _pickle(pickles[0])
    why = f"it holds {listing(each.name for each in found)}" if found else "it holds no `.safetensors` file"
    raise unreadable(folder, _FORM, why)


def _weight_map(path: Path) -> dict[str, str]:
    try:
        found = json.loads(path.read_text("utf-8"))["weight_map"]
        if not all(isinstance(name, str) and "/" not in name for name in found.values()):
            raise ValueError("a file of it is not beside it")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise unreadable(path, "an index of safetensors", error) from None
    return {str(tensor): name for tensor, name in found.items()}


def _indexed(file: Path) -> tuple[dict[str, files.Span], dict[str, str]]:
    try:
        with file.open("rb") as opened:
            return files.index(opened, file.stat().st_size)
    except (OSError, ValueError) as error:
        raise unreadable(file, _FORM, error) from None


def _compare(path: Path, tensors: Mapping[str, Tensor]) -> None:
    said = _weight_map(path)
    for name in sorted(said.keys() | tensors.keys()):
        if name not in tensors or said.get(name) != tensors[name].shard:
            where = tensors[name].shard if name in tensors else "none of its files"
            raise unreadable(path, "an index of safetensors", f"tensor `{name}` is in {where}, not in {said.get(name)}")
