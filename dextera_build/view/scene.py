"""A whole twin in the viewer: objects with joint sliders, static scene, frames, camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, TypeAlias

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Asset, Joint, Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.artifacts.shapes.mesh import Mesh
from dextera_build.geometry import kinematics, quaternions, transforms
from dextera_build.view import chosen, invented
from dextera_build.view.chosen import Mending
from dextera_build.view.figure import ABOVE_M, Fact, add_label, look_from
from dextera_build.view.panel import note_slider
from dextera_build.view.photo import Comparison
from dextera_build.view.show import PIECE_COLOURS, add_camera, add_frame, add_piece, show
from dextera_build.view.switches import switch

STEPS = 40
"""Steps of a joint's slider in a saved page."""
Nodes: TypeAlias = dict[str, tuple[Mesh, np.ndarray]]
"""Scene node -> its mesh, and T_world_node (4, 4)."""


def show_scene(
    server: Any,
    assets: Mapping[str, Asset],
    background: Background,
    support: Support,
    camera: Camera,
    *,
    photo: Image | None = None,
    addresses: Mapping[str, str] | None = None,
    held: Mapping[str, str] | None = None,
    mending: Mending | None = None,
) -> None:
    """Add a twin to a viser server.

    Args:
        server: From `view.server.start`.
        assets: Label -> placed object.
        background: Static scene.
        support: World frame and outline.
        camera: Intrinsics of the photograph [px].
        photo: The photograph, shown in the camera's frustum.
        addresses: Label -> node address, which then names the scene node; the label itself if left out.
        held: Label of an object that is fixed in the simulated scene -> why; None: all move freely.
        mending: Names and corrects objects; None: the panel only tells their facts.
    """
    axes = add_frame(server, "/world", np.eye(4), axes=0.1)
    grid = server.scene.add_grid("/grid", width=2, height=2, cell_size=0.1, section_size=0.5, position=(0, 0, -0.002))
    static = show(background, server, "/background")
    outline = show(support, server, "/support")
    lens = [add_camera(server, "/camera", camera, support.camera_pose.matrix)]
    pieces: list[Any] = []
    facts = {label: _fact(asset, (held or {}).get(label, "")) for label, asset in assets.items()}
    choose = chosen.Chosen(server, facts, mending)
    nodes: Nodes = {}
    for label in sorted(assets):
        name = f"/{(addresses or {}).get(label, label)}"
        frames = _object(server, name, assets[label], pieces, partial(_tell, choose.choose, label))
        nodes |= {f"{name}/{link}": placed for link, placed in _placed(assets[label]).items()}
        _sliders(server, label, assets[label], frames)
    if photo is not None:
        comparison = Comparison(server, "/photograph", camera, support.camera_pose.matrix, photo.pixels)
        comparison.aside += [*lens, outline]
        choose.comparison = comparison
    labels = [_label(server, f"/labels/{label}", facts[label].short(label), asset) for label, asset in assets.items()]
    with server.gui.add_folder("Show"):
        for title, handles in (("Labels", labels), ("Background", [static])):
            switch(server, title, handles, visible=True)
        for title, handles in (
            ("Mark what the photograph does not show", _marks(server, nodes, background, camera, support)),
            ("Camera", lens),
            ("Outline", [outline]),
            ("Collision pieces", pieces),
            ("Grid and axes", [grid, axes]),
        ):
            for handle in handles:
                handle.visible = False
            switch(server, title, handles, visible=False)
    if photo is None:
        look_from(server, np.array([asset.pose.matrix[:3, 3] for asset in assets.values()] or [np.zeros(3)]))


def _object(server: Any, name: str, asset: Asset, pieces: list[Any], clicked: Callable[[Any], None]) -> dict[str, Any]:
    """Add an object as it was seen, append its hidden collision pieces to `pieces`, and return link -> frame."""
    add_frame(server, name, asset.pose.matrix)
    frames = {}
    for link, pose in kinematics.link_poses(asset.body).items():
        frames[link] = add_frame(server, f"{name}/{link}", pose)
        show(asset.body.links[link].mesh, server, f"{name}/{link}/visual").on_click(clicked)
        for number, hull in enumerate(asset.collision.links[link].hulls):
            colour = PIECE_COLOURS[number % len(PIECE_COLOURS)]
            pieces.append(add_piece(server, f"{name}/{link}/piece_{number}", hull, colour, visible=False))
    return frames


def _placed(asset: Asset) -> Nodes:
    """Link -> its mesh and pose."""
    poses = kinematics.link_poses(asset.body)
    return {link: (asset.body.links[link].mesh, asset.pose.matrix @ pose) for link, pose in poses.items()}


