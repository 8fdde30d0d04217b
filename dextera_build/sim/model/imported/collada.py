"""Triangles of COLLADA files (https://www.khronos.org/files/collada_spec_1_5.pdf), which URDF models often have.

Colours are ignored. `up_axis` is ignored, as in ROS; the unit is applied.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterator

import numpy as np

from dextera_build.errors import RuleError
from dextera_build.formats import bounds, mesh_bounds, xml_text
from dextera_build.geometry.baking import Part, joined


def as_obj(path: str, data: bytes) -> bytes:
    """The triangles of a scene as OBJ [m].

    Raises:
        RuleError: It is no COLLADA file, or has no triangles.
        ArtifactError: It has too many nodes, triangles or vertices, instances included.
    """
    try:
        document = _Document(path, xml_text.parsed(data))
        placed = (Part(points @ turn[:3, :3].T + turn[:3, 3], faces) for points, faces, turn in document.placed())
        parts = list(mesh_bounds.few(placed, path))
    except RecursionError:
        raise _damaged(path, "its nodes are nested too deeply, or refer to one another in a circle") from None
    except (ValueError, ArithmeticError, LookupError) as error:
        raise _damaged(path, str(error) or type(error).__name__) from None
    if not parts:
        raise _damaged(path, "it has no triangles")
    whole = joined(parts)
    return obj(whole.vertices * document.metres, whole.faces)


def obj(points: np.ndarray, faces: np.ndarray) -> bytes:
    """OBJ text of points (N, 3) and triangles (M, 3)."""
    # One format for all rows is several times as fast as one per row, and robots have meshes of a million rows.
    rows = "v %.9g %.9g %.9g\n" * len(points) % tuple(points.ravel().tolist())
    rows += "f %d %d %d\n" * len(faces) % tuple((faces + 1).ravel().tolist())
    return rows.encode()


def _damaged(path: str, why: str) -> RuleError:
    return RuleError(
        f"`{path}` cannot be read as COLLADA",
        code="DXB-B217",
        facts={"why": why},
        hint="export the mesh as STL or OBJ",
    )


class _Document:
    """A parsed file.

    Args:
        path: The file.
        root: Its `COLLADA` element.
    """

    def __init__(self, path: str, root: ET.Element) -> None:
        self._path, self._nodes = path, 0
        self._known: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {}
        for each in root.iter():
            each.tag = each.tag.rpartition("}")[2]
        self._root = root
        unit = root.find("asset/unit")
        self.metres = float(unit.get("meter", 1.0)) if unit is not None else 1.0
        self._ids = {each.get("id"): each for each in root.iter() if each.get("id")}

    def placed(self) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Points (N, 3), triangles (M, 3) and motion (4, 4) of every geometry in the scene."""
        scene = self._root.find("scene/instance_visual_scene")
        top = self._ids[scene.get("url", "").lstrip("#")] if scene is not None else self._root.find(".//visual_scene")
        if top is None:
            for geometry in self._root.iter("geometry"):
                yield from ((points, faces, np.eye(4)) for points, faces in self._triangles(geometry))
            return
        yield from self._below(top, np.eye(4))

    def _below(self, node: ET.Element, parent: np.ndarray) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        self._nodes += 1
        bounds.check(self._path, "nodes", self._nodes, bounds.MOST_PARTS)
        motion = parent
        for each in node:
            motion = motion @ _motion(each)
        for each in node.findall("instance_geometry"):
            name = each.get("url", "").lstrip("#")
            if name not in self._known:
                self._known[name] = list(self._triangles(self._ids[name]))
            yield from ((points, faces, motion) for points, faces in self._known[name])
        for each in node.findall("instance_node"):
            yield from self._below(self._ids[each.get("url", "").lstrip("#")], motion)
        for each in node.findall("node"):
            yield from self._below(each, motion)

    def _triangles(self, geometry: ET.Element) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        mesh = geometry.find("mesh")
        if mesh is None:
            return
        for part in mesh:
            if part.tag not in ("triangles", "polylist", "polygons"):
                continue
            inputs = part.findall("input")
            stride = 1 + max(int(each.get("offset", 0)) for each in inputs)
            vertex = _input(part, "VERTEX")
            points = self._points(vertex.get("source", ""))
            column = int(vertex.get("offset", 0))
            corners = [np.array((p.text or "").split(), np.int64)[column::stride] for p in part.findall("p")]
            if part.tag == "triangles":
                yield points, np.concatenate(corners).reshape(-1, 3)
                continue
            if part.tag == "polylist":
                sizes = np.array((part.findtext("vcount") or "").split(), np.int64)
                if len(sizes) and (sizes == 3).all():
                    yield points, np.concatenate(corners).reshape(-1, 3)
                    continue
                corners = np.split(np.concatenate(corners), np.cumsum(sizes)[:-1])
            fans = [
                np.stack([np.repeat(each[:1], len(each) - 2), each[1:-1], each[2:]], axis=1)
                for each in corners
                if len(each) > 2
            ]
            if fans:
                yield points, np.concatenate(fans)

    def _points(self, source: str) -> np.ndarray:
        element = self._ids[source.lstrip("#")]
        if element.tag == "vertices":
            element = self._ids[_input(element, "POSITION").get("source", "").lstrip("#")]
        numbers = np.array((element.findtext("float_array") or "").split(), np.float64)
        accessor = element.find("technique_common/accessor")
        stride = int(accessor.get("stride", 3)) if accessor is not None else 3
        return numbers.reshape(-1, stride)[:, :3]


def _input(element: ET.Element, semantic: str) -> ET.Element:
    for each in element.findall("input"):
        if each.get("semantic") == semantic:
            return each
    raise ValueError(f"a <{element.tag}> has no input {semantic}")


def _motion(element: ET.Element) -> np.ndarray:
    """(4, 4) of a transformation of a node; the identity of anything else."""
    found = np.eye(4)
    if element.tag not in ("matrix", "translate", "rotate", "scale"):
        return found
    numbers = np.array((element.text or "").split(), np.float64)
    if element.tag == "matrix":
        return numbers.reshape(4, 4)
    if element.tag == "translate":
        found[:3, 3] = numbers
    elif element.tag == "scale":
        found[:3, :3] = np.diag(numbers)
    else:
        from dextera_build.geometry.lie import rotation

        axis = numbers[:3] / max(float(np.linalg.norm(numbers[:3])), 1e-12)
        found[:3, :3] = rotation(np.radians(numbers[3]) * axis)
    return found
