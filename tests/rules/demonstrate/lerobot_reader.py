"""Opens a data set with LeRobot's own loader, in a process of its own: `lerobot_reader.py FOLDER OUT.npz`.

LeRobot pins another torch. Its loader runs on one without CUDA all the same once torchvision finds the two operators
that its CUDA build would bring.
"""

from __future__ import annotations

import sys

import numpy as np
import torch

LIBRARY = torch.library.Library("torchvision", "DEF")
for name in ("nms", "qnms") if torch.version.cuda is None else ():
    LIBRARY.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402

SEEN = ("observation.state", "observation.environment_state", "observation.goal")
NUMBERS = (*SEEN, "action", "timestamp", "index", "episode_index")


def main(folder: str, out: str) -> None:
    """Write every item of the data set, and a window of the first camera's in a selection of episodes."""
    whole = LeRobotDataset("dextera/test", root=folder, video_backend="pyav")
    camera = sorted(whole.meta.video_keys)[0]
    items = [whole[number] for number in range(len(whole))]
    found = {key: np.stack([item[key].numpy() for item in items]) for key in NUMBERS}
    seen = [name for name, feature in whole.meta.features.items() if feature["dtype"] in ("image", "video")]
    found |= {f"seen/{name}": np.stack([item[name].numpy() for item in items]) for name in seen}
    found["pixels"] = found[f"seen/{camera}"]
    found["task"] = np.array([item["task"] for item in items])
    found |= {name: value for name, value in whole.meta.stats["action"].items() if name != "count"}
    period = 1.0 / whole.fps
    wanted = {"action": [0.0, period, 2 * period], camera: [-period, 0.0]}
    # LeRobot up to 0.3 has no windows in a selection: it takes an episode's number for its place in the selection.
    windows = str(whole.meta.info["codebase_version"]).startswith("v3") and whole.meta.total_episodes > 3
    selected = [1, 3] if windows else None
    some = LeRobotDataset("dextera/test", root=folder, video_backend="pyav", episodes=selected, delta_timestamps=wanted)
    last = some[len(some) - 1]
    found |= {"window": last["action"].numpy(), "padding": last["action_is_pad"].numpy()}
    found |= {"window_pixels": last[camera].numpy(), "window_episode": last["episode_index"].numpy()}
    np.savez(out, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
