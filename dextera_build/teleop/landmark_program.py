"""Hands in the pictures of a camera or a film, found by MediaPipe; a program for a Python that has it, without dxb.

`python landmark_program.py SOURCE`, where SOURCE is the number of a camera or the path of a film, prints lines of JSON:
first the size of the pictures, or a fault, and then the hands of every picture.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterator
from typing import Any

MOST_HZ = 60.0
CAMERA_HZ = 30.0


def tell(**facts: Any) -> None:
    """Print a line."""
    print(json.dumps(facts), flush=True)


def main(source: str) -> None:
    """Read pictures until they end."""
    try:
        import cv2
        import mediapipe
    except ImportError as error:
        tell(fault="mediapipe", said=str(error))
        return
    live = source.isdigit()
    camera = cv2.VideoCapture(int(source) if live else source)
    if live:
        # One picture waits at most: older ones would be late.
        camera.set(cv2.CAP_PROP_BUFFERSIZE, 1)
    there, picture = camera.read()
    if not there:
        tell(fault="camera" if live else "film")
        return
    height, width = picture.shape[:2]
    rate = CAMERA_HZ if live else min(camera.get(cv2.CAP_PROP_FPS) or CAMERA_HZ, MOST_HZ)
    finder = mediapipe.solutions.hands.Hands(max_num_hands=2, model_complexity=1)
    finder.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
    tell(width=width, height=height, rate=rate)
    began, number = time.perf_counter(), 0
    while there:
        seen = time.perf_counter()
        found = finder.process(cv2.cvtColor(picture, cv2.COLOR_BGR2RGB))
        tell(seen=seen, hands=list(hands_of(found, width, height)))
        number += 1
        if not live:
            time.sleep(max(0.0, began + number / rate - time.perf_counter()))
        there, picture = camera.read()


def hands_of(found: Any, width: int, height: int) -> Iterator[dict[str, Any]]:
    """Hands of a result: side, how sure it is, and 21 landmarks in the picture [pixel] and in space [m]."""
    parts = (found.multi_handedness, found.multi_hand_landmarks, found.multi_hand_world_landmarks)
    for side, image, world in zip(*(each or [] for each in parts), strict=True):
        label = side.classification[0]
        yield {
            # MediaPipe takes a picture for that of a mirror.
            "side": {"Left": "right", "Right": "left"}[label.label],
            "sure": round(label.score, 3),
            "image": [[round(p.x * width, 2), round(p.y * height, 2)] for p in image.landmark],
            "world": [[round(p.x, 5), round(p.y, 5), round(p.z, 5)] for p in world.landmark],
        }


if __name__ == "__main__":
    main(sys.argv[1])
