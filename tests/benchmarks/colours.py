"""Fit one colour transform between photographs and their twins, and measure whether it helps where it was not fitted.

    python -m tests.benchmarks.colours NAME...

Names are those of folders of captures, or `laptop_scene`. Twins are built by `twin/tabletop` without options and
rendered from the photograph's camera as `evaluate.overlay` does. Pixels are those of the objects, and those of the
support where photograph and twin have the same depth; half of the squares of 16 px, drawn with a seed, are fitted and
the others compared. Transforms are in linear RGB, with Huber's loss.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from dextera_build.api import Project, Result
from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.geometry import cameras, metrics, transforms
from dextera_build.sim.model import model as models
from dextera_build.sim.render import rendering
from tests.rules.factorize.masks.outlines import CAPTURES

SQUARE_PX, SEED = 16, 7
MOST = 20_000
"""Pixels that are fitted."""
HUBER = 0.02
"""Residuals in linear RGB above this count linearly."""
SUPPORT_M, SAME_M = 0.005, 0.01
"""Maximum height above the support, and difference of depth between photograph and twin [m]."""
Transform = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Parameters and linear RGB (N, 3) to linear RGB (N, 3)."""
KINDS: Mapping[str, tuple[Transform, list[float]]] = {
    "gains": (lambda p, colours: colours * p, [1.0] * 3),
    "gains and gammas": (lambda p, colours: p[:3] * np.maximum(colours, 1e-6) ** p[3:], [1.0] * 6),
    "matrix 3x4": (lambda p, colours: colours @ p[:9].reshape(3, 3) + p[9:], [*np.eye(3).ravel(), 0.0, 0.0, 0.0]),
}


def linear(pixels: np.ndarray) -> np.ndarray:
    """Linear RGB of sRGB bytes (IEC 61966-2-1)."""
    shares = pixels / 255.0
    return np.asarray(np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4))


def encoded(colours: np.ndarray) -> np.ndarray:
    """SRGB bytes of linear RGB."""
    shares = np.clip(colours, 0.0, 1.0)
    return np.round(255 * np.where(shares <= 0.0031308, 12.92 * shares, 1.055 * shares ** (1 / 2.4) - 0.055))


def gain(kind: str, twin: np.ndarray, photograph: np.ndarray, where: np.ndarray) -> float:
    """How much nearer the twin (H, W, 3) uint8 comes to the photograph where both are compared [dB of PSNR]."""
    height, width = where.shape
    rng = np.random.default_rng(SEED)
    squares = rng.random((height // SQUARE_PX + 1, width // SQUARE_PX + 1)) < 0.5
    compared = where & np.kron(squares, np.ones((SQUARE_PX, SQUARE_PX), bool))[:height, :width]
    fitted = rng.permutation(np.flatnonzero(where & ~compared))[:MOST]
    apply, start = KINDS[kind]
    have, want = (linear(each.reshape(-1, 3)[fitted]) for each in (twin, photograph))
    found = least_squares(lambda p: (apply(p, have) - want).ravel(), start, loss="huber", f_scale=HUBER)
    changed = twin.copy()
    changed[compared] = encoded(apply(found.x, linear(twin[compared])))
    before, after = (metrics.psnr(each, photograph, compared) for each in (twin, changed))
    return (after or 0.0) - (before or 0.0)


def ratio(twin: np.ndarray, photograph: np.ndarray, where: np.ndarray) -> float:
    """Median of photograph over twin in linear RGB, over pixels and channels."""
    return float(np.median(linear(photograph[where]) / np.maximum(linear(twin[where]), 1e-3)))


def areas(scene: Scene, capture: Capture) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """The twin as the photograph's camera sees it (H, W, 3) uint8, and the pixels (H, W) of each area."""
    model = models.compile_folder(scene.model)
    data, camera, pose = models.at_home(model), scene.camera, scene.camera_pose.matrix
    (twin,), geoms = rendering.stock(model, data, ["capture"], camera.height, camera.width)
    things = rendering.owners_of(model, geoms, (*scene.bodies, *scene.held)) >= 0
    with rendering.Eye(model, camera, pose) as eye:
        depth = eye.depth(data)
    heights = transforms.apply(pose, cameras.backproject(depth, camera.matrix()).reshape(-1, 3))[:, 2]
    support = (np.abs(heights.reshape(depth.shape)) < SUPPORT_M) & (depth > 0) & ~things
    if capture.measured is not None:
        support &= np.abs(capture.measured.depth.depth - depth) < SAME_M
    return twin, {"objects": things, "support": support, "both": things | support}


def built(project: Project, name: str) -> Result:
    """A twin's build."""
    if name == "laptop_scene":
        return project.build("twin/laptop_scene", "scene", "reference/laptop_scene:capture")
    return project.build("twin/tabletop", "scene", "photo", inputs={"capture": str((CAPTURES / name).resolve())})


def main() -> None:
    """Build the twins and print a row for each area."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("captures", nargs="+", metavar="NAME")
    asked.add_argument("--store", type=Path, metavar="FOLDER", help="where the builds are kept; without it nowhere")
    options = asked.parse_args()
    print(f"| photograph | pixels | photograph / twin | PSNR [dB] | {' | '.join(f'{kind} [dB]' for kind in KINDS)} |")
    print("|---|" + "---:|" * (len(KINDS) + 3))
    with tempfile.TemporaryDirectory() as folder:
        project = Project.find(folder, cache=str((options.store or Path(folder) / "cache").resolve()))
        for name in options.captures:
            result = built(project, name)
            scene = result.artifact("scene")
            capture = result.artifact("reference/laptop_scene:capture" if name == "laptop_scene" else "photo")
            assert isinstance(scene, Scene)
            assert isinstance(capture, Capture)
            twin, found = areas(scene, capture)
            pixels = capture.photograph.rgb.pixels
            for area, where in found.items():
                gains = " | ".join(f"{gain(kind, twin, pixels, where):+.2f}" for kind in KINDS)
                alike = f"{ratio(twin, pixels, where):.3f} | {metrics.psnr(twin, pixels, where):.2f}"
                print(f"| {name}, {area} | {where.sum():,} | {alike} | {gains} |")


if __name__ == "__main__":
    main()
