"""The asset library's facts about one object or background."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any


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
    cut: bool
    """Whether the picture's border cuts it, so that a part of it is completed by symmetry."""
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
        more = (*moving, "cut") if self.cut else moving
        return " ".join((*own, *(more if self.kind == "object" else ()))).lower()

    def plain(self) -> dict[str, Any]:
        """The asset as JSON data."""
        return asdict(self)


def facts(value: Any, kind: str) -> dict[str, Any]:
    """Fields of an asset that follow from its artifact: an `Asset` of the simulator, or a `Background`."""
    return _of_object(value) if kind == "object" else _of_background(value)


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
        "cut": value.cut,
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
        "cut": False,
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
