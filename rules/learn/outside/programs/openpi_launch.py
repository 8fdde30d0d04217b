"""Runs a script of openpi with a configuration for a data set of dxb: `openpi_launch.py SETTINGS.json SCRIPT ...`.

openpi knows configurations by a table in its code. Here the table gets an entry; the clone stays as it is. It also
serves what was trained: `launch.py settings.json scripts/serve_policy.py policy:checkpoint --policy.config=dextera
--policy.dir=FOLDER`.
"""

from __future__ import annotations

import dataclasses
import json
import runpy
import sys
from pathlib import Path
from typing import Any


def main(settings: dict[str, Any], script: str) -> None:
    """Register the configuration, and run the script as a program."""
    from openpi.training import config  # type: ignore[import-not-found]

    made = configured(settings)
    config._CONFIGS_DICT[made.name] = made
    runpy.run_path(script, run_name="__main__")


def configured(settings: dict[str, Any]) -> Any:
    """A `TrainConfig` of openpi for a data set of dxb with one camera."""
    from openpi.models import pi0_config  # type: ignore[import-not-found]
    from openpi.training import config, weight_loaders

    kinds = ("gemma_2b", "gemma_300m")
    large, small = (f"{kind}_lora" for kind in kinds) if settings["adapters"] else kinds
    model = pi0_config.Pi0Config(
        pi05=settings["model"] == "pi05",
        action_horizon=settings["horizon"],
        paligemma_variant=large,
        action_expert_variant=small,
    )
    more: dict[str, Any] = {}
    if settings["adapters"]:
        more = {"freeze_filter": model.get_freeze_filter(), "ema_decay": None}
    if "base" in settings:
        more["weight_loader"] = weight_loaders.CheckpointWeightLoader(settings["base"])
    if "assets" in settings:
        more["assets_base_dir"] = settings["assets"]
    return config.TrainConfig(name=settings["name"], model=model, data=_data(settings), **more)


def _data(settings: dict[str, Any]) -> Any:
    """How columns of the data set, and requests, become what the model takes."""
    from openpi import transforms  # type: ignore[import-not-found]
    from openpi.training import config

    joints = settings["joints"]

    @dataclasses.dataclass(frozen=True)
    class Data(config.DataConfigFactory):  # type: ignore[misc]
        def create(self, assets_dirs: Path, model_config: Any) -> Any:
            names = {"observation/image": settings["camera"], "observation/state": "observation.state"}
            names |= {"actions": "action", "prompt": "prompt"}
            group = transforms.Group(inputs=[Inputs()], outputs=[Outputs(joints)])
            if settings["relative"]:
                mask = transforms.make_bool_mask(joints)
                group = group.push(inputs=[transforms.DeltaActions(mask)], outputs=[transforms.AbsoluteActions(mask)])
            return dataclasses.replace(
                self.create_base_config(assets_dirs, model_config),
                repack_transforms=transforms.Group(inputs=[transforms.RepackTransform(names)]),
                data_transforms=group,
                model_transforms=config.ModelTransformFactory()(model_config),
                action_sequence_keys=("action",),
            )

    return Data(repo_id=settings["set"], base_config=config.DataConfig(prompt_from_task=True))


@dataclasses.dataclass(frozen=True)
class Inputs:
    """An observation of one camera as the model takes it; the cameras at the wrists are absent."""

    def __call__(self, data: dict[str, Any]) -> dict[str, Any]:
        """Names of the model for those of the data set."""
        import numpy as np

        picture = np.asarray(data["observation/image"])
        if np.issubdtype(picture.dtype, np.floating):  # LeRobot's (3, H, W) in 0..1
            picture = np.moveaxis((255 * picture).astype(np.uint8), 0, -1)
        absent = np.zeros_like(picture)
        made = {
            "state": np.asarray(data["observation/state"]),
            "image": {"base_0_rgb": picture, "left_wrist_0_rgb": absent, "right_wrist_0_rgb": absent},
            "image_mask": {
                "base_0_rgb": np.True_,
                "left_wrist_0_rgb": np.False_,
                "right_wrist_0_rgb": np.False_,
            },
        }
        return made | {name: data[name] for name in ("actions", "prompt") if name in data}


@dataclasses.dataclass(frozen=True)
class Outputs:
    """The joints' part of the model's actions, which are padded."""

    joints: int

    def __call__(self, data: dict[str, Any]) -> dict[str, Any]:
        """Actions (H, A)."""
        import numpy as np

        return {"actions": np.asarray(data["actions"])[:, : self.joints]}


if __name__ == "__main__":
    told = json.loads(Path(sys.argv[1]).read_text())
    sys.argv = sys.argv[2:]
    main(told, sys.argv[0])
