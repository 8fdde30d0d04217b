"""capture.video: open an encoded video."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.video import Video
from dextera_build.rule import Context, Options, rule


class VideoOptions(Options):
    """capture.video has no options."""


@rule(version=1, packages=("av", "numpy"))
def video(ctx: Context, file: File, *, options: VideoOptions) -> Video:
    """Return the video in an MP4, MKV or MOV file with its index; frames stay in the file."""
    found = Video.of(file)
    ctx.metric("duration", float(found.stamps[-1] - found.stamps[0]), "s")
    ctx.say(", ".join(found.facts()))
    return found
