"""A whole twin in the viewer: objects with joint sliders, static scene, frames, camera."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np

from dextera_build.artifacts.cameras.camera import Camera
from dextera_build.artifacts.cameras.image import Image
from dextera_build.artifacts.objects.object import Asset, Joint, Support
from dextera_build.artifacts.scenes.scene import Background
from dextera_build.geometry import kinematics, quaternions, transforms
from dextera_build.view.figure import ABOVE_M, Fact, add_label
from dextera_build.view.photo import Comparison
from dextera_build.view.show import PIECE_COLOURS, add_camera, add_frame, add_piece, show
from dextera_build.view.switches import switch

SWING_RAD = 0.6
"""Initial rotation of the viewpoint from the photograph's camera, about the vertical [rad]."""


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
    bind: Callable[[str, str], str] | None = None,
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
        bind: Gives the object of a label a name, and returns a message about it; None: names cannot be given.
    """
    add_frame(server, "/world", np.eye(4), axes=0.1)
    server.scene.add_grid("/grid", width=2.0, height=2.0, cell_size=0.1, section_size=0.5, position=(0.0, 0.0, -0.002))
    static = show(background, server, "/background")
    outline = show(support, server, "/support")
    lens = [add_camera(server, "/camera", camera, support.camera_pose.matrix)]
    pieces: list[Any] = []
    facts = {label: _fact(asset, (held or {}).get(label, "")) for label, asset in assets.items()}
    choose = _chosen(server, facts, bind)
    for label in sorted(assets):
        name = f"/{(addresses or {}).get(label, label)}"
        frames = _object(server, name, assets[label], pieces, partial(_tell, choose, label))
        _sliders(server, label, assets[label], frames)
    if photo is not None:
        comparison = Comparison(server, "/photograph", camera, support.camera_pose.matrix, photo.pixels)
        comparison.aside += [*lens, outline]
        lens.append(comparison.picture)
    labels = [_label(server, f"/labels/{label}", facts[label].short(label), asset) for label, asset in assets.items()]
    with server.gui.add_folder("Show"):
        for title, handles in (("Labels", labels), ("Background", [static]), ("Camera", lens), ("Outline", [outline])):
            switch(server, title, handles, visible=True)
        switch(server, "Collision pieces", pieces, visible=False)
    _greet(server, assets, support.camera_pose.matrix)


def _object(server: Any, name: str, asset: Asset, pieces: list[Any], clicked: Callable[[Any], None]) -> dict[str, Any]:
    """Add an object as it was seen, append its hidden collision pieces to `pieces`, and return link -> frame."""
    add_frame(server, name, asset.pose.matrix, axes=0.04)
    frames = {}
    for link, pose in kinematics.link_poses(asset.body).items():
        frames[link] = add_frame(server, f"{name}/{link}", pose)
        show(asset.body.links[link].mesh, server, f"{name}/{link}/visual").on_click(clicked)
        for number, hull in enumerate(asset.collision.links[link].hulls):
            colour = PIECE_COLOURS[number % len(PIECE_COLOURS)]
            pieces.append(add_piece(server, f"{name}/{link}/piece_{number}", hull, colour, visible=False))
    return frames


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


def _chosen(server: Any, facts: Mapping[str, Fact], bind: Callable[[str, str], str] | None) -> Callable[[str], None]:
    """The part of the panel about the object that was clicked last; its function takes the label."""
    chosen = [""]
    words = server.gui.add_markdown("Click an object for its mass, material and friction.")
    name = button = None
    if bind is not None:
        name = server.gui.add_text("Name", "", visible=False)
        button = server.gui.add_button("Bind", visible=False, hint="Keep this name in dxb.lock, independent of parsing")

    def choose(label: str) -> None:
        chosen[0] = label
        words.content = facts[label].long(label)
        if name is not None and button is not None:
            name.value, name.visible, button.visible = label, True, True

    if bind is not None and name is not None and button is not None:
        button.on_click(lambda _: setattr(words, "content", bind(chosen[0], name.value)))
    return choose


def _greet(server: Any, assets: Mapping[str, Asset], world_from_camera: np.ndarray) -> None:
    """Start the view at the photograph's camera, rotated to the side to make depth visible at once."""
    places = [asset.pose.matrix[:3, 3] for asset in assets.values()]
    target = np.mean(places, axis=0) if places else np.zeros(3)
    c, s = np.cos(SWING_RAD), np.sin(SWING_RAD)
    arm = world_from_camera[:3, 3] - target
    start = target + np.array([c * arm[0] - s * arm[1], s * arm[0] + c * arm[1], 1.1 * arm[2]])
    server.initial_camera.position = tuple(start.tolist())
    server.initial_camera.look_at = tuple(target.tolist())
    server.initial_camera.up = (0.0, 0.0, 1.0)
