"""Shared stores: everything made in a group-writable store is accessible to the group.

As with git's `core.sharedRepository`, regardless of a user's umask, new folders inherit the permission bits and the
group of their parent, and new files are readable by every user who can read the parent.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from functools import cache

from dextera_build.store import failpoints


def make_folder(path: str) -> None:
    """Make a folder and its missing parents, each shared like its own parent.

    Raises:
        OSError: It cannot be made.
    """
    missing = []
    here = os.path.abspath(path)
    while not os.path.isdir(here):
        missing.append(here)
        here = os.path.dirname(here)
    shared = _bits(here)
    for folder in reversed(missing):
        if shared:
            _make_shared(folder, shared)
        else:
            with suppress(FileExistsError):
                os.mkdir(folder)
        failpoints.reach("folder.made")


def share_file(descriptor: int, folder: str, mode: int) -> None:
    """Give the group access to a file that was made in `folder` with permissions `mode`, if the folder is shared."""
    shared = _known(folder)
    if shared:
        # No file is executable, and the group may write if the owner may.
        allowed = 0o066 if mode & 0o200 else 0o044
        with suppress(PermissionError):
            os.fchmod(descriptor, mode & 0o700 | shared & allowed)


def share_tree(folder: str) -> None:
    """Give the group access to everything that other programs wrote below a shared folder."""
    shared = _bits(os.path.dirname(folder))
    if not shared:
        return
    for place, _, names in os.walk(folder):
        for path, bits in ((place, shared), *((os.path.join(place, name), shared & 0o066) for name in names)):
            with suppress(OSError):
                os.chmod(path, stat.S_IMODE(os.stat(path).st_mode) | bits)


@cache
def _known(folder: str) -> int:
    return _bits(folder)


def _bits(folder: str) -> int:
    """Group and other permission bits of a group-writable folder, with setgid; else 0."""
    try:
        mode = os.stat(folder).st_mode
    except OSError:
        return 0
    return stat.S_ISGID | mode & 0o077 if mode & stat.S_IWGRP else 0


def _make_shared(folder: str, shared: int) -> None:
    # Made under a temporary name: others see it with its final permissions or not at all.
    aside = f"{os.path.dirname(folder)}/.tmp-{os.urandom(8).hex()}"
    os.mkdir(aside, 0o700)
    try:
        failpoints.reach("folder.aside")
        os.chmod(aside, 0o700 | shared)
        os.rename(aside, folder)
    except OSError:
        os.rmdir(aside)
        if not os.path.isdir(folder):
            raise
