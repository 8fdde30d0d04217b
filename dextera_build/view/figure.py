"""A MuJoCo model in a viser scene: one node per body, which follows the simulator, and labels of its objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from dextera_build.sim.model.skins import Skin, colliding, visible

ABOVE_M = 0.03
"""Gap between an object and its label [m]."""
STILL = 1e-6
"""Changes of position [m] and quaternion below this are not sent."""


@dataclass(frozen=True)
class Fact:
    """Text of a label after the object's name."""

    mass_kg: float
    """Mass of the whole object [kg]."""
    interval_kg: tuple[float, float] | None = None
    """90 % interval of the true mass [kg]."""
    material: str = ""
    """Row of the material table; empty if unknown."""
    friction: float | None = None
    """Sliding friction coefficient."""
    held: str = ""
    """Why the object is fixed in the scene; "" if it moves freely."""
    cut: bool = False
    """Whether the picture's border cuts the object."""

    def short(self, name: str) -> str:
        """One line: name and mass, and whether it is held."""
        words = [name, mass(self.mass_kg), "held" if self.held else ""]
        return " · ".join(word for word in words if word)

    def long(self, name: str) -> str:
        """A row per fact, as Markdown."""
        spread = "" if self.interval_kg is None else f" ({' to '.join(mass(each) for each in self.interval_kg)})"
        rows = [("mass", mass(self.mass_kg) + spread), ("material", self.material)]
        rows += [("friction", "" if self.friction is None else f"{self.friction:.2f}"), ("held", self.held)]
        rows.append(("cut", "by the picture's border; the rest is completed by symmetry" if self.cut else ""))
        return f"**{name}**\n\n" + "\n".join(f"* {word}: {text}" for word, text in rows if text)


class Figure:
    """Adds the bodies of a compiled model to a scene and moves them.

    Args:
        server: A viser server.
        name: Scene node of the whole.
        model: The compiled model.
        data: Its state; positions of bodies are up to date.
        facts: Root body -> text of its label.
    """

    def __init__(self, server: Any, name: str, model: Any, data: Any, facts: Mapping[str, Fact]) -> None:
        self._server, self._model = server, model
        self.labels: list[Any] = []
        """Labels of the objects."""
        self.pieces: list[Any] = []
        """Surfaces for collision, hidden at first."""
        self.robot: list[Any] = []
        """Visible surfaces of bodies whose names have a prefix."""
        self.static: list[Any] = []
        """Visible surfaces of the world."""
        self.surfaces: dict[str, list[Any]] = {root: [] for root in facts}
        """Root body -> its visible surfaces."""
        self._solid: dict[str, list[Any]] = {root: [] for root in facts}
        self._frames: dict[int, Any] = {}
        for body in range(model.nbody):
            self._add(name, body)
        self._labels = {root: self._label(f"{name}/labels/{root}", root, data, fact) for root, fact in facts.items()}
        self._sent = np.full((model.nbody, 7), np.nan)
        self.update(data)

    @property
    def followed(self) -> dict[int, str]:
        """Body of the model -> the scene node that follows it."""
        return {body: frame.name for body, frame in self._frames.items()}

    def update(self, data: Any) -> None:
        """Move the bodies that have moved since the last call."""
        now = np.concatenate([data.xpos, data.xquat], axis=1)
        moved = ~(np.abs(now - self._sent) < STILL).all(axis=1)
        with self._server.atomic():
            for number in np.flatnonzero(moved):
                if (frame := self._frames.get(int(number))) is not None:
                    frame.position, frame.wxyz = now[number, :3].copy(), now[number, 3:].copy()
            for root, (label, height) in self._labels.items():
                body = int(self._model.body(root).id)
                if moved[body]:
                    label.position = now[body, :3] + [0.0, 0.0, height]
        self._sent[moved] = now[moved]

    def resize(self, factors: Mapping[str, float]) -> None:
        """Give the surfaces of root bodies these factors of their original lengths; 1 where none is given."""
        for root, handles in self.surfaces.items():
            for handle in (*handles, *self._solid[root]):
                handle.scale = float(factors.get(root, 1.0))

    def _add(self, name: str, body: int) -> None:
        title = self._model.body(body).name or f"body_{body}"
        place = f"{name}/{title}"
        skins, touching = visible(self._model, body), colliding(self._model, body)
        if body and (skins or touching):
            self._frames[body] = self._server.scene.add_frame(place, show_axes=False)
        handles = [add_skin(self._server, f"{place}/visual_{number}", skin) for number, skin in enumerate(skins)]
        hidden = [add_skin(self._server, f"{place}/collision", skin, visible=False) for skin in touching]
        self.pieces += hidden
        root = self._model.body(int(self._model.body_rootid[body])).name
        if root in self.surfaces:
            self.surfaces[root] += handles
            self._solid[root] += hidden
        elif body == 0:
            self.static += handles
        else:
            self.robot += handles

    def _label(self, name: str, root: str, data: Any, fact: Fact) -> tuple[Any, float]:
        """The label, and its height above the root body's origin [m]."""
        bodies = np.flatnonzero(self._model.body_rootid == self._model.body(root).id)
        top = float(self._model.body(root).pos[2])
        for body in bodies:
            turn = data.xmat[body].reshape(3, 3)[2]
            heights = [float((skin.vertices @ turn).max()) for skin in visible(self._model, int(body))]
            top = max([top, *(height + float(data.xpos[body, 2]) for height in heights)])
        height = top + ABOVE_M - float(data.xpos[self._model.body(root).id, 2])
        label = add_label(self._server, name, fact.short(root), (0.0, 0.0, 0.0))
        self.labels.append(label)
        return label, height


