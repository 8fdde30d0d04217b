"""Program of backend `foundation_pose` of align.track; runs in the environment of FoundationPose."""

from __future__ import annotations

import importlib
import io
import zipfile
from typing import Any

import dxb_backend  # type: ignore[import-not-found]

_STRIKES = 3
"""Number of consecutive frames with the mask elsewhere after which an object is registered again."""


def track(request: Any) -> Any:
    """T_camera_object (N, 4, 4) of each object in the frames of a video."""
    import numpy as np

    inputs = request.inputs
    video, numbers = inputs["video"], np.load(inputs["numbers"].path, allow_pickle=False)
    camera = video.camera
    k = np.array([[camera.fx, 0, camera.cx], [0, camera.fy, camera.cy], [0, 0, 1]], np.float64)
    names = list(inputs["vertices"].parts)
    things = {name: _estimator(np, inputs, name) for name in names}
    middles = {name: _middle(np, inputs["vertices"][name].path) for name in names}
    poses: dict[str, list[Any]] = {name: [] for name in names}
    strikes = dict.fromkeys(names, 0)
    registered = set()
    with zipfile.ZipFile(video.file.path) as frames:
        for number in numbers.tolist():
            rgb, depth = _frame(np, frames, number, video.depth_scale_m)
            masks = _masks(np, inputs["masks"], number)
            for name, estimator in things.items():
                mask = masks.get(name)
                if mask is not None and (name not in registered or strikes[name] >= _STRIKES):
                    steps = request.options["register_iterations"]
                    pose = estimator.register(K=k, rgb=rgb, depth=depth, ob_mask=mask, iteration=steps)
                    registered.add(name)
                    strikes[name] = 0
                else:
                    steps = request.options["track_iterations"]
                    pose = estimator.track_one(rgb=rgb, depth=depth, K=k, iteration=steps)
                pose = np.asarray(pose, np.float64).reshape(4, 4)
                strikes[name] = (
                    strikes[name] + 1 if mask is not None and not _inside(np, pose @ middles[name], k, mask) else 0
                )
                poses[name].append(pose)
    found = {}
    for place, name in enumerate(names):
        path = request.file(f"poses-{place}.npy")
        np.save(path, np.stack(poses[name]))
        found[name] = dxb_backend.value("array", file=path)
    return dxb_backend.items(found)


def _estimator(np: Any, inputs: Any, name: str) -> Any:
    """FoundationPose for one mesh, initialised with the placement."""
    import torch
    import trimesh

    library = importlib.import_module("estimater")
    rasteriser = importlib.import_module("nvdiffrast.torch")
    mesh = trimesh.Trimesh(
        vertices=np.load(inputs["vertices"][name].path, allow_pickle=False),
        faces=np.load(inputs["faces"][name].path, allow_pickle=False),
        vertex_colors=np.load(inputs["colours"][name].path, allow_pickle=False),
        process=False,
    )
    made = library.FoundationPose(
        model_pts=mesh.vertices,
        model_normals=mesh.vertex_normals,
        symmetry_tfs=np.load(inputs["symmetries"][name].path, allow_pickle=False),
        mesh=mesh,
        scorer=library.ScorePredictor(),
        refiner=library.PoseRefinePredictor(),
        glctx=rasteriser.RasterizeCudaContext(),
    )
    start = np.load(inputs["starts"][name].path, allow_pickle=False)
    # It stores the pose of the mesh with its centre at the origin.
    centred = np.asarray(made.get_tf_to_centered_mesh().cpu())
    device = made.get_tf_to_centered_mesh().device
    made.pose_last = torch.as_tensor(start @ np.linalg.inv(centred), dtype=torch.float32, device=device)
    return made


def _frame(np: Any, frames: zipfile.ZipFile, number: int, scale: float) -> tuple[Any, Any]:
    """Colour (H, W, 3) uint8 and depth (H, W) float32 [m]; 0 where nothing was measured."""
    from PIL import Image

    known = set(frames.namelist())
    colour = next(name for name in (f"{number:05d}.png", f"{number:05d}.jpg") if name in known)
    with Image.open(io.BytesIO(frames.read(colour)), formats=("PNG", "JPEG")) as picture:
        rgb = np.asarray(picture.convert("RGB"))
    with Image.open(io.BytesIO(frames.read(f"{number:05d}.depth.png")), formats=("PNG",)) as picture:
        counts = np.asarray(picture).astype(np.float32)
    return rgb, np.where(counts < 65535, counts * scale, 0).astype(np.float32)


def _masks(np: Any, masks: Any, number: int) -> dict[str, Any]:
    """Name -> (H, W) bool of the objects in the masks of a frame."""
    import json

    from PIL import Image

    if masks is None:
        return {}
    with zipfile.ZipFile(masks.path) as archive:
        names = json.loads(archive.read("meta.json"))["names"]
        with Image.open(io.BytesIO(archive.read(f"{number:05d}.png")), formats=("PNG",)) as picture:
            labels = np.asarray(picture)
    shown = {name: labels == label for label, name in enumerate(names, 1)}
    return {name: mask for name, mask in shown.items() if mask.any()}


def _middle(np: Any, path: Any) -> Any:
    """Centre of a mesh (4,), homogeneous, because meshes may be off-centre."""
    vertices = np.load(path, allow_pickle=False)
    return np.append((vertices.min(axis=0) + vertices.max(axis=0)) / 2, 1.0)


def _inside(np: Any, middle: Any, k: Any, mask: Any) -> bool:
    """Whether the object's centre, in the frame of the camera, is inside the box of its mask."""
    pixel = k @ middle[:3]
    if pixel[2] <= 0:
        return False
    rows, columns = np.nonzero(mask)
    column, row = pixel[:2] / pixel[2]
    reach = 0.25 * max(np.ptp(rows), np.ptp(columns)) + 5
    return bool(
        columns.min() - reach <= column <= columns.max() + reach and rows.min() - reach <= row <= rows.max() + reach
    )


dxb_backend.serve(track=track)
