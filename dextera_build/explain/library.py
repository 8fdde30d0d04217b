"""The asset library of a project: every object and background that its builds made and the store still holds."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dextera_build.errors import DxbError
from dextera_build.explain.asset import Asset, facts
from dextera_build.session import Session, reading

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store

MADE_BY = {"simulate.asset": "object", "background.static": "background"}
"""Rule -> kind of asset that it makes."""
URDF = "simulate.urdf"


@dataclass
class _Made:
    """An output of an asset rule, and the nodes that returned it."""

    rule: str
    nodes: list[str]


def assets(project: Project, *, old: bool = False) -> list[Asset]:
    """Every asset, sorted by kind, name and digest.

    Args:
        project: The project whose store is read.
        old: Also outputs that a later build of the same node replaced.
    """
    from dextera_build.project.workspace import workspace
    from dextera_build.runs import workspaces

    store = reading(project)
    made, urdf = _made(store, workspaces.mark(workspace(project)), old=old)
    found = [asset for output, each in made.items() if (asset := _asset(project, store, output, each, urdf))]
    return sorted(found, key=lambda asset: (asset.kind != "object", asset.name, asset.digest))


def notes(session: Session) -> dict[str, list[str]]:
    """Object -> the results of the last build of a request for it, in words."""
    found: dict[str, list[str]] = {}
    for node, entry in session.history.items():
        _, bracket, rest = node.partition("[")
        label = rest.partition("]")[0]
        known = session.store.actions.known(entry.key) if bracket and "[" not in rest else None
        if known is None or not known.line or _rule_of(session, entry.key_document) not in _TOLD:
            continue
        found.setdefault(label, []).append(f"built: {known.line}")
    return found


_TOLD = ("factorize.mesh", "factorize.articulate", "factorize.physics")


def _rule_of(session: Session, document: str) -> str:
    try:
        return str(json.loads(session.store.blobs.get(document))["rule"])
    except (DxbError, OSError, ValueError, KeyError):
        return ""


def _made(store: Store, workspace: str, *, old: bool) -> tuple[dict[str, _Made], dict[str, str]]:
    """Output digest -> who made it; and digest of an asset -> that of its URDF."""
    from dextera_build.runs import log

    made: dict[str, _Made] = {}
    urdf: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    for run in log.those(store, workspace=workspace):
        recipe = ""
        for event in log.read(store, run):
            if event["event"] == "run_started":
                recipe = f"{event['recipe']}{event.get('variant', '')}"
            if event["event"] != "node_finished" or not event.get("output"):
                continue
            rule, output, node = event["rule"], str(event["output"]), f"{recipe}:{event['node']}"
            if rule == URDF:
                urdf.setdefault(str(event.get("inputs", {}).get("asset", "")), output)
            if rule not in MADE_BY or (not old and (recipe, event["node"]) in seen):
                continue
            seen.add((recipe, event["node"]))
            one = made.setdefault(output, _Made(rule, []))
            if node not in one.nodes:
                one.nodes.append(node)
    return made, urdf


def _asset(project: Project, store: Store, output: str, made: _Made, urdf: Mapping[str, str]) -> Asset | None:
    """The asset behind an output; None if the store no longer holds it."""
    kind, address = MADE_BY[made.rule], min(made.nodes)
    try:
        value = decoded(project, store, made.rule, output)
    except (DxbError, OSError):
        return None
    return Asset(
        digest=output,
        kind=kind,
        name=_label(address) if kind == "object" else _room(address),
        source=value.asset_source,
        urdf=urdf.get(output, ""),
        nodes=tuple(sorted(made.nodes)),
        **facts(value, kind),
    )


def decoded(project: Project, store: Store, rule: str, output: str) -> Any:
    """Output of a rule, by its digest."""
    from dextera_build.artifacts.core.forms import type_among
    from dextera_build.store import headers

    returns = project.library.find(rule).rule.returns
    with headers.reading(f"`{rule}`"):
        return type_among(returns, output, store.reader).decode(output, store.reader)


def _label(address: str) -> str:
    """`blue_mug` of `twin/tabletop:body[blue_mug].asset`; copies of outer groups go before it: `photo_3/blue_mug`."""
    return "/".join(re.findall(r"\[([^\]]*)\]", address)) or address.rpartition(":")[2]


def _room(address: str) -> str:
    """`laptop_scene` of `twin/laptop_scene:background`."""
    recipe, _, node = address.partition(":")
    return "/".join([*re.findall(r"\[([^\]]*)\]", node), recipe.rpartition("/")[2]])
