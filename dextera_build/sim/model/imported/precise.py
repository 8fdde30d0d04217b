"""MJCF with full precision."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np

from dextera_build.geometry import poses, transforms


def precise(text: str, model: Any) -> str:
    """MJCF with bodies, axes, limits and inertias in full precision; MuJoCo writes six digits.

    Args:
        text: Output of `MjSpec.to_xml`; bodies and joints have names.
        model: The compiled model.
    """
    root = ET.fromstring(text)
    world = root.find("worldbody")
    if world is not None:
        _below(world, np.eye(4), model)
    return ET.tostring(root, encoding="unicode")


def _below(element: ET.Element, frame: np.ndarray, model: Any) -> None:
    """Rewrite the content of a body, or of a `<frame>` whose pose in its body is `frame` (4, 4).

    The rounded pose of a frame is kept; its content is written relative to it.
    """
    for part in element:
        if part.tag == "frame":
            own = np.array(_numbers(part, "pos", "0 0 0") + _numbers(part, "quat", "1 0 0 0"))
            own[3:] /= np.linalg.norm(own[3:])
            _below(part, frame @ poses.to_matrix(own), model)
        elif part.tag == "body":
            body = model.body(part.get("name"))
            _place(part, body.pos, body.quat, frame)
            _below(part, np.eye(4), model)
        elif part.tag == "joint":
            joint = model.joint(part.get("name"))
            inside = transforms.invert(frame)
            _write(part, pos=transforms.apply(inside, joint.pos[None])[0], axis=inside[:3, :3] @ joint.axis)
            if model.jnt_limited[joint.id]:
                _write(part, range=joint.range)
        elif part.tag == "site" and part.get("name"):
            site = model.site(part.get("name"))
            _place(part, site.pos, site.quat, frame)
        elif part.tag == "inertial" and "fullinertia" not in part.attrib:
            body = model.body(element.get("name"))
            _write(part, pos=body.ipos, quat=body.iquat, mass=body.mass, diaginertia=body.inertia)


def _place(element: ET.Element, place: np.ndarray, turn: np.ndarray, frame: np.ndarray) -> None:
    found = np.append(place, turn)
    if not np.array_equal(frame, np.eye(4)):
        found = poses.from_matrix(transforms.invert(frame) @ poses.to_matrix(found))
    for name in ("axisangle", "euler", "xyaxes", "zaxis", "fromto"):
        element.attrib.pop(name, None)
    _write(element, pos=found[:3], quat=found[3:])


def _numbers(element: ET.Element, name: str, default: str) -> list[float]:
    return [float(each) for each in element.get(name, default).split()]


def _write(element: ET.Element, **values: Any) -> None:
    for name, numbers in values.items():
        element.set(name, " ".join(repr(float(number)) for number in np.atleast_1d(numbers)))
