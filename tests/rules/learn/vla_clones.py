"""Stand-ins for clones of OpenVLA and openpi: the parts of their interfaces that a training touches.

Names of options, modules, tables and files are those of vla-scripts/finetune.py and prismatic/vla/datasets/rlds of
OpenVLA, and of scripts/ and src/openpi/training/config.py of openpi.
"""

from __future__ import annotations

from pathlib import Path

from tests.rules.learn import stand_in

TORCHRUN = """
import runpy, sys
words = sys.argv[1:]
assert words[:5] == ["--standalone", "--nnodes", "1", "--nproc-per-node", "1"], words
sys.argv = words[5:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""

OPENVLA = {
    "prismatic/__init__.py": "",
    "prismatic/vla/__init__.py": "",
    "prismatic/vla/datasets/__init__.py": "",
    "prismatic/vla/datasets/rlds/__init__.py": "",
    "prismatic/vla/datasets/rlds/oxe/__init__.py": "",
    "prismatic/vla/datasets/rlds/oxe/configs.py": """
from enum import IntEnum
class StateEncoding(IntEnum):
    NONE, JOINT = -1, 3
class ActionEncoding(IntEnum):
    EEF_POS, JOINT_POS = 1, 2
OXE_DATASET_CONFIGS = {}
""",
    "prismatic/vla/datasets/rlds/oxe/transforms.py": "OXE_STANDARDIZATION_TRANSFORMS = {}\n",
    "prismatic/vla/datasets/rlds/oxe/materialize.py": """
from copy import deepcopy
from prismatic.vla.datasets.rlds.oxe.configs import OXE_DATASET_CONFIGS, ActionEncoding
from prismatic.vla.datasets.rlds.oxe.transforms import OXE_STANDARDIZATION_TRANSFORMS

def make_oxe_dataset_kwargs(dataset_name, data_root_dir, load_camera_views=("primary",)):
    made = deepcopy(OXE_DATASET_CONFIGS[dataset_name])
    assert made["action_encoding"] is ActionEncoding.EEF_POS, "only EEF_POS & EEF_R6 actions supported!"
    made["absolute_action_mask"] = [False] * 6 + [True]
    made["action_normalization_mask"] = [True] * 6 + [False]
    made["standardize_fn"] = OXE_STANDARDIZATION_TRANSFORMS[dataset_name]
    return {"name": dataset_name, "data_dir": str(data_root_dir), **made}

def get_oxe_dataset_kwargs_and_weights(data_root_dir, mixture):
    return [make_oxe_dataset_kwargs(name, data_root_dir) for name, _ in mixture], [1.0]
""",
    "prismatic/vla/datasets/rlds/dataset.py": """
def get_dataset_statistics(dataset, hash_dependencies, save_dir=None):
    return {"action": {"q01": [-1.0, 0.5], "q99": [1.0, 0.5], "min": [-2.0, 0.499], "max": [2.0, 0.501],
                       "mean": [0.0, 0.5], "std": [1.0, 0.0]}, "num_transitions": 12}

def make_dataset_from_rlds(name, data_dir, **more):
    return get_dataset_statistics(None, hash_dependencies=(), save_dir=data_dir)
""",
    "vla-scripts/finetune.py": """
import json, os, sys
from pathlib import Path
import wandb
from prismatic.vla.datasets.rlds import dataset
from prismatic.vla.datasets.rlds.oxe import materialize

FIELDS = ["vla_path", "data_root_dir", "dataset_name", "run_root_dir", "adapter_tmp_dir", "batch_size", "max_steps",
          "save_steps", "learning_rate", "grad_accumulation_steps", "image_aug", "shuffle_buffer_size",
          "save_latest_checkpoint_only", "use_lora", "lora_rank", "lora_dropout", "use_quantization", "wandb_project",
          "wandb_entity", "run_id_note"]
words = sys.argv[1:]
given = dict(zip([word[2:] for word in words[::2]], words[1::2]))
assert all(word.startswith("--") for word in words[::2]) and set(given) <= set(FIELDS), words
assert os.environ["WANDB_MODE"] == "disabled"
name, root = given["dataset_name"], Path(given["data_root_dir"])
assert (root / name / "1.0.0" / "dataset_info.json").is_file()
(kwargs,), _ = materialize.get_oxe_dataset_kwargs_and_weights(root, [(name, 1.0)])
assert kwargs["image_obs_keys"]["primary"] == "image"
statistics = dataset.make_dataset_from_rlds(**kwargs)
exp = f"openvla-7b+{name}+b{given['batch_size']}"
run, adapters = Path(given["run_root_dir"]) / exp, Path(given["adapter_tmp_dir"]) / exp
for folder in (run, adapters):
    folder.mkdir(parents=True)
