"""capture.hands_film: a film of an operator's hands."""

from __future__ import annotations

from itertools import chain

from pydantic import Field, PositiveFloat

from dextera_build.artifacts.cameras.video import Video
from dextera_build.artifacts.robots.hand_stream import HandStream
from dextera_build.formats import video
from dextera_build.previews import hands
from dextera_build.rule import Context, Options, rule


class HandsFilmOptions(Options):
    """Options of capture.hands_film."""

    rate_hz: PositiveFloat = 24.0
    """Pictures per second."""
    most_s: PositiveFloat = Field(120.0, le=3600.0)
    """The film ends after this time of the recording [s]."""


@rule(version=1, packages=("numpy", "pillow", "av"))
def hands_film(ctx: Context, stream: HandStream, *, options: HandsFilmOptions | None = None) -> Video:
    """Return a film of the skeletons from behind and from the right, with clutch and tracking along time."""
    options = options or HandsFilmOptions()
    pictures = hands.frames(stream, options.rate_hz, options.most_s)
    first = next(pictures)
    encoder = video.encoder(first.shape[1], first.shape[0], options.rate_hz)
    made = video.write(ctx.scratch / "hands.mp4", chain([first], pictures), encoder)
    ctx.preview(hands.strip(stream), "hands from behind and from the right")
    ctx.say(f"{len(made.stamps):,} pictures of {made.width} x {made.height} px, {stream.device}")
    return made
