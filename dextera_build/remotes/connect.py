"""From the address of a remote to the remote; the libraries that speak to it are loaded here and nowhere else."""

from __future__ import annotations

import os
import re
from functools import partial
from pathlib import Path

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.remotes.breaker import Guarded
from dextera_build.remotes.folder import Directory
from dextera_build.remotes.remote import Remote
from dextera_build.remotes.spec import BUCKETS, Spec, checked, refuse_clear


def open_remote(spec: Spec) -> Remote:
    """The remote of an address; nothing is asked yet.

    Raises:
        MachineError: A package is missing.
        UsageError: The address holds a variable that is not set, is malformed, or would send a password in the clear.
    """
    address = checked(_filled(spec.address, spec.name))  # a variable may have brought anything
    options = {name: _filled(value, spec.name) for name, value in spec.options.items()}
    refuse_clear(address, options)
    scheme = address.partition("://")[0] if "://" in address else "file"
    try:
        if scheme in ("http", "https"):
            from dextera_build.remotes.http import HttpCache

            return HttpCache(address, timeout_s=spec.timeout_s)
        if scheme in BUCKETS:
            from dextera_build.remotes.s3 import ObjectStore

            return ObjectStore(address, options, timeout_s=spec.timeout_s)
        return Directory(Path(os.path.expanduser(address.removeprefix("file://"))).absolute())
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
    opener = partial(open_remote, spec)
    return Guarded(spec.name, spec.shown, opener, timeout_s=spec.timeout_s, mode=spec.mode)


def _filled(text: str, name: str) -> str:
    def value(match: re.Match[str]) -> str:
        if match[1] not in os.environ:
            raise UsageError(
                f"remote `{name}` needs the variable `{match[1]}`, which is not set",
                code="DXB-U135",
                hint=f"export {match[1]}=...",
            )
        return os.environ[match[1]]

    return re.sub(r"\$\{(\w+)\}", value, text)
