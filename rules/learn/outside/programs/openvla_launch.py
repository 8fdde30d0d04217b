"""Runs a script of OpenVLA with a data set of dxb registered: `openvla_launch.py NAME LEAST_RANGE SCRIPT ARGUMENTS...`.

OpenVLA knows data sets by two tables of its repository, and normalises actions of end effectors only, all but the last
of seven. Here the tables get an entry, all numbers of an action are normalised, and the ranges that they are divided by
have a least size. The clone stays as it is.
"""

from __future__ import annotations

import runpy
import sys
from typing import Any


def main(name: str, least: float, script: str) -> None:
    """Register the data set, and run the script as a program."""
    import wandb  # type: ignore[import-not-found]
    from prismatic.vla.datasets.rlds import dataset  # type: ignore[import-not-found]
    from prismatic.vla.datasets.rlds.oxe import configs, materialize, transforms  # type: ignore[import-not-found]

    configs.OXE_DATASET_CONFIGS[name] = {
        "image_obs_keys": {"primary": "image", "secondary": None, "wrist": None},
        "depth_obs_keys": {"primary": None, "secondary": None, "wrist": None},
        "state_obs_keys": ["state"],
        "state_encoding": configs.StateEncoding.JOINT,
        "action_encoding": configs.ActionEncoding.EEF_POS,
    }
    transforms.OXE_STANDARDIZATION_TRANSFORMS[name] = _same
    kwargs_of, statistics_of = materialize.make_oxe_dataset_kwargs, dataset.get_dataset_statistics

    def kwargs(dataset_name: str, *given: Any, **more: Any) -> dict[str, Any]:
        found: dict[str, Any] = kwargs_of(dataset_name, *given, **more)
        # Masks for another number of joints than that of `EEF_POS`; without one, all are normalised.
        return {key: value for key, value in found.items() if not key.endswith("_mask")}

    def statistics(*given: Any, **more: Any) -> dict[str, Any]:
        return widened(statistics_of(*given, **more), least)

    materialize.make_oxe_dataset_kwargs = kwargs
    dataset.get_dataset_statistics = statistics
    wandb.log = _told
    runpy.run_path(script, run_name="__main__")


def widened(statistics: dict[str, Any], least: float) -> dict[str, Any]:
    """The statistics with q01 and q99, minimum and maximum of actions at least `least` apart, about their middles."""
    import numpy as np

    action = dict(statistics["action"])
    for low, high in (("q01", "q99"), ("min", "max")):
        lower, upper = np.asarray(action[low], np.float64), np.asarray(action[high], np.float64)
        more = np.maximum(least - (upper - lower), 0.0) / 2
        action |= {low: (lower - more).tolist(), high: (upper + more).tolist()}
    return {**statistics, "action": action}


def _same(trajectory: Any) -> Any:
    """The standard form: dxb writes it."""
    return trajectory


def _told(values: dict[str, Any], step: int = 0, **more: Any) -> None:
    """What would be logged at Weights & Biases, for the program that follows the output."""
    print(f"dxb step {step} loss {float(values['train_loss'])}", flush=True)


if __name__ == "__main__":
    dataset_name, least_range, path = sys.argv[1:4]
    sys.argv = sys.argv[3:]
    main(dataset_name, float(least_range), path)
