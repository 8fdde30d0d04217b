"""What viewers of recordings draw: the robot as URDF, shapes of the objects, and frames of all links."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any
from xml.etree.ElementTree import SubElement

import numpy as np

from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.formats import urdf_xml
from dextera_build.formats.ros import markers, messages
from dextera_build.formats.ros.markers import Marker
from dextera_build.formats.ros.recording import LATCHED, Recording
from dextera_build.geometry import poses
from dextera_build.sim.model import links, skins, urdf
from dextera_build.sim.model.compose import ROBOT
from dextera_build.sim.model.model import compile_folder

Edge = tuple[str, str, np.ndarray]
"""Parent, child, and the child's pose in it: (7,), or (T, 7) of all steps."""
PACKAGE = "package://robot/"
"""Prefix of mesh paths in `/robot_description`; the files are attachments of the recording."""
PATCH_M, MOST_FACES = 0.02, 8000
"""Triangles have one colour each: maximum edge length of textured ones [m], and maximum number of faces."""
HIGH_M = 1.0
"""Boxes with a higher top are walls, which would hide the scene [m]."""
BOX = 6
"""`mjtGeom.mjGEOM_BOX`."""


class Shapes:
    """The links and shapes of a task, common to all its recordings.

    Args:
        bundle: The task.

    Raises:
        RuleError: MuJoCo cannot load the model.
    """

    def __init__(self, bundle: TaskBundle) -> None:
        self._robot, self._model = bundle.robot, compile_folder(bundle.model)
        self._arm = links.tree(self._model, ROBOT + urdf.BASE, prefix=ROBOT)
        self._things = {root: links.tree(self._model, root) for root in bundle.objects}
        self.urdf = urdf.write(bundle.robot)
        """`robot.urdf`, and its meshes."""

    @property
    def clashes(self) -> set[str]:
        """Names that a link of the robot and one of the objects share."""
        return set(self._arm.shifts) & {link for tree in self._things.values() for link in tree.shifts}

    def fixed(self, sizes: Mapping[str, float]) -> list[Edge]:
        """Edges that never move.

        Args:
            sizes: Object -> factor of its lengths; 1 where it is left out.
        """
        return [
            (edge.parent, edge.child, poses.from_matrix(edge.origin))
            for tree in (self._arm, *self._sized(sizes))
            for edge in tree.edges
            if edge.type == "fixed"
        ]

    def moving(self, joints: Mapping[str, np.ndarray], sizes: Mapping[str, float]) -> list[Edge]:
        """Edges that move, at T times, without those whose joint is not given.

        Args:
            joints: Joint of the robot or of an object -> positions (T,) [rad or m].
            sizes: See `fixed`.
        """
        known = dict(joints)
        for follower in self._robot.followers:
            if follower.leader in known:
                known[follower.name] = follower.ratio * known[follower.leader] + follower.offset
        return links.poses_at((self._arm, *self._sized(sizes)), known.get)

    def send(self, recording: Recording, time: int, sizes: Mapping[str, float]) -> None:
        """Write the robot's description and all shapes, once.

        Args:
            recording: The recording.
            time: Time of the recording [ns].
            sizes: See `fixed`.
        """
        text = self.urdf.files[urdf.MAIN].decode().replace('filename="meshes/', f'filename="{PACKAGE}meshes/')
        recording.send("/robot_description", "std_msgs/String", time, messages.text(text), LATCHED)
        recording.attach_files(self.urdf.files)
        shapes = {"/scene/static": self._static()}
        if len(self.urdf.files) > 1:  # viewers may not find meshes
            shapes["/robot/visual"] = self._surfaces(self._arm, ROBOT, 1.0)
        for topic, found in shapes.items():
            message = markers.marker_array(time, found)
            recording.send(topic, "visualization_msgs/MarkerArray", time, message, LATCHED)
        self.send_objects(recording, time, self._things, sizes)

    def send_objects(self, recording: Recording, time: int, names: Collection[str], sizes: Mapping[str, float]) -> None:
        """Write the shapes of some objects; see `send`."""
        trees = {name: self._things[name].sized(sizes.get(name, 1.0)) for name in names}
        found = [marker for name in trees for marker in self._surfaces(self._things[name], "", sizes.get(name, 1.0))]
        message = markers.marker_array(time, found)
        recording.send("/scene/objects", "visualization_msgs/MarkerArray", time, message, LATCHED)
        for name, tree in trees.items():
            boxes = messages.text(self._boxes(name, tree, sizes.get(name, 1.0)))
            recording.send(f"/scene/{name}/robot_description", "std_msgs/String", time, boxes, LATCHED)

    def _sized(self, sizes: Mapping[str, float]) -> list[links.Tree]:
        return [tree.sized(sizes.get(root, 1.0)) for root, tree in self._things.items()]

    def _surfaces(self, tree: links.Tree, prefix: str, scale: float) -> list[Marker]:
        return [
            triangles(link, f"{link}/{number}", skin, shift, scale)
            for link, shift in tree.shifts.items()
            for number, skin in enumerate(skins.visible(self._model, int(self._model.body(prefix + link).id)))
        ]

    def _boxes(self, root: str, tree: links.Tree, scale: float) -> str:
        """An object as URDF with a box around the surface of each link, for viewers that draw no markers."""
        robot = urdf_xml.root(root)
        for link in [root, *(edge.child for edge in tree.edges)]:
            node = SubElement(robot, "link", name=link)
            body = int(self._model.body(link).id) if link in tree.shifts else -1
            skins_of = skins.visible(self._model, body) if body >= 0 else []
            if not skins_of:
                continue
            corners = scale * np.concatenate([each.vertices for each in skins_of]) - tree.shifts[link]
            low, high = corners.min(axis=0), corners.max(axis=0)
            visual = SubElement(node, "visual")
            urdf_xml.origin(visual, (low + high) / 2)
            SubElement(SubElement(visual, "geometry"), "box", size=urdf_xml.numbers((high - low).tolist()))
            material = SubElement(visual, "material", name=link)
            SubElement(material, "color", rgba=urdf_xml.numbers(mean_colour(skins_of[0])))
        for edge in tree.edges:
            joint = SubElement(robot, "joint", name=edge.joint, type=edge.type)
            urdf_xml.origin(joint, edge.origin[:3, 3], edge.origin[:3, :3])
            SubElement(joint, "parent", link=edge.parent)
            SubElement(joint, "child", link=edge.child)
            if edge.type != "fixed":
                SubElement(joint, "axis", xyz=urdf_xml.numbers(edge.axis.tolist()))
                lower, upper = map(urdf_xml.number, self._model.joint(edge.joint).range)
                SubElement(joint, "limit", lower=lower, upper=upper, effort="0.0", velocity="0.0")
        return urdf_xml.text(robot).decode()

    def _static(self) -> list[Marker]:
        """Collision boxes of the static scene, half transparent, without walls."""
        model: Any = self._model
        return [
            Marker(
                "world",
                model.geom(geom).name or f"static_{geom}",
                markers.CUBE,
                (0.6, 0.6, 0.6, 0.5),
                np.concatenate([model.geom_pos[geom], model.geom_quat[geom]]),
                2 * model.geom_size[geom],
            )
            for geom in range(int(model.body_geomnum[0]))
            if model.geom_type[geom] == BOX
            and (model.geom_contype[geom] or model.geom_conaffinity[geom])
            and model.geom_pos[geom, 2] + model.geom_size[geom, 2] < HIGH_M
        ]


