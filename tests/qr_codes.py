"""QR codes of terminals, read as a camera would."""

from __future__ import annotations

import cv2
import numpy as np

HALVES = {"█": (255, 255), "▀": (255, 0), "▄": (0, 255), " ": (0, 0)}
"""Character -> brightness of its upper and lower half, on a dark terminal."""


def read(text: str) -> str:
    """What the code among the lines of a terminal says; empty if there is none."""
    lines = [line for line in text.splitlines() if line and set(line) <= HALVES.keys()]
    if not lines:
        return ""
    rows = [[HALVES[letter][half] for letter in line] for line in lines for half in (0, 1)]
    picture = np.kron(np.array(rows, np.uint8), np.ones((8, 8), np.uint8))
    found, *_ = cv2.QRCodeDetector().detectAndDecode(picture)
    return str(found)
