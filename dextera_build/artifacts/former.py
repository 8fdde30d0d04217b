"""Readers of former versions of artifact types; see `Artifact.readers`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from dextera_build.artifacts.pose import Pose

Fields = dict[str, Any]
Reader = Callable[[Fields], Fields]
Readers = Mapping[int, Reader]


def pose(old: str, new: str, parent: str, child: str) -> Reader:
    """Version 1 held T_parent_child as a matrix `old`, (4, 4) float64 [m]; version 2 holds the `Pose` `new`."""

    def read(fields: Fields) -> Fields:
        matrix = fields.pop(old)
        return {**fields, new: Pose(parent=parent, child=child, matrix=matrix)}

    return read


def unchanged(fields: Fields) -> Fields:
    """The next version only added fields, whose defaults describe the former values, or allows more values in one."""
    return fields


def from_depth(fields: Fields) -> Fields:
    """Version 1 did not record its source: all rules read depth then."""
    return {**fields, "asset_source": "rgbd"}


def source(fields: Fields) -> Fields:
    """Version 1 called `asset_source` `source`."""
    made_from = fields.pop("source")
    return {**fields, "asset_source": made_from}


def both(*readers: Reader) -> Reader:
    """Several changes in one version."""

    def read(fields: Fields) -> Fields:
        for reader in readers:
            fields = reader(fields)
        return fields

    return read
