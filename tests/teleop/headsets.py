"""An emulated headset: recordings of hands in the form that iwer's action player plays in a page.

https://github.com/meta-quest/immersive-web-emulation-runtime, docs/action.md
"""

from __future__ import annotations

import shutil
import subprocess
import tarfile
from pathlib import Path
from typing import Any

import numpy as np

from dextera_build.artifacts.robots.hand_stream import LOST, HandStream
from dextera_build.geometry import hands, quaternions
from dextera_build.teleop.protocol import AHEAD

IWER = "iwer@2.5.0"
INSTALL = """
window.device = new IWER.XRDevice(IWER.metaQuest3);
window.device.installRuntime({ forceInstall: true });
window.device.primaryInputMode = "hand";
"""
PLAY = """
(capture) => {
  const space = session.headset.renderer.xr.getReferenceSpace();
  window.player = device.createActionPlayer(space, capture);
  window.player.play();
}
"""
OFF = """((hand, place) => {
  const { scene } = session.headset, joint = session.twin.hands[hand].joints[0];
  if (!session.twin.hands[hand].group.visible) return 1e9;
  scene.updateMatrixWorld(true);
  const drawn = joint.matrixWorld.elements.slice(12, 15);
  return Math.hypot(...drawn.map((each, axis) => each - place[axis]));
})"""
"""How far [m] the wrist of an operator's skeleton is drawn from a place in the room."""
STEP_MS, LEAD_MS = 25, 50
"""Most simulated time that hands go on by from one picture of the page to the next, and beyond the one it shows."""
PLAY_PACED = f"""
(capture, speed) => {{
  ({PLAY})(capture);
  const own = window.player, play = own.playFrame.bind(own), begun = session.facts.seconds;
  let last = performance.now();
  own.playFrame = () => {{
    const now = performance.now(), shown = 1000 * (session.facts.seconds - begun);
    const most = Math.min({STEP_MS}, shown + {LEAD_MS} - own.currentTime * speed) / speed;
    own.playbackRate = Math.min(1, Math.max(1e-6, most / Math.max(1, now - last)));
    last = now;
    play();
  }};
}}
"""
"""Like an operator who watches the page: on a machine that comes to a halt for a moment, the hands do not jump."""
RADIUS_M = 0.008


def script(folder: Path) -> str | None:
    """The emulator as a script that installs itself; None if npm or its registry is not there."""
    if shutil.which("npm") is None:
        return None
    command = ["npm", "pack", IWER, "--silent", "--pack-destination", str(folder)]
    if subprocess.run(command, capture_output=True, cwd=folder, timeout=120).returncode:
        return None
    with tarfile.open(next(folder.glob("iwer-*.tgz"))) as archive:
        member = archive.extractfile("package/build/iwer.min.js")
        assert member
        return member.read().decode() + INSTALL


def capture(stream: HandStream, first: int, last: int, speed: float = 1.0) -> dict[str, Any]:
    """Messages `first` to `last` - 1 of a stream in a frame with z up and x ahead, which has a head, to be played."""
    assert stream.head is not None
    schema = [
        (
            hand,
            {
                "handedness": side,
                "targetRayMode": "tracked-pointer",
                "profiles": ["generic-hand"],
                "hasGrip": False,
                "hasHand": True,
                "hasGamepad": False,
                "jointSequence": list(hands.JOINTS),
            },
        )
        for hand, side in enumerate(hands.SIDES)
    ]
    rows = []
    for row in range(first, last):
        milliseconds = 1000 / speed * float(stream.stamps[row] - stream.stamps[first])
        sources = []
        for hand in np.flatnonzero(stream.tracking[row] > LOST).tolist():
            joints = turned(np.concatenate([stream.positions[row, hand], stream.rotations[row, hand]], axis=1))
            sized = np.concatenate([joints, np.full((len(joints), 1), RADIUS_M)], axis=1)
            sources.append([hand, 0, 0, 0, 0, 0, 0, 1, sized.ravel().tolist()])
        rows.append([milliseconds, *turned(stream.head[row][None])[0].tolist(), *sources])
    return {"schema": schema, "frames": rows}


def still(stream: HandStream, row: int, seconds: float = 600.0) -> dict[str, Any]:
    """One message of such a stream, held."""
    found = capture(stream, row, row + 1)
    (frame,) = found["frames"]
    return {**found, "frames": [frame, [1000 * seconds, *frame[1:]]]}


def turned(poses: np.ndarray) -> np.ndarray:
    """Poses (N, 7) with quaternions w x y z in WebXR's frame, with quaternions x y z w."""
    turn = quaternions.from_matrix(AHEAD.T)
    rotations = quaternions.multiply(turn, poses[:, 3:].astype(np.float64))
    return np.concatenate([poses[:, :3] @ AHEAD, rotations[:, [1, 2, 3, 0]]], axis=1)
