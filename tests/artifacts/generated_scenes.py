"""Random nodes of scene descriptions, whose fields depend on one another."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from hypothesis import strategies as st

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.scenes.scene_description import (
    BodyNode,
    Box,
    CameraNode,
    Contact,
    Geom,
    Inertia,
    JointNode,
    Material,
    ObjectNode,
)
from dextera_build.artifacts.shapes.mesh import Hull, Mesh
from dextera_build.artifacts.spatial.pose import Pose

Draw = Callable[[st.SearchStrategy[Any]], Any]
PARTS = st.floats(0, 1)
LENGTHS = st.floats(0.001, 2)
VECTORS = st.tuples(*3 * [st.floats(-2, 2)])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]], np.int32)


def pose(draw: Draw, parent: str, child: str) -> Pose:
    angle, matrix = draw(st.floats(-3, 3)), np.eye(4)
    matrix[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    matrix[:3, 3] = draw(VECTORS)
    return Pose(parent=parent, child=child, matrix=matrix)


def material(draw: Draw) -> dict[str, Any]:
    return {"unlit": draw(st.booleans()), "roughness": draw(PARTS), "gloss": draw(PARTS)}


def contact(draw: Draw) -> dict[str, Any]:
    return {"friction": draw(LENGTHS), "restitution": draw(PARTS)}


def box(draw: Draw) -> dict[str, Any]:
    return {"half_size": draw(st.tuples(LENGTHS, LENGTHS, LENGTHS))}


def geom(draw: Draw, label: str = "geom") -> dict[str, Any]:
    size = np.float32(draw(st.floats(0.125, 1, width=32)))
    seen = Mesh(vertices=CORNERS * size, faces=FACES.copy())
    shape = draw(st.sampled_from([seen, Hull(vertices=CORNERS * size), Box(**box(draw))]))
    fields = {"label": label, "shape": shape, "pose": pose(draw, "body", "geom")}
    if shape is seen:
        return fields | {"role": "visual", "material": draw(st.sampled_from([None, Material(**material(draw))]))}
    return fields | {"role": "collision", "contact": draw(st.sampled_from([None, Contact(**contact(draw))]))}


def inertia(draw: Draw) -> dict[str, Any]:
    moments = (0.2, 0.3, 0.4, 0.0, 0.0, 0.0)
    return {"mass_kg": draw(LENGTHS), "centre": draw(VECTORS), "moments": moments}


def body(draw: Draw, label: str = "body") -> dict[str, Any]:
    count = draw(st.integers(0, 2))
    geoms = tuple(Geom(**geom(draw, f"{label}_{number}")) for number in range(count))
    return {"label": label, "inertia": Inertia(**inertia(draw)), "geoms": geoms}


def joint(draw: Draw, parent: str = "base", child: str = "lid") -> dict[str, Any]:
    lower, position, upper = sorted(draw(VECTORS))
    return {
        "name": f"to_{child}",
        "type": draw(st.sampled_from(["revolute", "prismatic"])),
        "parent": parent,
        "child": child,
        "origin": draw(VECTORS),
        "axis": (0.0, 0.6, 0.8),
        "lower": lower,
        "position": position,
        "upper": upper,
        "friction": draw(PARTS),
        "damping": draw(PARTS),
    }


def thing(draw: Draw, label: str = "thing") -> dict[str, Any]:
    parts = [f"part_{number}" for number in range(draw(st.integers(1, 3)))]
    links = {part: BodyNode(**body(draw, f"{label}_{part}")) for part in parts}
    joints = (JointNode(**joint(draw, parts[draw(st.integers(0, at))], parts[at + 1])) for at in range(len(parts) - 1))
    return {"pose": pose(draw, "world", "object"), "links": links, "joints": tuple(joints)}


def light(draw: Draw) -> dict[str, Any]:
    return {"label": "sun", "direction": draw(VECTORS), "place": draw(VECTORS), "diffuse": (0.5, 0.5, 0.5)}


def camera(draw: Draw, label: str = "eye") -> dict[str, Any]:
    lens = Camera(width=4, height=3, fx=5.0, fy=5.0, cx=1.5, cy=1.0)
    return {"label": label, "camera": lens, "pose": pose(draw, "world", "camera")}


def scene(draw: Draw) -> dict[str, Any]:
    things = tuple(ObjectNode(**thing(draw, f"thing_{number}")) for number in range(draw(st.integers(0, 2))))
    bodies = [part.label for each in things for part in each.links.values()]
    pairs = [(one, other) for one in bodies for other in bodies if one < other]
    return {
        "objects": things,
        "static": tuple(Geom(**geom(draw, f"static_{number}")) for number in range(draw(st.integers(0, 2)))),
        "cameras": tuple(
            CameraNode(**camera(draw, label)) for label in draw(st.sampled_from([(), ("a",), ("a", "b")]))
        ),
        "exclude": tuple(draw(st.lists(st.sampled_from(pairs), unique=True))) if pairs else (),
        "backdrop": (0.1, 0.2, 0.3),
    }