told = {name: statistics, "kwargs": sorted(kwargs), "given": given}
(run / "dataset_statistics.json").write_text(json.dumps(told))
for step in range(int(given["max_steps"]) + 1):
    if step and given["lora_rank"] == "13":
        raise MemoryError("CUDA out of memory. Tried to allocate 14.00 GiB")
    if step % 10 == 0:
        loss = float("nan") if given["lora_rank"] == "7" and step else 1.0 / (1 + step)
        wandb.log({"train_loss": loss, "action_accuracy": 0.5, "l1_loss": 0.1}, step=step)
    if step and step % int(given["save_steps"]) == 0:
        (adapters / "adapter_model.safetensors").write_text(f"adapters of step {step}")
        (adapters / "adapter_config.json").write_text(json.dumps({"base_model_name_or_path": given["vla_path"]}))
""",
}

OPENPI = {
    "src/openpi/__init__.py": "",
    "src/openpi/models/__init__.py": "",
    "src/openpi/models/pi0_config.py": """
import dataclasses
@dataclasses.dataclass(frozen=True)
class Pi0Config:
    paligemma_variant: str = "gemma_2b"
    action_expert_variant: str = "gemma_300m"
    action_dim: int = 32
    action_horizon: int = 50
    pi05: bool = False
    def get_freeze_filter(self):
        return f"all but adapters of {self.paligemma_variant}"
""",
    "src/openpi/transforms.py": """
import dataclasses
import numpy as np

@dataclasses.dataclass(frozen=True)
class Group:
    inputs: tuple = ()
    outputs: tuple = ()
    def push(self, *, inputs=(), outputs=()):
        return Group((*self.inputs, *inputs), (*outputs, *self.outputs))

@dataclasses.dataclass(frozen=True)
class RepackTransform:
    structure: dict
    def __call__(self, data):
        return {new: data[old] for new, old in self.structure.items() if old in data}

@dataclasses.dataclass(frozen=True)
class DeltaActions:
    mask: tuple
    def __call__(self, data):
        return {**data, "actions": data["actions"] - np.where(self.mask, data["state"], 0)}

@dataclasses.dataclass(frozen=True)
class AbsoluteActions:
    mask: tuple
    def __call__(self, data):
        return data

def make_bool_mask(*dims):
    return tuple(part for size in dims for part in [size > 0] * abs(size))
""",
    "src/openpi/training/__init__.py": "",
    "src/openpi/training/weight_loaders.py": """
import dataclasses
@dataclasses.dataclass(frozen=True)
class CheckpointWeightLoader:
    params_path: str
""",
    "src/openpi/training/config.py": """
import dataclasses, pathlib, sys
import openpi.transforms as _transforms

@dataclasses.dataclass(frozen=True)
class DataConfig:
    repo_id: str = ""
    prompt_from_task: bool = False
    repack_transforms: object = None
    data_transforms: object = None
    model_transforms: object = None
    action_sequence_keys: tuple = ("actions",)

@dataclasses.dataclass(frozen=True)
class DataConfigFactory:
    repo_id: str = ""
    base_config: object = None
    def create_base_config(self, assets_dirs, model_config):
        return dataclasses.replace(self.base_config or DataConfig(), repo_id=self.repo_id)

class ModelTransformFactory:
    def __call__(self, model_config):
        return _transforms.Group()

@dataclasses.dataclass(frozen=True)
class TrainConfig:
    name: str
    exp_name: str = ""
    model: object = None
    weight_loader: object = None
    freeze_filter: object = None
    ema_decay: float | None = 0.99
    data: object = None
    assets_base_dir: str = "./assets"
    checkpoint_base_dir: str = "./checkpoints"
    seed: int = 42
    batch_size: int = 32
    num_workers: int = 2
    num_train_steps: int = 30_000
    log_interval: int = 100
    save_interval: int = 1000
    overwrite: bool = False
    resume: bool = False
    wandb_enabled: bool = True
    @property
    def assets_dirs(self):
        return pathlib.Path(self.assets_base_dir) / self.name
    @property
    def checkpoint_dir(self):
        return pathlib.Path(self.checkpoint_base_dir) / self.name / self.exp_name

_CONFIGS_DICT = {}