def facts_of(model: Any, roots: Iterable[str], known: Mapping[str, Fact]) -> dict[str, Fact]:
    """Facts of root bodies: those in `known`, and those of the model for the others."""
    found = {}
    for root in roots:
        body = int(model.body(root).id)
        geoms = np.flatnonzero((model.body_rootid[model.geom_bodyid] == body) & (model.geom_contype > 0))
        friction = float(model.geom_friction[geoms, 0].max()) if len(geoms) else None
        found[root] = known.get(root, Fact(float(model.body_subtreemass[body]), friction=friction))
    return found


def free_roots(model: Any) -> list[str]:
    """Names of the bodies that move freely."""
    joints = np.flatnonzero(model.jnt_type == mujoco.mjtJoint.mjJNT_FREE)
    return [model.body(int(model.jnt_bodyid[joint])).name for joint in joints]


def add_skin(server: Any, name: str, skin: Skin, *, visible: bool = True) -> Any:
    """A surface, with its texture if it has one."""
    opacity = None if skin.colour[3] >= 1 else skin.colour[3]
    if skin.texture is None or skin.uv is None:
        colour = tuple(round(255 * part) for part in skin.colour[:3])
        return server.scene.add_mesh_simple(
            name, skin.vertices, skin.faces, color=colour, opacity=opacity, side="double", visible=visible
        )
    return add_textured(
        server, name, skin.vertices, skin.faces, skin.uv, skin.texture, glows=skin.glows, visible=visible
    )


def add_textured(
    server: Any,
    name: str,
    vertices: np.ndarray,
    faces: np.ndarray,
    uv: np.ndarray,
    texture: np.ndarray,
    *,
    glows: bool,
    visible: bool = True,
) -> Any:
    """A surface with a texture, seen from both sides; `uv` (F * 3, 2) is by corner. One that glows needs no light."""
    import trimesh
    from PIL import Image as Pillow

    picture = Pillow.fromarray(texture)
    look: dict[str, Any] = {"baseColorTexture": picture}
    if glows:
        look = {"baseColorFactor": [0, 0, 0, 255], "emissiveTexture": picture, "emissiveFactor": [1.0, 1.0, 1.0]}
    material = trimesh.visual.material.PBRMaterial(**look, metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True)
    visual = trimesh.visual.TextureVisuals(uv=uv, material=material)
    corners = vertices[faces].reshape(-1, 3)
    made = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), visual=visual, process=False)
    # As WebP, a texture has a twentieth of the bytes that viser would send as PNG.
    data = made.export(file_type="glb", extension_webp=True)
    return server.scene.add_glb(name, data, visible=visible)


def add_label(server: Any, name: str, text: str, place: tuple[float, ...]) -> Any:
    """A text above a place (3,) [m], 13 px high."""
    return server.scene.add_label(name, text, position=place, anchor="bottom-center", font_screen_scale=13 / 12)


def mass(kilograms: float) -> str:
    """A mass as people write it."""
    return f"{kilograms:.2f} kg" if kilograms >= 1.0 else f"{1000 * kilograms:.0f} g"


def about(server: Any, figure: Figure, facts: Mapping[str, Fact]) -> None:
    """A text in the panel with the facts of the object that was clicked last."""
    words = server.gui.add_markdown("Click an object for its mass, material and friction.")

    def tell(root: str) -> None:
        words.content = facts[root].long(root)

    for root, handles in figure.surfaces.items():
        for handle in handles:
            handle.on_click(lambda _, root=root: tell(root))


def look_from(server: Any, points: np.ndarray, direction: tuple[float, float, float] = (0.5, -1.0, 0.6)) -> None:
    """Start the view so that points (N, 3) [m] fill it, seen from `direction`."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle, reach = (low + high) / 2, float(np.linalg.norm(high - low)) / 2 + 0.1
    away = np.array(direction) / np.linalg.norm(direction)
    server.initial_camera.look_at = tuple(middle.tolist())
    server.initial_camera.position = tuple((middle + 1.5 * reach * away).tolist())
    server.initial_camera.up = (0.0, 0.0, 1.0)
