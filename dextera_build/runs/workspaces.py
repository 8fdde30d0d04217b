"""Names of workspaces, the projects that build with a store: `/home/ada/lab`, or `MACHINE:/home/ada/lab` if shared.

On two machines that share a store, one path may be two projects.
"""

from __future__ import annotations

import platform
from contextlib import suppress

from dextera_build import digest as digests

_MACHINE = "/etc/machine-id"


def name(folder: str, *, shared: bool) -> str:
    """The workspace of a project folder on this machine, in its own store or in a shared one."""
    return f"{_machine()}:{folder}" if shared else folder


def folder(workspace: str) -> str:
    """The project folder, on whichever machine."""
    return workspace if workspace.startswith("/") else workspace.partition(":")[2] or workspace


def is_here(workspace: str) -> bool:
    """Whether a workspace is on this machine, according to its name."""
    return folder(workspace) == workspace or workspace.startswith(f"{_machine()}:")


def mark(workspace: str) -> str:
    """The name in logs, which are shared and must not reveal the path; "" in a project's own store."""
    return "" if folder(workspace) == workspace else digests.of_value(workspace)[:16]


def _machine() -> str:
    """A name of this machine: containers of one image share its id, and machines of one kind may share a host name."""
    known = ""
    with suppress(OSError, UnicodeDecodeError), open(_MACHINE) as file:
        known = file.read().strip()
    return digests.of_value([known, platform.node()])[:16]
