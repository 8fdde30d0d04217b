"""Program of backend `deaot` of align.follow; runs in the environment of Segment-and-Track-Anything."""

from __future__ import annotations

import importlib
import io
import json
import zipfile
from typing import Any

import dxb_backend  # type: ignore[import-not-found]


def follow(request: Any) -> Any:
    """The label map of every frame, as a ZIP archive of PNGs."""
    import numpy as np

    first = np.load(request.inputs["first"].path, allow_pickle=False).astype(np.uint8)
    stamps = np.load(request.inputs["video"].stamps.path, allow_pickle=False)
    tracker = _tracker(request)
    path, done = request.file("masks.zip"), 0
    with zipfile.ZipFile(path, "w") as archive:
        for done, frame in enumerate(_frames(request.inputs["video"].file.path), 1):
            if done == 1:
                tracker.add_reference(frame, first)
                labels = first
            else:
                labels = np.asarray(tracker.track(frame, update_memory=True)).squeeze()
            if labels.max(initial=0) > first.max():
                raise dxb_backend.Refused(f"DeAOT gave label {labels.max()}, of {first.max()}")
            archive.writestr(f"{done - 1:05d}.png", _png(labels.astype(np.uint8)))
        meta = {"names": list(request.inputs["names"]), "stamps_s": stamps.tolist()}
        archive.writestr("meta.json", json.dumps(meta))
    if done != len(stamps):
        raise dxb_backend.Refused(f"{done} frames were decoded, {len(stamps)} are in the index of the video")
    return dxb_backend.value("MaskTrack", file=path)


def _tracker(request: Any) -> Any:
    known = importlib.import_module("model_args")
    aot = {**known.aot_args, "long_term_mem_gap": request.options["memory_every"]}
    tracker = importlib.import_module("SegTracker").SegTracker(known.segtracker_args, known.sam_args, aot)
    tracker.restart_tracker()
    return tracker


def _frames(path: Any) -> Any:
    """Frames (H, W, 3) uint8 in RGB order, as SAM-Track expects; OpenCV reads BGR."""
    import cv2

    film = cv2.VideoCapture(str(path))
    while True:
        there, frame = film.read()
        if not there:
            return
        yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB)


def _png(labels: Any) -> bytes:
    from PIL import Image

    written = io.BytesIO()
    Image.fromarray(labels).save(written, format="PNG")
    return written.getvalue()


dxb_backend.serve(follow=follow)
