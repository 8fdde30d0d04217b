"""Converts a recording with Rerun and reads what came of it: `rerun_reader.py FILE OUT.npz`."""

from __future__ import annotations

import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
from rerun.chunk import RrdReader

BODY = "box"


def main(file: str, out: str) -> None:
    """Write joints, times, the frame of one object, pictures, and the names of the robot's links with a shape."""
    converted = Path(out).with_suffix(".rrd")
    command = [sys.executable, "-m", "rerun", "mcap", "convert", file, "-o", str(converted)]
    subprocess.run(command, check=True, capture_output=True)
    columns = defaultdict(list)
    for chunk in RrdReader(converted).stream():
        rows = chunk.to_record_batch()
        for name in rows.schema.names:
            columns[f"{chunk.entity_path} {name}"] += rows.column(name).to_pylist()
    frames = columns["/tf Transform3D:child_frame"]
    at = [n for n, frame in enumerate(frames) if frame == [BODY]]
    drawn = [name.split("/")[-2] for name in columns if "/visual_geometries/" in name]
    np.savez(
        out,
        joints=columns["/joint_states/position Scalars:scalars"],
        place=[columns["/tf Transform3D:translation"][n][0] for n in at],
        images=[len(blob[0]) for blob in columns["/workspace/color/image_raw/compressed EncodedImage:blob"]],
        resolution=columns["/workspace/color/camera_info Pinhole:resolution"][0][0],
        drawn=sorted(set(drawn)),
    )


main(*sys.argv[1:])
