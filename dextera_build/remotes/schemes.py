"""Kinds of remotes by the scheme of their address.

A kind is one module of this package with a function `opened(address, options, timeout_s) -> Remote`, and one line for
each of its schemes here. The module is imported when a remote is opened, because every command reads this table.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from dextera_build.remotes.remote import Remote

FOLDER = "file"
"""Scheme of an address without one."""


class Scheme(NamedTuple):
    """How the addresses with one scheme are opened."""

    module: str
    """Module of this package."""
    tuned: bool = False
    """Whether its library takes settings of its own."""


SCHEMES: dict[str, Scheme] = {
    "http": Scheme("http"),
    "https": Scheme("http"),
    "s3": Scheme("s3", tuned=True),
    "gs": Scheme("s3", tuned=True),
    "az": Scheme("s3", tuned=True),
    FOLDER: Scheme("folder"),
}


def of(address: str) -> str:
    """The scheme of an address."""
    scheme, separator, _ = address.partition("://")
    return scheme if separator else FOLDER


def opened(address: str, options: Mapping[str, str], timeout_s: float) -> Remote:
    """Open a remote; no request is sent yet.

    Args:
        address: A URL with a scheme of the table, or a folder.
        options: Settings of its library.
        timeout_s: How long to wait for an answer [s].

    Raises:
        ImportError: A package is missing.
        ValueError: The address or an option is invalid.
    """
    module = import_module(f"{__package__}.{SCHEMES[of(address)].module}")
    remote: Remote = module.opened(address, options, timeout_s)
    return remote
