"""Reads random batches of a data set with LeRobot's own reader: `lerobot_read.py FOLDER BATCHES BATCH BACKEND`.

Runs where `lerobot` is installed, see `tests/rules/demonstrate/test_lerobot_loader.py`.
"""

from __future__ import annotations

import json
import sys
import time

import torch

LIBRARY = torch.library.Library("torchvision", "DEF")
for name in ("nms", "qnms"):  # torchvision without its compiled part
    LIBRARY.define(f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor")

from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402


def main(folder: str, batches: str, batch: str, backend: str) -> None:
    """Print the number of pictures and the time that they took [s], both in this one process."""
    begun = time.perf_counter()
    whole = LeRobotDataset("dextera/benchmark", root=folder, video_backend=backend)
    opened = time.perf_counter() - begun
    chosen = torch.randint(len(whole), (int(batches) * int(batch),), generator=torch.Generator().manual_seed(1))
    loader = torch.utils.data.DataLoader(whole, batch_size=int(batch), sampler=chosen.tolist(), num_workers=0)
    begun, count = time.perf_counter(), 0
    for found in loader:
        count += sum(len(found[camera]) for camera in whole.meta.video_keys)
    seconds = time.perf_counter() - begun
    facts = {"step": f"read by LeRobot, {backend}", "pictures": count, "seconds": round(seconds, 2)}
    print(json.dumps(facts | {"pictures/s": round(count / seconds, 1), "opened [s]": round(opened, 2)}))


if __name__ == "__main__":
    main(*sys.argv[1:])