def mean_colour(skin: skins.Skin) -> list[float]:
    """The colour (4,) of a surface, or the mean of its texture, sRGB 0..1."""
    if skin.texture is None:
        return list(skin.colour)
    return [*(skin.texture.reshape(-1, 3).mean(axis=0) / 255).tolist(), 1.0]


def triangles(frame: str, name: str, skin: skins.Skin, shift: np.ndarray, scale: float) -> Marker:
    """A surface in a link whose origin is at `shift` (3,) [m] in the frame of the surface."""
    corners = scale * (skin.vertices.astype(np.float64) - shift)[skin.faces]
    colours = np.zeros((0, 4), np.float32)
    if skin.texture is not None and skin.uv is not None:
        corners, uv = _fine(corners, skin.uv.reshape(-1, 3, 2))
        height, width = skin.texture.shape[:2]
        u, v = uv.mean(axis=1).T
        rows, columns = ((1 - v) % 1.0 * height).astype(int), (u % 1.0 * width).astype(int)
        faces = np.ones((len(u), 4), np.float32)
        faces[:, :3] = skin.texture[rows.clip(0, height - 1), columns.clip(0, width - 1)] / np.float32(255)
        colours = faces.repeat(3, axis=0)
    return Marker(frame, name, markers.TRIANGLES, skin.colour, points=corners.reshape(-1, 3), colours=colours)


def _fine(corners: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (F, 3, 3) [m] and texture coordinates (F, 3, 2) of faces; large ones are halved repeatedly."""
    while len(corners) < MOST_FACES:
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        large = lengths.max(axis=1) > PATCH_M
        if not large.any():
            break
        # The longest edge comes first.
        order = (lengths[large].argmax(axis=1)[:, None] + np.arange(3)) % 3
        corners, uv = (np.concatenate([each[~large], _halves(each[large], order)]) for each in (corners, uv))
    return corners, uv


def _halves(corners: np.ndarray, order: np.ndarray) -> np.ndarray:
    a, b, c = np.moveaxis(np.take_along_axis(corners, order[:, :, None], axis=1), 1, 0)
    middle = (a + b) / 2
    return np.concatenate([np.stack(part, axis=1) for part in ((a, middle, c), (middle, b, c))])
