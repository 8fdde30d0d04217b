"""Reads files of settings, `dxb.toml` and its like, whatever stands in them."""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dextera_build.errors import Place, RecipeError

PYPROJECT = "pyproject.toml"


def user_folder() -> Path:
    """Where settings of one person lie."""
    return Path(os.path.expanduser(os.environ.get("XDG_CONFIG_HOME", "~/.config")), "dxb")


def declares(file: Path) -> bool:
    """Whether a `pyproject.toml` is there and speaks of dxb."""
    with suppress(OSError):
        return b"[tool.dxb]" in file.read_bytes()
    return False


def read(file: Path) -> dict[str, Any]:
    """The settings of a TOML file; those of a `pyproject.toml` stand in its table `tool.dxb`.

    Raises:
        RecipeError: It cannot be read, is not TOML, or has something else in place of a table.
    """
    try:
        values = tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise _wrong(f"the settings cannot be read: {error.strerror}", file) from None
    except RecursionError:
        raise _wrong("not valid TOML: values are nested too deep", file) from None
    except ValueError as error:  # no TOML, no UTF-8, or a number of thousands of digits
        raise _wrong(f"not valid TOML: {error}", file) from None
    if file.name != PYPROJECT:
        return values
    return _table(_table(values, "tool", file), "dxb", file)


def check(name: str, value: object, origin: str) -> None:
    """Refuse what cannot be the value of a setting, wherever it was set.

    Raises:
        RecipeError: It is a list or a table where one value stands, or holds control characters.
    """
    if name in ("remotes", "resources"):
        return  # those who read them look at each part
    parts = value if name == "trusted_keys" and isinstance(value, list) else [value]
    if not all(isinstance(part, bool | int | str) and str(part).isprintable() for part in parts):
        raise RecipeError(
            f"`{name}` is one value without control characters",
            code="DXB-R403",
            where=Place(origin),
            hint=f'`{name} = "..."`',
        )


def _table(values: Mapping[str, Any], name: str, file: Path) -> dict[str, Any]:
    table = values.get(name, {})
    if not isinstance(table, dict):
        raise _wrong(f"`{name}` is not a table", file)
    return table


def _wrong(message: str, file: Path) -> RecipeError:
    return RecipeError(message, code="DXB-R402", where=Place(str(file)))
