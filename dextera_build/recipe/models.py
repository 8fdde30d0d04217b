"""Descriptions of models: files `recipes/model/NAME.yaml` of the project and of dxb, the project's own first."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

from dextera_build.code.loader import bundled
from dextera_build.errors import RecipeError, did_you_mean, listing
from dextera_build.models.model import Model
from dextera_build.recipe import strict_yaml
from dextera_build.recipe.addresses import MODELS
from dextera_build.recipe.schema import listed, mapping, text
from dextera_build.recipe.strict_yaml import Node

_NAME = re.compile(r"[a-z][a-z0-9_]*")
_TEXTS = ("summary", "source", "licence", "digest", "forbids", "gated", "rows")
_SOURCE = re.compile(r"hf:[\w.-]+/[\w.-]+(@[\w./-]+)?|https?://\S+/\S+|package:[\w.-]+/[\w./-]+")
_DIGEST = re.compile(r"[0-9a-f]{64}")


def folders(project: Path | None) -> list[Path]:
    """Folders of descriptions, existing or not, the project's own first."""
    own = [project / "recipes"] if project is not None else []
    return [folder / MODELS for folder in dict.fromkeys((*own, bundled("recipes")))]


def names(project: Path | None) -> Iterator[str]:
    """Names of all described models."""
    found = {file.stem for folder in folders(project) for file in folder.glob("*.yaml")}
    yield from sorted(name for name in found if _NAME.fullmatch(name))


def read(name: str, project: Path | None, shown: Callable[[Path], str] = str) -> Model:
    """Read a description.

    Args:
        name: `grounding_dino`.
        project: The project's folder.
        shown: Spells a file for messages.

    Raises:
        RecipeError: There is none of this name, or it is wrong.
    """
    places = [folder / f"{name}.yaml" for folder in folders(project)]
    file = next((file for file in places if _NAME.fullmatch(name) and file.is_file()), None)
    if file is None:
        known = list(names(project))
        raise RecipeError(
            f"no model is called `{name}`",
            code="DXB-R213",
            facts={"models": listing(known, most=40)},
            hint=did_you_mean(name, known) or f"a file `recipes/{MODELS}/{name}.yaml` describes one",
        )
    root = strict_yaml.parse(file.read_text(encoding="utf-8"), shown(file))
    parts = mapping(root, "a model", {*_TEXTS, "files", "memory_gb"})
    told = {key: text(parts[key], key) for key in _TEXTS if key in parts}
    for key in ("summary", "licence"):
        if not told.get(key):
            raise RecipeError(f"the model `{name}` has no `{key}`", code="DXB-R214", where=root.place)
    for key, form, example in (
        ("source", _SOURCE, "`hf:OWNER/NAME@REVISION`, `https://...` or `package:DISTRIBUTION/PATH`"),
        ("digest", _DIGEST, "64 hexadecimal digits, as `dxb models ls --json` prints them"),
    ):
        if key in told and not form.fullmatch(told[key]):
            raise RecipeError(
                f"`{told[key]}` is not a {key} of a model",
                code="DXB-R214",
                where=parts[key].place,
                hint=f"write {example}",
            )
    patterns = listed(parts["files"], "files") if "files" in parts else ("*",)
    memory_gb = _number(parts["memory_gb"]) if "memory_gb" in parts else 0.0
    return Model(name=name, **_full(told), files=patterns, memory_gb=memory_gb, place=root.place)


def _full(told: dict[str, str]) -> dict[str, str]:
    return {key: told.get(key, "") for key in _TEXTS}


def _number(node: Node) -> float:
    if isinstance(node.value, bool) or not isinstance(node.value, int | float) or node.value < 0:
        message = f"`memory_gb` is a number of GiB from zero up, this is {node.kind}"
        raise RecipeError(message, code="DXB-R214", where=node.place)
    return float(node.value)
