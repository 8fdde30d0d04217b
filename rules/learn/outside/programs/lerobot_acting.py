"""Runs a trained policy of LeRobot in the environment of LeRobot; `policy.py` starts it and asks it at every step."""

from __future__ import annotations

import importlib.metadata
from typing import Any

_loaded: dict[str, Any] = {}


def act(request: Any) -> Any:
    """Joint targets (A,) for an observation, as LeRobot's own loop computes them.

    The policy has a state: it keeps the rest of a chunk of actions, and what it observed before.
    """
    import dxb_backend  # type: ignore[import-not-found]
    import numpy as np
    import torch

    given = request.inputs
    policy, before, after = _policy(given["folder"], given["version"], request.device)
    if given["reset"]:
        policy.reset()
        torch.manual_seed(given["seed"])
    seen: dict[str, Any] = {}
    for name, value in given["observation"].parts.items():
        array = torch.from_numpy(np.load(value.path, allow_pickle=False))
        if array.dtype == torch.uint8:
            array = array.permute(2, 0, 1).float() / 255.0
        seen[name] = array[None].to(request.device)
    seen |= {"task": given["instruction"], "robot_type": ""}
    with torch.inference_mode():
        action = after(policy.select_action(before(seen)))
    path = request.file("action.npy")
    np.save(path, np.asarray(action.float().cpu().numpy(), np.float64).reshape(-1))
    return dxb_backend.value("array", file=path)


def _policy(folder: str, version: str, device: str) -> tuple[Any, Any, Any]:
    """The policy, what prepares its observations, and what undoes the normalisation of its actions."""
    if _loaded.get("folder") == folder:
        parts: tuple[Any, Any, Any] = _loaded["parts"]
        return parts
    import dxb_backend

    here = importlib.metadata.version("lerobot")
    if here != version:
        raise dxb_backend.Refused(
            f"the policy was trained with LeRobot {version}, the environment has {here}",
            "write the lock file of the environment again and build, or install that version",
        )
    import torch
    from lerobot.configs.policies import PreTrainedConfig  # type: ignore[import-not-found]
    from lerobot.policies import factory  # type: ignore[import-not-found]

    if device == "cpu":
        torch.set_num_threads(1)
    config = PreTrainedConfig.from_pretrained(folder)
    config.device = device
    policy = factory.get_policy_class(config.type).from_pretrained(folder, config=config)
    policy.eval()
    before = after = _unchanged  # LeRobot up to 0.3 normalises within the policy
    if hasattr(factory, "make_pre_post_processors"):
        moved = {"device_processor": {"device": device}}
        before, after = factory.make_pre_post_processors(config, pretrained_path=folder, preprocessor_overrides=moved)
    _loaded.update(folder=folder, parts=(policy, before, after))
    return policy, before, after


def _unchanged(value: Any) -> Any:
    return value


if __name__ == "__main__":
    import dxb_backend

    dxb_backend.serve(act=act)
