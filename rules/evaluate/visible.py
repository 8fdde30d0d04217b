"""evaluate.visible: true objects of a photograph that are expected to be found."""

from __future__ import annotations

from dextera_build.artifacts.scenes.scene import Truth
from dextera_build.artifacts.table import Column, Table
from dextera_build.rule import Context, Fraction, Options, rule

from .rendered_objects import counted, true_objects

COLUMNS = (Column(name="Object"), Column(name="Visible", digits=2))


class VisibleOptions(Options):
    """Options of evaluate.visible."""

    least_visible: Fraction = 0.25
    """Minimum visible fraction of the outline of a true object; see `evaluate.objects`."""
    whole: bool = True
    """Whether objects cut by the picture's border are left out; see `evaluate.objects`."""


@rule(version=1, packages=("numpy", "open3d"))
def visible(ctx: Context, truth: Truth, *, options: VisibleOptions | None = None) -> Table:
    """Return the true objects that are expected to be found, with their visible fractions, independent of any twin."""
    options = options or VisibleOptions()
    known = true_objects(truth)
    rows = tuple(counted(known, truth.camera, options.least_visible, whole=options.whole).items())
    ctx.say(f"{len(rows)} of {len(known)} true objects count")
    return Table(
        title="True objects that count",
        columns=COLUMNS,
        rows=rows,
        notes=(
            f"visible: part of the outline that is in the picture and not hidden, at least {options.least_visible:g}",
        ),
    )
