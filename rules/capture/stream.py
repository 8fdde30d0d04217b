"""capture.stream: open a recording of a robot and its cameras."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.stream import Stream
from dextera_build.rule import Context, Options, rule


class StreamOptions(Options):
    """Options of capture.stream."""

    topics: tuple[str, ...] = ()
    """Topics that the recording must contain."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "numpy"))
def stream(ctx: Context, file: File, *, options: StreamOptions) -> Stream:
    """Return the recording in an MCAP file with its index; messages stay in the file."""
    found = Stream.of(file)
    known = {each.topic for each in found.channels if each.count}
    missing = [topic for topic in options.topics if topic not in known]
    if missing:
        ctx.fail(
            f"topic `{missing[0]}` was not recorded",
            topics=", ".join(sorted(known)) or "none",
            hint="record it, or leave it out of option `topics`",
        )
    ctx.metric("duration", found.duration_s(), "s")
    ctx.say(", ".join(found.facts()))
    return found
