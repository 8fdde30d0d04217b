"""Links and joints of a URDF, with the geometry of its visuals, in one frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Joint, Link
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.artifacts.shapes.mesh_repair import repaired
from dextera_build.formats import named_files, xml_text
from dextera_build.formats.mesh import load
from dextera_build.geometry import metrics, transforms
from dextera_build.geometry.baking import Part, joined

Node = ElementTree.Element


def read(path: Path) -> tuple[dict[str, Link], tuple[Joint, ...]]:
    """Links and joints in the frame of the root link, with every joint at 0; `base` is the root.

    Links at fixed joints are merged with their parents, and further roots with the largest one; surfaces are closed
    where possible. Limits are widened to contain 0, the position of the joints.

    Args:
        path: The URDF; its meshes are in the same folder, in its unit of length.

    Raises:
        ValueError: It is no URDF, its joints form no tree, or one is neither revolute, prismatic nor fixed.
        ArtifactError: A mesh cannot be read.
    """
    try:
        root = xml_text.parsed(path.read_bytes())
    except ValueError as error:
        raise ValueError(f"it is no XML: {error}") from None
    meshes = {_text(node, "name"): list(_visuals(node, path)) for node in root.iter("link")}
    if not meshes:
        raise ValueError("it has no links")
    joints = [node for node in root.findall("joint") if _text(node, "type") != "fixed"]
    for node in joints:
        if _text(node, "type") not in ("revolute", "prismatic"):
            raise ValueError(f"joint `{_text(node, 'name')}` is of type {_text(node, 'type')}")
    poses = _poses(root, list(meshes))
    placed = {name: [_moved(poses[name] @ pose, mesh) for pose, mesh in parts] for name, parts in meshes.items()}
    owner = _owners(root, placed)
    together: dict[str, list[Mesh]] = {
        name: [] for name in sorted(set(owner.values()), key=lambda name: name != "base")
    }
    for name, parts in placed.items():
        together[owner[name]] += parts
    for name, parts in together.items():
        if not parts:
            raise ValueError(f"link `{name}` has no mesh")
    links = {name: Link(mesh=_fused(parts)) for name, parts in together.items()}
    return links, tuple(_joint(node, poses, owner) for node in joints)


def _visuals(link: Node, path: Path) -> Iterator[tuple[np.ndarray, Mesh]]:
    for visual in link.findall("visual"):
        node = visual.find("geometry/mesh")
        if node is not None:
            scale = _numbers(node.get("scale"), (1.0, 1.0, 1.0))
            mesh = named_files.found(_text(node, "filename"), path, path.parent)
            yield _origin(visual) @ np.diag([*scale, 1.0]), load(mesh, within=path.parent)


def _poses(root: Node, names: list[str]) -> dict[str, np.ndarray]:
    """Link -> (4, 4) pose in the frame of the roots."""
    waiting = {_end(node, "child"): node for node in root.findall("joint")}
    poses = {name: np.eye(4) for name in names if name not in waiting}
    while waiting:
        ready = [child for child, node in waiting.items() if _end(node, "parent") in poses]
        if not ready:
            raise ValueError(f"link `{next(iter(waiting))}` cannot be reached from a root")
        for child in ready:
            node = waiting.pop(child)
            poses[child] = poses[_end(node, "parent")] @ _origin(node)
    if unknown := sorted(set(poses) - set(names)):
        raise ValueError(f"a joint moves `{unknown[0]}`, which is no link")
    return poses


def _owners(root: Node, placed: dict[str, list[Mesh]]) -> dict[str, str]:
    """Link -> the link that it is merged into."""
    parents = {_end(node, "child"): node for node in root.findall("joint")}
    roots = [name for name in placed if name not in parents]
    areas = {
        name: sum(float(metrics.face_areas(mesh.vertices, mesh.faces).sum()) for mesh in placed[name]) for name in roots
    }
    main = max(roots, key=lambda name: areas[name])
    if "base" in placed and main != "base":
        raise ValueError("a link is called `base`, but it is not the root")

    def owner(name: str) -> str:
        if name in roots:
            return "base"
        fixed = _text(parents[name], "type") == "fixed"
        return owner(_end(parents[name], "parent")) if fixed else name

    return {name: owner(name) for name in placed}


def _joint(node: Node, poses: dict[str, np.ndarray], owner: dict[str, str]) -> Joint:
    child = _end(node, "child")
    axis_node, limit = node.find("axis"), node.find("limit")
    axis = poses[child][:3, :3] @ _numbers(None if axis_node is None else axis_node.get("xyz"), (1.0, 0.0, 0.0))
    if limit is None or not np.linalg.norm(axis):
        raise ValueError(f"joint `{_text(node, 'name')}` has no limits or no axis")
    lower, upper = (float(limit.get(name, 0.0)) for name in ("lower", "upper"))
    x, y, z = poses[child][:3, 3].tolist()
    ax, ay, az = (axis / np.linalg.norm(axis)).tolist()
    return Joint(
        name=_text(node, "name"),
        type="revolute" if node.get("type") == "revolute" else "prismatic",
        parent=owner[_end(node, "parent")],
        child=child,
        origin=(x, y, z),
        axis=(ax, ay, az),
        lower=min(lower, upper, 0.0),
        upper=max(lower, upper, 0.0),
        position=0.0,
    )


def _fused(meshes: list[Mesh]) -> Mesh:
    """Closed surfaces as one mesh with one texture."""
    closed = [repaired(mesh)[0] for mesh in meshes]
    if len(closed) == 1:
        return closed[0]
    parts = [
        Part(
            mesh.vertices,
            mesh.faces,
            mesh.colour,
            uv=mesh.uv,
            picture=None if mesh.texture is None else mesh.texture.pixels,
        )
        for mesh in closed
    ]
    whole = joined(parts)
    return Mesh(
        vertices=whole.vertices.astype(np.float32),
        faces=whole.faces.astype(np.int32),
        uv=None if whole.uv is None else whole.uv.astype(np.float32),
        texture=None if whole.picture is None else Image(pixels=np.ascontiguousarray(whole.picture)),
        colour=whole.colour,
    )


def _moved(motion: np.ndarray, mesh: Mesh) -> Mesh:
    vertices = transforms.apply(motion, mesh.vertices.astype(np.float64)).astype(np.float32)
    return mesh.model_copy(update={"vertices": vertices})


def _origin(node: Node) -> np.ndarray:
    found = node.find("origin")
    if found is None:
        return np.eye(4)
    roll, pitch, yaw = _numbers(found.get("rpy"), (0.0, 0.0, 0.0))
    turn = _about(2, yaw) @ _about(1, pitch) @ _about(0, roll)
    return transforms.rigid(turn, _numbers(found.get("xyz"), (0.0, 0.0, 0.0)))


def _about(axis: int, angle: float) -> np.ndarray:
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turn = np.eye(3)
    turn[[first, second], [first, second]] = math.cos(angle)
    turn[first, second], turn[second, first] = -math.sin(angle), math.sin(angle)
    return turn


def _numbers(text: str | None, default: tuple[float, float, float]) -> np.ndarray:
    values = np.array([float(word) for word in text.split()] if text is not None else default)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ValueError(f"`{text}` are not three numbers")
    return values


def _end(joint: Node, side: str) -> str:
    found = joint.find(side)
    return "" if found is None else _text(found, "link")


def _text(node: Node, name: str) -> str:
    if not (text := node.get(name)):
        raise ValueError(f"<{node.tag}> has no `{name}`")
    return text
