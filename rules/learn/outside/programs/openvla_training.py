"""Program of the backend of learn.openvla: runs OpenVLA's `finetune.py` in the environment of OpenVLA."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]
import trainer  # type: ignore[import-not-found]  # in this folder

NAME = "OpenVLA's trainer"
_LINE = re.compile(r"^dxb step (\d+) loss (\S+)")
LAUNCH = Path(__file__).with_name("openvla_launch.py")


def train(request: Any) -> Any:
    """Adapters, statistics of the data, the curve of the loss, and the digest of the base model."""
    common = request.inputs["common"]
    clone = trainer.clone("prismatic", "vla-scripts/finetune.py", "https://github.com/openvla/openvla")
    base = _base(common.base)
    data, keep = Path(str(request.inputs["data"].path)), Path(request.inputs["keep"])
    (name,) = (path.name for path in data.iterdir() if path.is_dir())
    for part in ("runs", "adapters"):
        shutil.rmtree(keep / part, ignore_errors=True)  # of a training that was interrupted
    points: list[tuple[int, float]] = []

    def read(line: str) -> None:
        found = _LINE.search(line)
        if found is None:
            return
        step, loss = int(found[1]), float(found[2])
        if not math.isfinite(loss):
            raise trainer.not_finite(NAME, step)
        points.append((step, loss))
        request.progress(min(step, common.steps), common.steps, f"loss {loss:.3f}")

    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nnodes", "1", "--nproc-per-node", "1"]
    command += [str(LAUNCH), name, str(common.least_range_rad), str(clone / "vla-scripts" / "finetune.py")]
    command += _arguments(common, base, data, name, keep)
    trainer.follow(NAME, command, read, str(clone), WANDB_MODE="disabled")
    return _answer(request, keep, name, base, points)


def _arguments(common: Any, base: Path, data: Path, name: str, keep: Path) -> Iterator[str]:
    """Arguments of finetune.py, which are fields of its `FinetuneConfig`."""
    fields = {
        "vla_path": base,
        "data_root_dir": data,
        "dataset_name": name,
        "run_root_dir": keep / "runs",
        "adapter_tmp_dir": keep / "adapters",
        "batch_size": common.batch,
        "max_steps": common.steps,
        "save_steps": common.steps,  # every saving merges the adapters into a copy of the base
        "learning_rate": common.rate,
        "grad_accumulation_steps": common.accumulate,
        "image_aug": common.augment,
        "shuffle_buffer_size": common.shuffle,
        "use_lora": True,
        "lora_rank": common.rank,
        "lora_dropout": common.dropout,
        "use_quantization": common.quantise,
    }
    for field, value in fields.items():
        yield f"--{field}"
        yield str(value)


def _base(folder: str) -> Path:
    path = Path(folder).expanduser()
    if not folder or not (path / "config.json").is_file():
        hint = "download openvla/openvla-7b, `huggingface-cli download ... --local-dir FOLDER`, then `base: FOLDER`"
        raise dxb_backend.Refused(f"`base` names no folder with a model: `{folder}`", hint)
    return path.resolve()


def _answer(request: Any, keep: Path, name: str, base: Path, points: list[tuple[int, float]]) -> Any:
    adapters = list((keep / "adapters").glob("*/adapter_model.safetensors"))
    statistics = list((keep / "runs").glob("*/dataset_statistics.json"))
    if len(adapters) != 1 or len(statistics) != 1:
        raise dxb_backend.Refused(f"{NAME} saved no adapters", trainer.LOGGED)
    out = request.file("trained")
    out.mkdir()
    for path in (adapters[0], adapters[0].with_name("adapter_config.json"), statistics[0]):
        shutil.copyfile(path, out / path.name)
    config = json.loads((out / "adapter_config.json").read_text())
    # The folder of the base is another one on another machine; its digest says which model it was.
    digest = trainer.digest_of(base)
    config["base_model_name_or_path"] = f"sha256:{digest}"
    (out / "adapter_config.json").write_text(json.dumps(config, indent=1, sort_keys=True))
    return trainer.answer(request, out, points, version=trainer.revision("prismatic"), base=digest)


if __name__ == "__main__":
    dxb_backend.serve(train=train)
