"""learn.files: the files of a policy that another project trained."""

from __future__ import annotations

from dextera_build.artifacts.base import Folder
from dextera_build.artifacts.tasks.policy import Checkpoint
from dextera_build.learning import packed
from dextera_build.rule import Context, rule


@rule(version=1, packages=("safetensors",), memory_gb=4.0)
def files(ctx: Context, checkpoint: Checkpoint) -> Folder:
    """Return the files of a policy that another project trained, as that project's own programs read them."""
    if checkpoint.contract.algorithm != "outside":
        ctx.fail(
            f"`{checkpoint.contract.algorithm}` is an algorithm of dxb, whose weights are no files",
            hint="`dxb serve NODE` lets other programs ask it",
        )
    out = ctx.scratch / "files"
    packed.unpack(checkpoint.weights, out)
    made = Folder.of(out)
    ctx.say(f"{len(made.files)} files of {checkpoint.contract.settings['program']}")
    return made
