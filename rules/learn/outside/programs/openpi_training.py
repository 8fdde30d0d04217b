"""Program of the backend of learn.openpi: runs openpi's trainer in the environment of openpi."""

from __future__ import annotations

import json
import math
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import dxb_backend  # type: ignore[import-not-found]
import trainer  # type: ignore[import-not-found]  # in this folder

NAME = "openpi's trainer"
CONFIG, RUN, SET = "dextera", "run", "local/data"
LAUNCH = Path(__file__).with_name("openpi_launch.py")
_LINE = re.compile(r"\bStep (\d+): .*\bloss=([^,\s]+)")


def train(request: Any) -> Any:
    """Weights, statistics of the data, the curve of the loss, and the digest of the base."""
    common = request.inputs["common"]
    clone = trainer.clone("openpi", "scripts/train.py", "https://github.com/Physical-Intelligence/openpi")
    base, keep = _base(common.base), Path(request.inputs["keep"])
    sets = keep / "sets"
    shutil.rmtree(sets, ignore_errors=True)
    (sets / SET).parent.mkdir(parents=True)
    (sets / SET).symlink_to(Path(str(request.inputs["data"].path)).resolve())
    settings = _settings(request, base, keep)
    (keep / "settings.json").write_text(json.dumps(settings, indent=1, sort_keys=True))
    home = {"HF_LEROBOT_HOME": str(sets), "LEROBOT_HOME": str(sets), "WANDB_MODE": "disabled"}
    launch = [sys.executable, str(LAUNCH), str(keep / "settings.json")]
    statistics = keep / "assets" / CONFIG / SET / "norm_stats.json"
    if not statistics.exists():
        aside = statistics.with_name("norm_stats.seen")
        words = [str(clone / "scripts" / "compute_norm_stats.py"), "--config-name", CONFIG]
        trainer.follow("openpi's statistics", [*launch, *words], lambda line: None, str(clone), **home)
        seen = json.loads(statistics.read_text())
        aside.write_text(json.dumps(widened(seen, common.least_range_rad)))
        aside.replace(statistics)
    progress = Progress(keep / "curve.txt", request, common.steps)
    words = [str(clone / "scripts" / "train.py"), CONFIG, *_arguments(common, keep)]
    trainer.follow(NAME, [*launch, *words], progress.read, str(clone), **home)
    return _answer(request, keep, base, settings, progress.points())


class Progress:
    """Follows the trainer's output; the curve outlives an interruption.

    Args:
        file: Keeps the curve.
        request: The request.
        steps: Number of steps.
    """

    def __init__(self, file: Path, request: Any, steps: int) -> None:
        self._file, self._request, self._steps = file, request, steps

    def points(self) -> list[tuple[int, float]]:
        """Steps and losses; of steps that were repeated after an interruption, the last ones."""
        rows = [line.split() for line in self._file.read_text().splitlines()] if self._file.exists() else []
        return sorted({int(row[0]): float(row[1]) for row in rows if len(row) == 2}.items())

    def read(self, line: str) -> None:
        """A line of the trainer."""
        found = _LINE.search(line)
        if found is None:
            return
        step, loss = int(found[1]), float(found[2])
        if not math.isfinite(loss):
            raise trainer.not_finite(NAME, step)
        with self._file.open("a") as opened:
            opened.write(f"{step} {loss}\n")
        self._request.progress(min(step, self._steps), self._steps, f"loss {loss:.4f}")


def widened(statistics: dict[str, Any], least: float) -> dict[str, Any]:
    """norm_stats.json with q01 and q99 of every number at least `least` apart, about their middle."""
    made: dict[str, Any] = {}
    for key, values in statistics["norm_stats"].items():
        pairs = list(zip(values["q01"], values["q99"], strict=True))
        more = [max(least - (high - low), 0.0) / 2 for low, high in pairs]
        made[key] = {
            **values,
            "std": [max(std, least / 4) for std in values["std"]],
            "q01": [low - own for (low, _), own in zip(pairs, more, strict=True)],
            "q99": [high + own for (_, high), own in zip(pairs, more, strict=True)],
        }
    return {"norm_stats": made}


def _settings(request: Any, base: Path, keep: Path) -> dict[str, Any]:
    """What `openpi_launch.py` makes openpi's configuration of."""
    common = request.inputs["common"]
    return {
        "name": CONFIG,
        "model": common.model,
        "adapters": common.adapters,
        "horizon": common.horizon,
        "relative": common.relative,
        "joints": request.inputs["joints"],
        "camera": request.inputs["camera"],
        "set": SET,
        "base": str(base),
        "assets": str(keep / "assets"),
    }


def _arguments(common: Any, keep: Path) -> list[str]:
    """Arguments of train.py, which override fields of its `TrainConfig`; `--resume` also begins."""
    return [
        f"--exp-name={RUN}",
        f"--checkpoint-base-dir={keep / 'checkpoints'}",
        f"--num-train-steps={common.steps}",
        f"--batch-size={common.batch}",
        f"--num-workers={common.workers}",
        f"--save-interval={common.save_every}",
        f"--seed={common.seed}",
        "--no-wandb-enabled",
        "--resume",
    ]


def _base(folder: str) -> Path:
    path = Path(folder).expanduser()
    if not folder or not path.is_dir():
        hint = "download `gs://openpi-assets/checkpoints/pi05_base/params`, then `base: FOLDER/params`"
        raise dxb_backend.Refused(f"`base` names no folder with weights: `{folder}`", hint)
    return path.resolve()


def _answer(request: Any, keep: Path, base: Path, settings: dict[str, Any], points: list[tuple[int, float]]) -> Any:
    runs = (keep / "checkpoints" / CONFIG / RUN).glob("*")
    done = sorted((path for path in runs if path.name.isdecimal()), key=lambda path: int(path.name))
    if not done or int(done[-1].name) < request.inputs["common"].steps - 1:
        raise dxb_backend.Refused(f"{NAME} ended without its last checkpoint", trainer.LOGGED)
    out = request.file("trained")
    out.mkdir()
    for part in ("params", "assets"):
        shutil.copytree(done[-1] / part, out / part)
    # Serving needs the configuration, but neither the base nor folders of this run.
    kept = {name: value for name, value in settings.items() if name not in ("base", "assets")}
    (out / "settings.json").write_text(json.dumps(kept, indent=1, sort_keys=True))
    shutil.copyfile(LAUNCH, out / "launch.py")
    version = trainer.revision("openpi")
    return trainer.answer(request, out, points, version=version, base=trainer.digest_of(base))


if __name__ == "__main__":
    dxb_backend.serve(train=train)
