"""capture.track: read the poses of an object over time from a CSV file."""

from __future__ import annotations

from dextera_build.artifacts.base import File
from dextera_build.artifacts.track import Track
from dextera_build.rule import Context, Options, rule


class TrackOptions(Options):
    """capture.track has no options."""


@rule(version=1, packages=("numpy",))
def track(ctx: Context, file: File, *, options: TrackOptions) -> Track:
    """Return the track in a CSV file with columns parent, child, stamp, x, y, z, qw, qx, qy, qz and status."""
    found = Track.parse(file.data, "track.csv")
    ctx.metric("found", found.status.count("tracked") / len(found.status), "fraction")
    ctx.say(", ".join(found.facts()))
    return found
