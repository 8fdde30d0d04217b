"""Program of the backends of learn.lerobot: runs LeRobot's trainer in the environment of LeRobot."""

from __future__ import annotations

import importlib.metadata
import importlib.util
import json
import math
import re
import shutil
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]
import lerobot_ranges  # type: ignore[import-not-found]  # in this folder
import trainer  # type: ignore[import-not-found]  # in this folder

NAME = "LeRobot's trainer"
_LINE = re.compile(r"\bstep:\S+.*\bloss:(\S+)")
_REGISTERED = re.compile(r"""@PreTrainedConfig\.register_subclass\(\s*(?:name\s*=\s*)?["']([^"']+)["']""")
_VERSION = re.compile(r"""^CODEBASE_VERSION\s*=\s*["']([^"']+)["']""", re.MULTILINE)
_KEPT = (".json", ".safetensors", ".model", ".txt")
"""Files of a trained policy; none of them can hold code."""
_POINTS = 200
"""Most points of the curve."""


def train(request: Any) -> Any:
    """The trained policy's files, the curve of the loss, and facts about the training."""
    lerobot = _package()
    common, data = request.inputs["common"], Path(str(request.inputs["data"].path))
    _check_version(lerobot, data)
    _check_type(lerobot, common["type"])
    run = Path(request.inputs["keep"]) / "run"
    progress = Progress(run.with_name("curve.txt"), request, common)
    begun = _last(run)
    if begun is None:
        shutil.rmtree(run, ignore_errors=True)
        progress.begin(0)
    else:
        progress.begin(_step(begun))
    if begun is None or progress.step < common.steps:
        wide = lerobot_ranges.linked(data, run.with_name("data"), common.least_range_rad)
        command = [sys.executable, "-m", _module(lerobot), *_arguments(request, wide, run, begun, progress.every)]
        own = {"WANDB_MODE": "disabled", "HF_DATASETS_CACHE": str(run.with_name("read"))}
        trainer.follow(NAME, command, progress.read, str(run.parent), **own)
    made = _last(run)
    if made is None or _step(made) < common.steps:
        raise dxb_backend.Refused(f"{NAME} ended without its last checkpoint", trainer.LOGGED)
    return _answer(request, made / "pretrained_model", data, progress.points())


class Progress:
    """Follows the trainer's output: curve, progress, a loss that is no number, and checkpoints that are superseded.

    Args:
        file: Keeps the curve of a training that may be interrupted.
        request: The request.
        common: Options of the rule.
    """

    def __init__(self, file: Path, request: Any, common: Any) -> None:
        self._file, self._request, self._steps = file, request, common.steps
        self.every = max(1, math.ceil(common.steps / _POINTS))
        """Steps between lines of the trainer."""
        self.step = 0

    def begin(self, step: int) -> None:
        """Forget what lies after the checkpoint from which the training goes on."""
        kept = [point for point in self.points() if point[0] <= step]
        self._file.write_text("".join(f"{at} {loss}\n" for at, loss in kept))
        self.step = step // self.every * self.every
        if step:
            print(f"going on after {step:,} steps", flush=True)

    def points(self) -> list[tuple[int, float]]:
        """Steps and losses."""
        if not self._file.exists():
            return []
        rows = [line.split() for line in self._file.read_text().splitlines()]
        return [(int(row[0]), float(row[1])) for row in rows if len(row) == 2]

    def read(self, line: str) -> None:
        """A line of the trainer."""
        if "Checkpoint policy after step" in line:
            _thin(self._file.with_name("run"))
        found = _LINE.search(line)
        if found is None:
            return
        self.step += self.every
        loss = float(found[1])
        if not math.isfinite(loss):
            raise trainer.not_finite(NAME, self.step)
        with self._file.open("a") as opened:
            opened.write(f"{self.step} {loss}\n")
        self._request.progress(min(self.step, self._steps), self._steps, f"loss {loss:.3f}")


def _package() -> Path:
    found = importlib.util.find_spec("lerobot")
    if found is None or not found.submodule_search_locations:
        raise dxb_backend.Refused("the environment has no LeRobot", "`.envs/lerobot/bin/pip install lerobot`")
    return Path(found.submodule_search_locations[0])


def _module(lerobot: Path) -> str:
    """The module of the trainer: `lerobot_train` from 0.4 on, `train` before."""
    for name in ("lerobot_train", "train"):
        if (lerobot / "scripts" / f"{name}.py").is_file():
            return f"lerobot.scripts.{name}"
    raise dxb_backend.Refused("this LeRobot has no trainer in `lerobot/scripts`", "install LeRobot 0.3 or newer")


