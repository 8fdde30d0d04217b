"""The stores that a build uses, with modes: lists such as `local:rw,lab:r` of remotes from the settings."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from dextera_build.errors import UsageError, listing
from dextera_build.redact import redact
from dextera_build.remotes.spec import EVERY, LOCAL, MODES, Spec, from_table, named, refuse_clear

_USE = re.compile(rf"(?P<what>.+):(?P<mode>{'|'.join(MODES)})")


class Choice:
    """Collects the remotes from the layers of the settings, in ascending precedence.

    Args:
        root: Base of relative folders in the settings; folders in a list are relative to the current folder.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self.known: dict[str, Spec] = {}
        """Every configured remote by its name."""
        self._origins: dict[str, str] = {}
        self._list: tuple[str, str] | None = None

    def take(self, values: Mapping[str, Any], origin: str) -> dict[str, Any]:
        """Take the remotes out of one layer, and return its other settings.

        Raises:
            UsageError: A remote's name, address or mode is wrong.
        """
        rest = dict(values)
        table = rest.pop("remotes", None)
        if isinstance(table, Mapping):
            found = {name: spec.below(self._root) for name, spec in from_table(table, origin).items()}
            self.known |= found
            self._origins |= dict.fromkeys(found, origin)
        elif table is not None:
            self._list = (str(table), origin)
        if "cache" in rest and self._is_list(str(rest["cache"])):
            self._list = (str(rest.pop("cache")), origin)
        return rest

    @property
    def local(self) -> str:
        """Mode of the store: `rw`, or `r` if nothing may run.

        Raises:
            UsageError: The list is malformed, or names an unknown remote.
        """
        return self._chosen()[0]

    @property
    def used(self) -> list[Spec]:
        """The remotes that are used, in lookup order.

        Raises:
            UsageError: The list is malformed, names an unknown remote, or would send a password in the clear.
        """
        used = self._chosen()[1]
        for spec in used:
            refuse_clear(spec.address, spec.options)
        return used

    @property
    def listed(self) -> str:
        """The list in force, with its secrets; "" if there is none."""
        return self._list[0] if self._list else ""

    def rows(self) -> dict[str, tuple[str, str]]:
        """Setting -> (value without secrets, origin)."""
        rows = {f"remotes.{name}": (str(spec), self._origins[name]) for name, spec in self.known.items()}
        if self._list is not None:
            rows["use"] = (redact(self._list[0]), self._list[1])
        return rows or {"remotes": ("none", "default")}

    def _chosen(self) -> tuple[str, list[Spec]]:
        """The store's mode, and the remotes in the order of a list such as `local:rw,lab:r,https://host:w`.

        A remote that is not in the list is not used; the store always is. `remote` means every configured one.
        """
        if self._list is None:
            return "rw", [spec for spec in self.known.values() if spec.mode != "off"]
        text, local = self._list[0], "rw"
        chosen: dict[str, Spec] = {}
        for part in (part.strip() for part in text.split(",")):
            match = _USE.fullmatch(part)
            if match is None:
                name = part.rpartition(":")[0]
                # A comma in a password splits it in two, and the halves do not look like secrets.
                shown = part if redact(text) == text else redact(text)
                use = name if name in (LOCAL, EVERY, *self.known) else shown
                raise UsageError(
                    f"`{shown}` does not say how to use a store",
                    code="DXB-U132",
                    facts={"form": "`NAME:MODE` or `URL:MODE`", "modes": listing(MODES)},
                    hint=f"`{use}:r` reads from it",
                )
            what, mode = match["what"], match["mode"]
            if what == LOCAL and mode not in ("r", "rw"):
                raise UsageError(
                    f"`local:{mode}`: a build needs its store",
                    code="DXB-U134",
                    facts={"modes": "`local:rw`; `local:r` uses only results in the store and runs nothing"},
                    hint="`--force NODE` runs a cached node; `DXB_CACHE` sets another folder",
                )
            if what == LOCAL:
                local = mode
            elif what == EVERY:
                chosen |= {name: replace(spec, mode=mode) for name, spec in self.known.items()}
            else:
                spec = named(what, self.known)
                chosen[spec.name] = replace(spec, mode=mode)
        return local, [spec for spec in chosen.values() if spec.mode != "off"]

    def _is_list(self, text: str) -> bool:
        """Whether a value of `--cache` is a list and not a folder."""
        parts = [part.strip() for part in text.split(",")]
        names = {LOCAL, EVERY, *self.known}
        return any(
            _USE.fullmatch(part) or "://" in part or part.partition(":")[0] in names for part in parts if ":" in part
        )
