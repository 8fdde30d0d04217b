"""Remotes by name, address and mode, from the settings or the command line, and how they are opened."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from dextera_build.calls import secrets
from dextera_build.errors import MachineError, UsageError, did_you_mean, install_extra, listing
from dextera_build.redact import hide, hide_address, redact
from dextera_build.remotes import schemes
from dextera_build.remotes.remote import is_loopback

if TYPE_CHECKING:
    # Every command reads the settings of remotes; their client libraries are imported on demand.
    from dextera_build.remotes.breaker import Guarded
    from dextera_build.remotes.remote import Remote

MODES = ("r", "rw", "w", "off")
_SETTINGS = ("address", "mode", "timeout_s")
"""Settings of any remote; some have more, which their library checks."""
LOCAL, EVERY = "local", "remote"
_NAME = re.compile(r"[a-z][a-z0-9_-]*")
_SECRET = re.compile(r"key|secret|token|password|credential|sas", re.IGNORECASE)
_VARIABLE = re.compile(r"\$\{(\w+)\}")
_TIMEOUT_S = 10.0
_LONGEST_S = 1e6


@dataclass(frozen=True)
class Spec:
    """One remote: its address, and how it may be used."""

    name: str
    address: str
    """A URL, or a folder; `${NAME}` inserts an environment variable."""
    mode: str = "r"
    timeout_s: float = _TIMEOUT_S
    """How long to wait for an answer [s]."""
    options: Mapping[str, str] = field(default_factory=dict)
    """Further options for the library of its scheme: `endpoint`, `region`, ..."""

    def __post_init__(self) -> None:
        # Its passwords may be in the output of a rule, or in the error of a library.
        for name, value in {"": self.address, **self.options}.items():
            filled = _VARIABLE.sub(lambda match: secrets.variable(match[1]) or "", value)
            hide_address(filled)
            if name and _SECRET.search(name):
                hide(name, filled)

    @property
    def shown(self) -> str:
        """The address without secrets."""
        return redact(self.address)

    def below(self, root: Path) -> Spec:
        """The same remote; a relative folder is resolved against `root`."""
        if "://" in self.address or self.address.startswith(("/", "~", "$")):
            return self
        return replace(self, address=os.path.normpath(root / self.address))

    def __str__(self) -> str:
        """As `dxb show --config` prints it; no secrets."""
        more = {name: "***" if _SECRET.search(name) else redact(value) for name, value in self.options.items()}
        if self.timeout_s != _TIMEOUT_S:
            more["timeout_s"] = f"{self.timeout_s:g}"
        return " ".join([self.shown, self.mode, *(f"{name}={value}" for name, value in more.items())])


def refuse_clear(address: str, options: Mapping[str, str]) -> None:
    """Refuse a remote whose password or token would go to another machine over plain HTTP.

    Raises:
        UsageError: A secret would go to another machine.
    """
    for url in (address if {"@", "?"} & set(address) else "", *options.values()):
        if not url.startswith("http://"):
            continue
        try:
            host = urlsplit(url).hostname or ""
        except ValueError:
            host = ""  # reported when the remote is opened
        if not is_loopback(host):
            raise UsageError(
                f"`{url}` would send a password or token in the clear",
                code="DXB-U137",
                facts={"allowed": "`https://` to any machine, `http://` to this one (localhost, 127.0.0.1, ::1)"},
                hint=f"`https://{url.removeprefix('http://')}`, or a tunnel: `ssh -L 8098:localhost:8098 HOST`",
            )


def from_table(table: Mapping[str, Any], where: str) -> dict[str, Spec]:
    """The remotes of a settings file: name -> address, or name -> {address, mode, timeout_s, ...}.

    Raises:
        UsageError: A name, address or mode is wrong.
    """
    found = {}
    for name, value in table.items():
        if not _NAME.fullmatch(name) or name in (LOCAL, EVERY):
            raise UsageError(
                f"`{name}` cannot be the name of a remote",
                code="DXB-U130",
                facts={"from": where, "names": "lower-case letters, digits, `-` and `_`; not `local`, not `remote`"},
            )
        body = dict(value) if isinstance(value, Mapping) else {"address": value}
        address, mode, patience = body.pop("address", None), body.pop("mode", "r"), body.pop("timeout_s", _TIMEOUT_S)
        options = {option: str(setting) for option, setting in body.items()}
        if not isinstance(address, str) or not address:
            raise _wrong(f"remote `{name}` has no address", where)
        if not isinstance(patience, int | float) or isinstance(patience, bool) or not 0 < patience < _LONGEST_S:
            raise _wrong(f"`timeout_s` of remote `{name}` is not a time", where)
        if mode not in MODES:
            raise _wrong(f"`{mode}` is not a mode of remote `{name}`", where, modes=listing(MODES))
        tuned = [scheme for scheme, kind in schemes.SCHEMES.items() if kind.tuned]
        if options and schemes.of(address) not in tuned:
            known, hint = listing(_SETTINGS), did_you_mean(next(iter(options)), _SETTINGS)
            more = f"for {listing(tuned)} alone"
            raise _wrong(
                f"remote `{name}` has no setting `{next(iter(options))}`", where, hint, settings=known, more=more
            )
        found[name] = Spec(name, checked(address), mode, float(patience), options)
    return found


def _wrong(message: str, where: str, hint: str | None = None, **facts: str) -> UsageError:
    return UsageError(message, code="DXB-U131", facts={"from": where, **facts}, hint=hint)


def named(what: str, known: Mapping[str, Spec]) -> Spec:
    """The remote with a name, URL or folder.

    Raises:
        UsageError: There is no such remote.
    """
    if what in known:
        return known[what]
    if "://" in what or what.startswith(("/", "./", "../", "~")):
        return Spec(redact(what), checked(what))
    raise UsageError(
        f"no remote is called `{what}`",
        code="DXB-U133",
        facts={"remotes": listing(known), "or": "a URL, or a folder that begins with `/`, `./` or `~`"},
        hint=did_you_mean(what, known) or f'in `dxb.toml`: [remotes] {what} = "https://host/prefix"',
    )


def checked(address: str) -> str:
    """Return `address` if it has the form of a remote's address.

    Raises:
        UsageError: It has another form.
    """
    known, (scheme, separator, rest) = schemes.SCHEMES, address.partition("://")
    if separator and (scheme not in known or not rest.strip("/")):
        raise UsageError(
            f"`{redact(address)}` is not the address of a remote",
            code="DXB-U131",
            facts={"schemes": listing(known), "or": "a folder"},
            hint=did_you_mean(scheme, known, "`{}://`"),
        )
    return address


def open_remote(spec: Spec) -> Remote:
    """Open a remote; no request is sent yet.

    Raises:
        MachineError: A package is missing.
        UsageError: The address holds a variable that is not set, is malformed, or would send a password in the clear.
    """
    address = checked(_filled(spec.address, spec.name))  # a variable may contain anything
    options = {name: _filled(value, spec.name) for name, value in spec.options.items()}
    refuse_clear(address, options)
    try:
        return schemes.opened(address, options, spec.timeout_s)
    except ImportError as error:
        raise MachineError(
            f"remote `{spec.name}` needs a package that is not installed",
            code="DXB-E330",
            facts={"address": spec.shown, "missing": error.name or str(error)},
            hint=install_extra("share"),
        ) from None
    except ValueError as error:
        raise UsageError(
            f"`{spec.shown}` is not the address of a remote",
            code="DXB-U131",
            facts={"remote": spec.name, "because": str(error).partition(chr(10))[0]},
        ) from None


def guarded(spec: Spec) -> Guarded:
    """The remote with its circuit breaker; connects when it is first needed."""
    from dextera_build.remotes.breaker import Guarded

    return Guarded(spec.name, spec.shown, lambda: open_remote(spec), timeout_s=spec.timeout_s, mode=spec.mode)


def _filled(text: str, name: str) -> str:
    def value(match: re.Match[str]) -> str:
        found = secrets.variable(match[1])
        if found is None:
            raise UsageError(
                f"remote `{name}` needs the environment variable `{match[1]}`, which is not set",
                code="DXB-U135",
                hint=f"export {match[1]}=...",
            )
        return found

    return _VARIABLE.sub(value, text)
