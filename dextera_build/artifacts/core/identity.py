"""Names of artifact types in headers: `Mesh`, `Capture@2`, `lab.Cup@3`.

A type is identified by its namespace and its name. The namespace is the stage of a rule's folder, or the top-level
package, that defines it; types of dxb have none. The version counts changes of its fields; version 1 is not written.
"""

from __future__ import annotations

import re
from typing import Any

from dextera_build.errors import ArtifactError

_OWN = "dextera_build.artifacts"
_ROOT = re.compile(r"dxb_rules_[0-9a-f]+\.(\w+)")
"""A module of a folder of rules, and its stage; see `code.loader.Root`."""


def identity(kind: type[Any]) -> str:
    """Namespace and name of an artifact type, without the parameters of a generic: `Mesh`, `lab.Cup`."""
    # A generic with parameters is defined where it is first written.
    generic = kind.__pydantic_generic_metadata__["origin"] or kind
    module, name = generic.__module__, generic.__name__
    stage = _ROOT.match(module)
    space = "" if f"{module}.".startswith(f"{_OWN}.") else stage[1] if stage else module.partition(".")[0]
    return f"{space}.{name}" if space else name


def spelled(kind: type[Any]) -> str:
    """Identity and version, as in headers."""
    version: int = kind.type_version
    return identity(kind) + (f"@{version}" if version > 1 else "")


def parse(stored: str) -> tuple[str, int]:
    """Identity and version from a header.

    Raises:
        ValueError: It is not such a text.
    """
    name, _, version = stored.partition("@")
    return name, int(version or 1)


def check(kind: type[Any], stored: str) -> int:
    """The version of a stored value of this type.

    Raises:
        ArtifactError: The header has another type, or a version that is newer than the type.
    """
    name, version = parse(stored)
    if name != identity(kind):
        raise ArtifactError(f"a {identity(kind)} is needed here, but a {name} came", code="DXB-A102")
    if version > kind.type_version:
        raise ArtifactError(
            f"a {name} of version {version} was stored by a newer dxb, and this one reads {kind.type_version} at most",
            code="DXB-A115",
            hint="install the newer dxb, or build again",
        )
    return version


def unreadable(kind: type[Any], version: int) -> ArtifactError:
    """The error for a former version without a reader."""
    return ArtifactError(
        f"a {identity(kind)} of version {version} was stored by an earlier dxb, and this one reads version "
        f"{kind.type_version} only",
        code="DXB-A116",
        hint="build again; `dxb show` and `dxb diff` still show the stored one",
    )
