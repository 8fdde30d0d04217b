"""The twin as one binary file for the page: surfaces of all bodies, and which bodies are ghosts of retargeted hands.

A JSON text with its length before it (u32), filled to 4 bytes, and then numbers and pictures; places in it are in bytes
after the text.
"""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np

from dextera_build.geometry import hands, poses, quaternions, transforms
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.skins import Skin, visible
from dextera_build.sim.retarget.matching import Matched
from dextera_build.sim.runtime.environment import Environment
from dextera_build.teleop import posture, viewpoint

QUALITY = 88
"""JPEG quality of textures."""


class _Blobs:
    def __init__(self) -> None:
        self.data = bytearray()

    def add(self, values: bytes) -> list[int]:
        """Place and size [byte]."""
        place = [len(self.data), len(values)]
        self.data += values + bytes(-len(values) % 4)
        return place


def written(environment: Environment, own: Mapping[str, Matched]) -> bytes:
    """The file of a task.

    Args:
        environment: The task, at a start.
        own: Limb -> its hand, whose links are drawn a second time as ghosts, in this order.
    """
    model, blobs = environment.model, _Blobs()
    skins = [_skin(blobs, body, skin) for body in range(model.nbody) for skin in visible(model, body)]
    ghosts = [model.body(ROBOT + link).id for each in own.values() for link in each.hand.links]
    starts = _wrists(environment, own)
    palms = [np.array(each["palm"]) for each in starts]
    look, eye = viewpoint.first(environment, palms)
    facts = {
        "bodies": [model.body(body).name for body in range(model.nbody)],
        "roots": [model.body(int(root)).name for root in model.body_rootid],
        "skins": skins,
        "ghosts": ghosts,
        "base": environment.bundle.base_pose.matrix.ravel().tolist(),
        "parents": list(hands.PARENTS),
        "wrists": starts,
        "middle": np.mean(palms, axis=0).tolist(),
        "look": look.tolist(),
        "eye": eye.tolist(),
        "task": environment.bundle.task.name,
    }
    text = json.dumps(facts).encode()
    text += b" " * (-len(text) % 4)
    return struct.pack("<I", len(text)) + text + bytes(blobs.data)


def _wrists(environment: Environment, own: Mapping[str, Matched]) -> list[dict[str, Any]]:
    """Per hand that the robot follows: its side, the robot's palm [m], and a wrist, all in the base.

    The wrist, position [m] and quaternion x y z w, is that of an operator whose knuckles are those of the robot.
    """
    found = []
    knuckles = posture.joints(np.tile([0, 0, 0, 0, 0, 0, 1.0], (2, 1)), np.zeros(2))[:, list(hands.KNUCKLES[1:]), :3]
    palms = dict(zip(environment.bundle.robot.limb_names, environment.palm_poses(), strict=True))
    for limb, each in own.items():
        side, palm = hands.SIDES.index(each.side), poses.to_matrix(palms[limb])
        turn = palm[:3, :3] @ each.turn
        place = transforms.apply(palm, each.anchor) - turn @ knuckles[side].mean(axis=0)
        w, x, y, z = quaternions.from_matrix(turn).tolist()
        found.append({"side": side, "palm": palm[:3, 3].tolist(), "pose": [*place.tolist(), x, y, z, w]})
    return found


def _skin(blobs: _Blobs, body: int, skin: Skin) -> dict[str, Any]:
    found: dict[str, Any] = {"body": body, "colour": [float(part) for part in skin.colour], "glows": skin.glows}
    vertices, faces = skin.vertices, skin.faces
    if skin.texture is not None and skin.uv is not None:
        # Texture coordinates are by corner.
        vertices, faces = vertices[faces].reshape(-1, 3), np.arange(3 * len(faces))
        found["uv"] = blobs.add(np.ascontiguousarray(skin.uv, "<f4").tobytes())
        found["texture"] = blobs.add(_picture(skin.texture))
    found["vertices"] = blobs.add(np.ascontiguousarray(vertices, "<f4").tobytes())
    found["faces"] = blobs.add(np.ascontiguousarray(faces, "<u4").tobytes())
    return found


def _picture(pixels: np.ndarray) -> bytes:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "JPEG", quality=QUALITY)
    return out.getvalue()
