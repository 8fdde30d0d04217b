"""The asset library of a project: every object and background that its builds made and the store still holds."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Any

from dextera_build.errors import DxbError
from dextera_build.session import Session, reading

if TYPE_CHECKING:
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store

MADE_BY = {"simulate.asset": "object", "background.static": "background"}
"""Rule -> kind of asset that it makes."""
URDF = "simulate.urdf"


@dataclass(frozen=True)
class JointFacts:
    """One joint: lengths in m, angles in rad."""

    name: str
    type: str
    lower: float
    upper: float
    position: float


@dataclass(frozen=True)
class Asset:
    """One asset. Two builds of the same bytes are one asset; fields that do not apply are None or empty."""

    digest: str
    """SHA-256 of the artifact: the identity."""
    kind: str
    """`object` or `background`."""
    name: str
    """Label of the object, or the recipe's last word for a background."""
    category: str
    """`mug`, `laptop`, ...; of a background `room`."""
    source: str
    """`rgb`: made from the photograph alone; `rgbd`: with the help of measured depth."""
    scale: str
    """Where the unit of length comes from: `depth`, `marker`, `robot`, `size`, `unknown`."""
    size_m: tuple[float, float, float] | None
    """Extent along x, y, z of the object's frame, joints as in the photograph; of a background in the world [m]."""
    mass_kg: float | None
    mass_low_kg: float | None
    """Lower end of the 90 % interval."""
    mass_high_kg: float | None
    """Upper end of the 90 % interval."""
    material: str
    friction: float | None
    joints: tuple[JointFacts, ...]
    collision_pieces: int
    triangles: int
    urdf: str
    """SHA-256 of the folder that `simulate.urdf` made of it; "" if none was built."""
    nodes: tuple[str, ...] = field(default=())
    """Addresses of the nodes that returned it, sorted."""

    def words(self) -> str:
        """Text that a search looks in."""
        moving = ["articulated", *(joint.type for joint in self.joints)] if self.joints else ["rigid"]
        own = (self.name, self.kind, self.category, self.material, self.source, *self.nodes)
        return " ".join((*own, *(moving if self.kind == "object" else ()))).lower()

    def plain(self) -> dict[str, Any]:
        """The asset as JSON data."""
        return asdict(self)


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
    store = reading(project)
    made, urdf = _made(store, old=old)
    found = [asset for output, each in made.items() if (asset := _asset(project, store, output, each, urdf))]
    return sorted(found, key=lambda asset: (asset.kind != "object", asset.name, asset.digest))


def notes(session: Session) -> dict[str, list[str]]:
    """Object -> what the last build of a request made of it, in words."""
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


def _made(store: Store, *, old: bool) -> tuple[dict[str, _Made], dict[str, str]]:
    """Output digest -> who made it; and digest of an asset -> that of its URDF."""
    from dextera_build.runs import log

    made: dict[str, _Made] = {}
    urdf: dict[str, str] = {}
    seen: set[tuple[str, str]] = set()
    for run in reversed(log.runs(store)):
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
    own = _of_object(value) if kind == "object" else _of_background(value)
    return Asset(
        digest=output,
        kind=kind,
        name=_label(address) if kind == "object" else _room(address),
        source=value.asset_source,
        urdf=urdf.get(output, ""),
        nodes=tuple(sorted(made.nodes)),
        **own,
    )


def decoded(project: Project, store: Store, rule: str, output: str) -> Any:
    """What a rule returned, by its digest."""
    from dextera_build.artifacts.forms import type_among
    from dextera_build.store import headers

    returns = project.library.find(rule).rule.returns
    with headers.reading(f"`{rule}`"):
        return type_among(returns, output, store.reader).decode(output, store.reader)


def _of_object(value: Any) -> dict[str, Any]:
    from dextera_build.geometry import kinematics, transforms

    poses = kinematics.link_poses(value.body)
    meshes = {name: link.mesh for name, link in value.body.links.items()}
    points = [transforms.apply(poses[name], mesh.vertices) for name, mesh in meshes.items()]
    links = value.physics.links.values()
    return {
        "category": value.category,
        "scale": value.scale,
        "size_m": _extent(points),
        "mass_kg": round(sum(link.mass_kg for link in links), 6),
        "mass_low_kg": round(sum(link.mass_low_kg for link in links), 6),
        "mass_high_kg": round(sum(link.mass_high_kg for link in links), 6),
        "material": value.physics.material,
        "friction": value.physics.friction,
        "joints": tuple(
            JointFacts(joint.name, joint.type, joint.lower, joint.upper, joint.position) for joint in value.body.joints
        ),
        "collision_pieces": sum(len(pieces.hulls) for pieces in value.collision.links.values()),
        "triangles": sum(len(mesh.faces) for mesh in meshes.values()),
    }


def _of_background(value: Any) -> dict[str, Any]:
    meshes = [mesh for mesh in (value.mesh, value.invented) if mesh is not None]
    return {
        "category": "room",
        "scale": "",
        "size_m": _extent([mesh.vertices for mesh in meshes]),
        "mass_kg": None,
        "mass_low_kg": None,
        "mass_high_kg": None,
        "material": "",
        "friction": None,
        "joints": (),
        "collision_pieces": len(value.boxes),
        "triangles": sum(len(mesh.faces) for mesh in meshes),
    }


def _extent(points: list[Any]) -> tuple[float, float, float]:
    """Edges of the bounding box of points [(V, 3)], to 0.1 mm [m]."""
    import numpy as np

    together = np.concatenate(points)
    x, y, z = (round(float(edge), 4) for edge in together.max(axis=0) - together.min(axis=0))
    return x, y, z


def _label(address: str) -> str:
    """`blue_mug` of `twin/tabletop:body[blue_mug].asset`; copies of outer groups go before it: `photo_3/blue_mug`."""
    return "/".join(re.findall(r"\[([^\]]*)\]", address)) or address.rpartition(":")[2]


def _room(address: str) -> str:
    """`laptop_scene` of `twin/laptop_scene:background`."""
    recipe, _, node = address.partition(":")
    return "/".join([*re.findall(r"\[([^\]]*)\]", node), recipe.rpartition("/")[2]])
