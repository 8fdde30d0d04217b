"""`Capture` as the folder that `capture.folder` reads."""

from __future__ import annotations

import json
from pathlib import Path

from dextera_build.artifacts.cameras.camera import Capture
from dextera_build.formats import image as picture_files


def export(capture: Capture, folder: Path, stem: str) -> list[Path]:
    """Write the files that `capture.folder` reads: `rgb.png`, `depth.png` in millimetres, `capture.json`."""
    facts = capture.photograph.camera.model_dump()
    written = picture_files.save(capture.photograph.rgb, folder / "rgb.png")
    if capture.measured is not None:
        facts["depth_scale_m"] = 0.001
        written += picture_files.save(capture.measured.depth, folder / "depth.png")
    written.append(folder / "capture.json")
    written[-1].write_text(json.dumps(facts, indent=1) + "\n")
    return written
