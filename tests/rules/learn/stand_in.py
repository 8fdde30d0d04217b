"""Stand-ins for the environments of other projects: the command lines, files and logs of their trainers."""

from __future__ import annotations

import sys
import venv
from pathlib import Path

LEROBOT = {
    "lerobot-0.4.4.dist-info/METADATA": "Metadata-Version: 2.1\nName: lerobot\nVersion: 0.4.4\n",
    "lerobot/__init__.py": "",
    "lerobot/datasets/lerobot_dataset.py": 'CODEBASE_VERSION = "v3.0"\n',
    "lerobot/policies/act/configuration_act.py": '@PreTrainedConfig.register_subclass("act")\nclass ACTConfig: ...\n',
    "lerobot/policies/pi05/configuration_pi05.py": '@PreTrainedConfig.register_subclass("pi05")\nclass C: ...\n',
    "lerobot/scripts/lerobot_train.py": """
import json, os, sys, time
from pathlib import Path

given = dict(word[2:].split("=", 1) for word in sys.argv[1:])
out, steps, every = Path(given["output_dir"]), int(given["steps"]), int(given["log_freq"])
assert given["policy.push_to_hub"] == "false" and given["wandb.enable"] == "false"
assert (Path(given["dataset.root"]) / "meta" / "info.json").is_file()
step = 0
if given.get("resume") == "true":
    checkpoint = Path(given["config_path"]).parents[1]
    step = json.loads((checkpoint / "training_state" / "training_step.json").read_text())["step"]
else:
    assert not out.exists()
with (out.parent / "calls.txt").open("a") as calls:
    calls.write(f"{step} {' '.join(sys.argv[1:])}\\n")
fault, at = (given.get("policy.fault", "") + ":0").split(":")[:2]

def save():
    folder = out / "checkpoints" / f"{step:06d}"
    for part, files in {
        "pretrained_model": {
            "config.json": json.dumps({"type": given.get("policy.type", "act"), "pretrained_path": "/tmp/x"}),
            "model.safetensors": f"weights of step {step}",
            "policy_preprocessor.json": "{}",
            "train_config.json": json.dumps({"output_dir": str(out)}),
            "optimizer.pt": "a pickle",
        },
        "training_state": {"training_step.json": json.dumps({"step": step})},
    }.items():
        (folder / part).mkdir(parents=True)
        for name, text in files.items():
            (folder / part / name).write_text(text)
    link = folder.parent / "last"
    link.unlink(missing_ok=True)
    link.symlink_to(folder.name)

while step < steps:
    step += 1
    if fault and step == int(at):
        if fault == "exit":
            print("Traceback (most recent call last):", file=sys.stderr)
            print("ValueError: the embedding dimension is not divisible", file=sys.stderr)
            raise SystemExit(1)
        if fault == "memory":
            print("torch.OutOfMemoryError: CUDA out of memory. Tried to allocate 2.00 GiB.", file=sys.stderr)
            raise SystemExit(1)
        if fault == "module":
            raise ModuleNotFoundError("No module named 'diffusers'")
        if fault == "once" and not (out.parent / "fell").exists():
            (out.parent / "fell").touch()
            os.kill(os.getpid(), 11)
    if step % every == 0:
        loss = "nan" if fault == "nan" and step >= int(at) else f"{1.0 / step:.3f}"
        print(f"INFO 2026-01-01 00:00:00 a.py:447 step:{step} smpl:8 ep:1 epch:0.01 loss:{loss} grdn:1.0 lr:1e-5")
        print(f"Training:  10%|#         | {step}/{steps}", end="\\r", flush=True)
    if step % int(given["save_freq"]) == 0 or step == steps:
        print(f"INFO 2026-01-01 00:00:00 ot_train.py:455 Checkpoint policy after step {step}", flush=True)
        save()
print("End of training")
""",
}


def environment(project: Path, name: str, modules: dict[str, str]) -> Path:
    """A virtual environment with these modules and this one's NumPy, beside its lock file; returns its packages."""
    folder = project / ".envs" / name
    venv.create(folder, with_pip=False)
    packages = next((folder / "lib").glob("python*/site-packages"))
    own = next(path for path in sys.path if path.endswith("site-packages") and (Path(path) / "numpy").is_dir())
    (packages / "beside.pth").write_text(own)
    for file, text in modules.items():
        path = packages / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    (project / "envs").mkdir(exist_ok=True)
    (project / "envs" / f"{name}.lock").write_text("stand-ins\n")
    return packages
