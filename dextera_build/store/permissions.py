"""Stores that a group shares: where the store's folder is group-writable, so is all that is made in it.

As git does with `core.sharedRepository`: whatever the umask of a user, folders get the bits of the folder that they are
made in and its group, and files may be read by whoever may read that.
"""

from __future__ import annotations

import os
import stat
from contextlib import suppress
from functools import cache

from dextera_build.store import failpoints


def make_folder(path: str) -> None:
    """Make a folder and those above it that are not there, each shared as the one that it is made in.

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
    """Let the group have a file that was made in `folder` with these permissions, if the folder is shared."""
    shared = _known(folder)
    if shared:
        # A file is nobody's to run, and a group may write to what its owner may write to.
        allowed = 0o066 if mode & 0o200 else 0o044
        with suppress(PermissionError):
            os.fchmod(descriptor, mode & 0o700 | shared & allowed)


def share_tree(folder: str) -> None:
    """Let the group have all that other programs wrote below a shared folder."""
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
    """What others may do in a folder that its group may write to, and the bit that hands the group on; else 0."""
    try:
        mode = os.stat(folder).st_mode
    except OSError:
        return 0
    return stat.S_ISGID | mode & 0o077 if mode & stat.S_IWGRP else 0


def _make_shared(folder: str, shared: int) -> None:
    # Aside first: others find it with its final permissions, or not at all.
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