def _check_version(lerobot: Path, data: Path) -> None:
    """Refuse a data set of another format, which LeRobot explains by an address of its own."""
    has = json.loads((data / "meta" / "info.json").read_text())["codebase_version"]
    reads = {one for path in (lerobot / "datasets").glob("*.py") for one in _VERSION.findall(path.read_text())}
    if reads and has not in reads:
        wanted = min(reads)
        raise dxb_backend.Refused(
            f"the data set has version {has}, LeRobot {_version()} reads {wanted}",
            f"`version: {wanted}` of demonstrate.lerobot" if wanted in ("v2.1", "v3.0") else "install another LeRobot",
        )


def _check_type(lerobot: Path, kind: str) -> None:
    """Refuse an unknown kind; packages called `lerobot_policy_...` may bring others."""
    files = sorted((lerobot / "policies").rglob("configuration_*.py"))
    known = sorted({name for path in files for name in _REGISTERED.findall(path.read_text())})
    added = [one for one in importlib.metadata.distributions() if str(one.name).startswith("lerobot_policy")]
    if known and kind not in known and not added:
        raise dxb_backend.Refused(f"LeRobot {_version()} has no policy `{kind}`", f"`type`: one of {', '.join(known)}")


def _version() -> str:
    return importlib.metadata.version("lerobot")


def _arguments(request: Any, data: Path, run: Path, begun: Path | None, every: int) -> Iterator[str]:
    """Arguments of the trainer, of one that goes on if `begun` is a checkpoint."""
    common, base = request.inputs["common"], request.inputs["base"]
    yield "--dataset.repo_id=local/data"
    yield f"--dataset.root={data}"
    yield f"--output_dir={run}"
    if begun is not None:
        yield f"--config_path={begun / 'pretrained_model' / 'train_config.json'}"
        yield "--resume=true"
    elif base is not None:
        yield f"--policy.path={base.path}"
    else:
        yield f"--policy.type={common['type']}"
    yield f"--policy.device={request.device}"
    yield "--policy.push_to_hub=false"
    yield "--wandb.enable=false"
    yield "--eval_freq=0"
    yield f"--log_freq={every}"
    yield f"--save_freq={common.save_every}"
    yield f"--steps={common.steps}"
    yield f"--batch_size={common.batch}"
    yield f"--num_workers={common.workers}"
    yield f"--seed={common.seed}"
    for name, value in _items(common.policy):
        yield f"--policy.{name}={_word(value)}"
    for name, value in _items(common.trainer):
        yield f"--{name}={_word(value)}"


def _items(value: Any) -> Iterator[tuple[str, Any]]:
    """Names and values of a map, which comes as a value with parts."""
    found: Mapping[str, Any] = getattr(value, "parts", value) or {}
    yield from sorted(found.items())


def _word(value: Any) -> str:
    """A value as the trainer's command line takes it."""
    return value if isinstance(value, str) else json.dumps(value)


def _last(run: Path) -> Path | None:
    """The last complete checkpoint of a training, or None.

    The trainer sets the link `last` after a checkpoint is complete, by removing the former one first.
    """
    link = run / "checkpoints" / "last"
    if link.is_dir():
        return link.resolve()
    found = sorted(path for path in link.parent.glob("*") if path.name.isdecimal())
    return found[-1] if len(found) > 1 else None


def _step(checkpoint: Path) -> int:
    step: int = json.loads((checkpoint / "training_state" / "training_step.json").read_text())["step"]
    return step


def _thin(run: Path) -> None:
    """Remove the checkpoints before the last complete one: those of large policies fill a disk."""
    last = run / "checkpoints" / "last"
    if not last.is_dir():
        return
    for path in last.parent.iterdir():
        if path.name.isdecimal() and path.name < last.resolve().name:
            shutil.rmtree(path, ignore_errors=True)


def _answer(request: Any, policy: Path, data: Path, points: list[tuple[int, float]]) -> Any:
    out = request.file("policy")
    out.mkdir()
    for path in sorted(policy.iterdir()):
        # The trainer's settings hold folders of this run; a policy needs `config.json` only.
        if path.suffix in _KEPT and path.name != "train_config.json":
            shutil.copyfile(path, out / path.name)
    if not (out / "model.safetensors").is_file():
        raise dxb_backend.Refused(
            "the trained policy has no `model.safetensors`",
            "train all weights: adapters cannot be run without their base",
        )
    config = json.loads((out / "config.json").read_text())
    (out / "config.json").write_text(json.dumps({**config, "pretrained_path": None}, indent=1, sort_keys=True))
    return trainer.answer(request, out, points, version=_version(), instruction=_instruction(data))


def _instruction(data: Path) -> str:
    """The words of the data set's task."""
    lines = data / "meta" / "tasks.jsonl"
    if lines.is_file():
        return str(json.loads(lines.read_text().splitlines()[0])["task"])
    from pyarrow import parquet

    table = parquet.read_table(data / "meta" / "tasks.parquet")
    (words,) = (name for name in table.column_names if name != "task_index")
    return str(table[words][0].as_py())


if __name__ == "__main__":
    dxb_backend.serve(train=train)
