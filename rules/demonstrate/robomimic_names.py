"""Names in robomimic's file."""

from __future__ import annotations

from .form import OBSERVED
from .lerobot_features import ACTION

FILE = "demo.hdf5"
ACTIONS, EXECUTED = "actions", "executed"
OBJECT, PICTURE, DEPTH = "object", "{}_image", "{}_depth"
"""What robomimic calls the state of the objects, and the pictures and the depth of a camera."""
RENAMED = {"environment_state": OBJECT, "images.{}": PICTURE, "images.{}_depth": DEPTH}


def observed(feature: str) -> str:
    """The name among the observations, of a feature with or without `observation.`."""
    name = feature.removeprefix(OBSERVED)
    return RENAMED.get(name, name)


def place(feature: str) -> str:
    """Where a feature is in a demonstration; empty: nowhere."""
    if feature.startswith(OBSERVED):
        return f"obs/{observed(feature)}"
    return {ACTION: ACTIONS, "executed_action": EXECUTED}.get(feature, "")