def get_config(name):
    return _CONFIGS_DICT[name]

def cli():
    name, *words = sys.argv[1:]
    made = get_config(name)
    for word in words:
        key, _, value = word[2:].partition("=")
        on = not key.startswith("no-")
        field = key.removeprefix("no-").replace("-", "_")
        kind = type(getattr(made, field))
        made = dataclasses.replace(made, **{field: kind(value) if value else on})
    return made
""",
    "scripts/compute_norm_stats.py": """
import json, os, sys
from pathlib import Path
import numpy as np
import openpi.training.config as _config

assert sys.argv[1:] == ["--config-name", "dextera"], sys.argv
config = _config.get_config("dextera")
data = config.data.create(config.assets_dirs, config.model)
assert (Path(os.environ["HF_LEROBOT_HOME"]) / data.repo_id / "meta" / "info.json").is_file()
assert data.action_sequence_keys == ("action",) and data.prompt_from_task
item = {"observation.images.workspace": np.full((3, 4, 6), 0.5, np.float32), "observation.state": np.ones(3),
        "action": np.full((2, 3), 1.5), "prompt": "lift box"}
for transform in (*data.repack_transforms.inputs, *data.data_transforms.inputs):
    item = transform(item)
assert item["image"]["base_0_rgb"].shape == (4, 6, 3) and item["image"]["base_0_rgb"].max() == 127
assert not item["image_mask"]["left_wrist_0_rgb"] and item["prompt"] == "lift box"
np.testing.assert_allclose(item["actions"], 0.5)
answer = {"actions": np.zeros((50, 32))}
for transform in data.data_transforms.outputs:
    answer = transform(answer)
assert answer["actions"].shape == (50, 3)
out = config.assets_dirs / data.repo_id
out.mkdir(parents=True)
one = {"mean": [0.0, 0.5, 0.0], "std": [1.0, 0.0, 1.0], "q01": [-1.0, 0.5, -1.0], "q99": [1.0, 0.5, 1.0]}
(out / "norm_stats.json").write_text(json.dumps({"norm_stats": {"state": one, "actions": one}}))
""",
    "scripts/train.py": """
import json, os, shutil
import openpi.training.config as _config

config = _config.cli()
assert config.resume and not config.overwrite and not config.wandb_enabled
assert config.ema_decay is None and "gemma_2b_lora" in config.freeze_filter and config.model.pi05
statistics = config.assets_dirs / "local" / "data" / "norm_stats.json"
done = sorted(int(path.name) for path in config.checkpoint_dir.glob("*")) if config.checkpoint_dir.exists() else []
first = done[-1] if done else 0
print(f"first {first} from {config.weight_loader.params_path}")
for step in range(first, config.num_train_steps):
    if config.seed == 7 and step == 3 and not done:
        raise RuntimeError("RESOURCE_EXHAUSTED: Out of memory while trying to allocate 2147483648 bytes.")
    loss = "nan" if config.seed == 8 else f"{1 / (1 + step):.4f}"
    print(f"Step {step}: grad_norm=1.0000, loss={loss}, param_norm=1800.0000", flush=True)
    if (step % config.save_interval == 0 and step > first) or step == config.num_train_steps - 1:
        folder = config.checkpoint_dir / str(step)
        (folder / "params").mkdir(parents=True)
        (folder / "params" / "manifest.ocdbt").write_text(f"params of step {step}")
        (folder / "train_state").mkdir()
        shutil.copytree(config.assets_dirs, folder / "assets")
""",
}


def openvla(project: Path) -> Path:
    """A project with an environment that has a clone of OpenVLA; returns the folder of a base model."""
    packages = stand_in.environment(
        project,
        "openvla",
        {
            "torch/__init__.py": "",
            "torch/distributed/__init__.py": "",
            "torch/distributed/run.py": TORCHRUN,
            "wandb.py": "def log(*given, **more): ...\n",
        },
    )
    return _cloned(project, packages, OPENVLA, "")


def openpi(project: Path) -> Path:
    """The same of openpi."""
    packages = stand_in.environment(project, "openpi", {})
    return _cloned(project, packages, OPENPI, "src")


def _cloned(project: Path, packages: Path, files: dict[str, str], source: str) -> Path:
    clone, base = project / "clone", project / "base"
    for name, text in files.items():
        path = clone / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (packages / "clone.pth").write_text(str(clone / source))  # as `pip install -e` does
    base.mkdir()
    (base / "config.json").write_text("{}")
    return base