def _marks(server: Any, nodes: Nodes, background: Background, camera: Camera, support: Support) -> list[Any]:
    """Marks on the surfaces that were completed, because the photograph does not show them."""
    scenery = [(mesh, np.eye(4)) for mesh in (background.mesh, background.invented) if mesh is not None]
    try:
        hidden = invented.unseen([*nodes.values(), *scenery], camera, support.camera_pose.matrix)
    except ImportError:  # Open3D, which the viewer does not need otherwise
        hidden = []
    chosen = {name: (mesh, faces) for (name, (mesh, _)), faces in zip(nodes.items(), hidden, strict=False)}
    if background.invented is not None:
        chosen["/background"] = (background.invented, np.ones(len(background.invented.faces), bool))
    return [
        server.scene.add_mesh_simple(f"{name}/mark", made.vertices, made.faces, color=invented.COLOUR, side="double")
        for name, made in ((name, invented.marked(*each)) for name, each in chosen.items())
        if len(made.faces)
    ]


def _sliders(server: Any, label: str, asset: Asset, frames: Mapping[str, Any]) -> None:
    """One slider per joint; every move poses all links of the object."""
    if not asset.body.joints:
        return
    sliders: dict[str, tuple[Any, float]] = {}

    def pose(_: object) -> None:
        positions = {name: slider.value / unit for name, (slider, unit) in sliders.items()}
        for link, matrix in kinematics.link_poses(asset.body, positions).items():
            frames[link].wxyz = quaternions.from_matrix(matrix[:3, :3])
            frames[link].position = matrix[:3, 3]

    with server.gui.add_folder(label):
        for joint in asset.body.joints:
            slider, unit = _slider(server, joint)
            sliders[joint.name] = slider, unit
            slider.on_update(pose)
            _note(
                server,
                f"{label}: {joint.name} [{'deg' if joint.type == 'revolute' else 'mm'}]",
                slider,
                unit,
                asset,
                joint,
                frames,
            )


def _note(
    server: Any, title: str, slider: Any, unit: float, asset: Asset, joint: Joint, frames: Mapping[str, Any]
) -> None:
    """What the slider of a joint does, for saved pages; the other joints are as photographed."""
    values = np.linspace(slider.min, slider.max, STEPS + 1)
    posed = [kinematics.link_poses(asset.body, {joint.name: float(value) / unit}) for value in values]
    still = kinematics.link_poses(asset.body)
    moved = [link for link in frames if any(not np.allclose(each[link], still[link]) for each in posed)]
    note_slider(
        server,
        title,
        values.tolist(),
        float(slider.value),
        {frames[link].name: [_pose(each[link]) for each in posed] for link in moved},
    )


def _pose(matrix: np.ndarray) -> np.ndarray:
    """Position and quaternion (7,)."""
    return np.concatenate([matrix[:3, 3], quaternions.from_matrix(matrix[:3, :3])])


def _slider(server: Any, joint: Joint) -> tuple[Any, float]:
    """A slider in degrees or millimetres, and the number of these per radian or metre."""
    turns = joint.type == "revolute"
    unit = float(np.degrees(1.0)) if turns else 1000.0
    low, high = (
        round(limit * unit, 1) for limit in (min(joint.lower, joint.position), max(joint.upper, joint.position))
    )
    title = f"{joint.name} [{'deg' if turns else 'mm'}]"
    start = round(float(np.clip(joint.position * unit, low, high)), 1)
    return server.gui.add_slider(title, min=low, max=max(high, low + 0.1), step=0.1, initial_value=start), unit


def _tell(choose: Callable[[str], None], label: str, _: object) -> None:
    choose(label)


def _label(server: Any, name: str, text: str, asset: Asset) -> Any:
    """A text above an object."""
    links = kinematics.link_poses(asset.body)
    corners = [transforms.apply(pose, asset.body.links[link].mesh.vertices) for link, pose in links.items()]
    placed = transforms.apply(asset.pose.matrix, np.concatenate(corners).astype(np.float64))
    low, high = placed.min(axis=0), placed.max(axis=0)
    position = ((low[0] + high[0]) / 2, (low[1] + high[1]) / 2, high[2] + ABOVE_M)
    return add_label(server, name, text, position)


def _fact(asset: Asset, held: str) -> Fact:
    links, physics = list(asset.physics.links.values()), asset.physics
    low, high = sum(each.mass_low_kg for each in links), sum(each.mass_high_kg for each in links)
    return Fact(sum(each.mass_kg for each in links), (low, high), physics.material, physics.friction, held, asset.cut)
