"""Pieces of URDF text: numbers, origins, meshes, and the root element that MuJoCo reads without dropping anything."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree

import numpy as np

Node = ElementTree.Element


def root(name: str) -> Node:
    """The element `robot`. By default, MuJoCo drops folders from mesh paths, visuals, and the mass of the root link."""
    robot = Node("robot", name=name)
    compiler = {"strippath": "false", "discardvisual": "false", "fusestatic": "false", "balanceinertia": "false"}
    ElementTree.SubElement(ElementTree.SubElement(robot, "mujoco"), "compiler", compiler)
    return robot


def text(robot: Node) -> bytes:
    """The file of a root element."""
    ElementTree.indent(robot)
    written: bytes = ElementTree.tostring(robot, encoding="utf-8", xml_declaration=True)
    return written + b"\n"


def origin(node: Node, xyz: np.ndarray, rotation: np.ndarray | None = None) -> None:
    """Add an origin at `xyz` (3,) [m] with rotation `rotation` (3, 3)."""
    rpy = "0 0 0" if rotation is None else numbers(fixed_axes(rotation).tolist())
    ElementTree.SubElement(node, "origin", xyz=numbers(np.asarray(xyz).tolist()), rpy=rpy)


def mesh(node: Node, filename: str) -> None:
    """Add a mesh as the geometry."""
    ElementTree.SubElement(ElementTree.SubElement(node, "geometry"), "mesh", filename=filename)


def fixed_axes(rotation: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw (3,) [rad] of a rotation (3, 3): about the fixed x, then y, then z axis (URDF)."""
    flat = np.hypot(rotation[0, 0], rotation[1, 0])
    pitch = np.arctan2(-rotation[2, 0], flat)
    if flat < 1e-9:  # gimbal lock: roll and yaw rotate about one axis
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    return np.array([roll, pitch, np.arctan2(rotation[1, 0], rotation[0, 0])])


def numbers(values: Sequence[float]) -> str:
    """Numbers of an attribute."""
    return " ".join(number(value) for value in values)


def number(value: float) -> str:
    """Shortest text that round-trips the double; no negative zero."""
    return repr(float(value) + 0.0)
