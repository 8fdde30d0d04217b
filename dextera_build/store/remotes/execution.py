"""Messages of the Remote Execution API that say what an action is and what came of it: `remote_execution.proto`.

A cache keeps them as blobs and results; fields that name no blobs are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from dextera_build.store.remotes.remote import Digest

NO_DIGEST = Digest("", 0)
"""A digest that is not set."""


@dataclass(frozen=True)
class Command:
    """What an action runs."""

    arguments: Annotated[tuple[str, ...], 1] = ()


@dataclass(frozen=True)
class Action:
    """A command and the folder that it starts in."""

    command_digest: Annotated[Digest, 1]
    input_root_digest: Annotated[Digest, 2]


@dataclass(frozen=True)
class FileNode:
    """A file of a folder."""

    name: Annotated[str, 1]
    digest: Annotated[Digest, 2]


@dataclass(frozen=True)
class DirectoryNode:
    """A folder of a folder."""

    name: Annotated[str, 1]
    digest: Annotated[Digest, 2]


@dataclass(frozen=True)
class Directory:
    """A folder."""

    files: Annotated[tuple[FileNode, ...], 1] = ()
    directories: Annotated[tuple[DirectoryNode, ...], 2] = ()


@dataclass(frozen=True)
class Tree:
    """A folder and all below it."""

    root: Annotated[Directory, 1] = Directory()
    children: Annotated[tuple[Directory, ...], 2] = ()


@dataclass(frozen=True)
class OutputFile:
    """A file that an action made."""

    path: Annotated[str, 1]
    digest: Annotated[Digest, 2]


@dataclass(frozen=True)
class OutputDirectory:
    """A folder that an action made, as one `Tree`."""

    path: Annotated[str, 1]
    tree_digest: Annotated[Digest, 3]


@dataclass(frozen=True)
class ActionResult:
    """What of any action's result names blobs; `store.reapi` reads and writes our own."""

    output_files: Annotated[tuple[OutputFile, ...], 2] = ()
    output_directories: Annotated[tuple[OutputDirectory, ...], 3] = ()
    stdout_raw: Annotated[bytes, 5] = b""
    stdout_digest: Annotated[Digest, 6] = NO_DIGEST
    stderr_raw: Annotated[bytes, 7] = b""
    stderr_digest: Annotated[Digest, 8] = NO_DIGEST


@dataclass(frozen=True)
class Tool:
    """`ToolDetails`."""

    tool_name: Annotated[str, 1]
    tool_version: Annotated[str, 2]


@dataclass(frozen=True)
class RequestMetadata:
    """Who asks; servers write it to their logs."""

    tool_details: Annotated[Tool, 1]
    action_id: Annotated[str, 2]
    tool_invocation_id: Annotated[str, 3]
