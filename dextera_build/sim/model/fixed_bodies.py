"""Scenes with fixed bodies, which become part of the static scene, with visual and collision geometry."""

from __future__ import annotations

from collections.abc import Collection
from xml.etree import ElementTree

from dextera_build.artifacts.base import Folder

_FREE, _SINGLE = 7, 1
"""Positions of a free joint and of any other joint of a scene."""


def hold(scene: Folder, names: Collection[str], apart: Collection[tuple[str, str]] = ()) -> Folder:
    """The scene without the free joints of some bodies; keyframe `home` loses their positions.

    Args:
        scene: `scene.xml` and its files.
        names: Root bodies to fix.
        apart: Pairs of root bodies that do not collide with each other.
    """
    root = ElementTree.fromstring(scene.files["scene.xml"])
    world, key = root.find("worldbody"), root.find("keyframe/key")
    assert world is not None
    left = [] if key is None else key.attrib["qpos"].split()
    kept: list[str] = []
    for body in world.iter("body"):
        for joint in [child for child in body if child.tag in ("freejoint", "joint")]:
            count = _FREE if joint.tag == "freejoint" else _SINGLE
            positions, left = left[:count], left[count:]
            if joint.tag == "freejoint" and body.attrib["name"] in names:
                body.remove(joint)
            else:
                kept += positions
    if key is not None:
        key.set("qpos", " ".join(kept))
    contact = root.find("contact")
    if apart and contact is None:
        contact = ElementTree.SubElement(root, "contact")
    for first, second in sorted(apart):
        assert contact is not None
        ElementTree.SubElement(contact, "exclude", body1=first, body2=second)
    ElementTree.indent(root, "  ")
    text = ElementTree.tostring(root, encoding="unicode") + "\n"
    return scene.model_copy(update={"files": {**scene.files, "scene.xml": text.encode()}})
