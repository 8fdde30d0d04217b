"""MJCF with all digits."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from typing import Any

import numpy as np


def precise(text: str, model: Any) -> str:
    """MJCF whose frames, axes, limits and inertias have all digits; MuJoCo writes six.

    Args:
        text: What `MjSpec.to_xml` returned.
        model: The compiled model.
    """
    root = ET.fromstring(text)
    for element in root.iter("body"):
        body = model.body(element.get("name"))
        _write(element, pos=body.pos, quat=body.quat)
        for part in element:
            if part.tag == "joint":
                joint = model.joint(part.get("name"))
                _write(part, pos=joint.pos, axis=joint.axis)
                if model.jnt_limited[joint.id]:
                    _write(part, range=joint.range)
            elif part.tag == "site" and part.get("name"):
                site = model.site(part.get("name"))
                _write(part, pos=site.pos, quat=site.quat)
            elif part.tag == "inertial" and "fullinertia" not in part.attrib:
                _write(part, pos=body.ipos, quat=body.iquat, mass=body.mass, diaginertia=body.inertia)
    return ET.tostring(root, encoding="unicode")


def _write(element: ET.Element, **values: Any) -> None:
    for name, numbers in values.items():
        element.set(name, " ".join(repr(float(number)) for number in np.atleast_1d(numbers)))
