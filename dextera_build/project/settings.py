"""Reading and validation of settings files such as `dxb.toml`."""

from __future__ import annotations

import os
import re
import tomllib
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from dextera_build.calls import secrets
from dextera_build.errors import Place, RecipeError, UsageError, did_you_mean, listing

PYPROJECT = "pyproject.toml"
_PLACE = re.compile(r" \(at line (\d+), column (\d+)\)$")


DEFAULTS: Mapping[str, Any] = {
    "cache": "cache",
    "models": "",
    "remotes": {},
    "profile": "cpu",
    "jobs": 0,
    "resources": {},
    "executor": "local",
    "console": "auto",
    "calls": "record",
    "services": {},
    "max_cost": "",
    "durable": True,
    "trusted_keys": "",
    "require_signed": False,
}
PROFILES = ("stub", "cpu", "picture", "gpu", "cloud")
"""Profiles that dxb brings."""
_ON = ("true", "1", "yes", "on")
_SWITCH = (*_ON, "false", "0", "no", "off")
"""Spellings of a boolean setting, in a file or in the environment."""
_CHOICES = {
    "profile": PROFILES,
    "jobs": ("a number; 0: all cores",),
    "executor": ("local", "ray", "ray:HOST:PORT"),
    "console": ("auto", "live", "plain", "jsonl", "none"),
    "calls": ("record", "replay", "refresh", "replace", "off"),
    "max_cost": ("an amount in USD such as 2.50, or none",),
    "durable": _SWITCH,
    "require_signed": _SWITCH,
}
_PATTERNS = {
    "jobs": re.compile(r"[0-9]{1,6}"),
    "executor": re.compile(r"local|ray(:.+)?"),
    "max_cost": re.compile(r"([0-9]{1,9}(\.[0-9]{1,9})?)?|none"),
}
"""Setting -> pattern of its values, if these are not a list of words."""


def user_folder() -> Path:
    """The folder of the user's own settings."""
    return Path(os.path.expanduser(os.environ.get("XDG_CONFIG_HOME", "~/.config")), "dxb")


def declares(file: Path) -> bool:
    """Whether a `pyproject.toml` exists and has settings of dxb."""
    with suppress(OSError):
        return b"[tool.dxb]" in file.read_bytes()
    return False


def read(file: Path) -> dict[str, Any]:
    """The settings of a TOML file; in a `pyproject.toml` they are in the table `tool.dxb`.

    Raises:
        RecipeError: It cannot be read, holds a secret, is not TOML, or has another value in place of a table.
    """
    where = Place(str(file))
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise _wrong(f"the settings cannot be read: {reason}", where) from None
    secrets.refuse_written(text, where.file)
    values = parse_toml(text, where, _wrong)
    for name in ("tool", "dxb") if file.name == PYPROJECT else ():
        values = values.get(name, {})
        if not isinstance(values, dict):
            raise _wrong(f"`{name}` is not a table", where)
    return values


def parse_toml(text: str, where: Place, wrong: Callable[[str, Place], RecipeError]) -> dict[str, Any]:
    """The tables of a TOML text; `wrong` makes the error from a message and the place in the file `where`."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise wrong("not valid TOML: values are nested too deep", where) from None
    except ValueError as error:  # not TOML, or a number of thousands of digits
        place = _PLACE.search(str(error))
        at = Place(where.file, int(place[1]), int(place[2])) if place else where
        raise wrong(f"not valid TOML: {_PLACE.sub('', str(error))}", at) from None


def plain(name: str, value: Any) -> Any:
    """The value of a setting as data: numbers and booleans also if a variable spells them, None if it is not set."""
    if name == "jobs":
        return int(value)
    if name in ("durable", "require_signed"):
        return is_on(value)
    if name == "max_cost":
        return float(value) if str(value) not in ("", "none") else None
    return None if value == "" else value


def check(name: str, value: object, origin: str) -> None:
    """Refuse an invalid value of a setting, wherever it was set.

    Raises:
        RecipeError: It is a list or a table instead of a single value, or holds control characters.
    """
    if name in ("remotes", "resources", "services"):
        return  # their parts are checked when they are read
    parts = value if name in ("trusted_keys", "models") and isinstance(value, list) else [value]
    if not all(isinstance(part, bool | int | float | str) and str(part).isprintable() for part in parts):
        raise RecipeError(
            f"`{name}` is one value without control characters",
            code="DXB-R403",
            where=Place(origin),
            hint=f'`{name} = "..."`',
        )


def choose(name: str, value: object, origin: str) -> None:
    """Refuse a value that is not one of the choices of its setting.

    Raises:
        UsageError: It is not one of them.
    """
    choices, text = _CHOICES.get(name), str(value)
    if choices is None or (_PATTERNS[name].fullmatch(text) if name in _PATTERNS else text in choices):
        return
    if choices is _SWITCH and text.lower() in choices:
        return
    raise UsageError(
        f"`{name}` cannot be `{text}`",
        code="DXB-U103",
        facts={"choices": listing(choices), "from": origin},
        hint=did_you_mean(text, choices),
    )


def is_profile(name: str) -> bool:
    """Whether a text can be the name of a profile; `names` is another table of `dxb.lock`."""
    return re.fullmatch(r"[a-z][a-z0-9_]*", name) is not None and name != "names"


def is_on(value: object) -> bool:
    """The value of a boolean setting."""
    return str(value).lower() in _ON


def _wrong(message: str, where: Place) -> RecipeError:
    return RecipeError(message, code="DXB-R402", where=where)
