"""Check that every link of an asset has the properties that a simulation needs."""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.artifacts.objects.object import Asset
from dextera_build.errors import RuleError, listing


def check(assets: Mapping[str, Asset]) -> None:
    """Raise for links without collision pieces or without mass.

    Args:
        assets: Label -> asset.

    Raises:
        RuleError: A link lacks one of them.
    """
    for label, asset in assets.items():
        pieces = [link for link, found in asset.collision.links.items() if found.hulls]
        for what, known in (("collision geometry", pieces), ("mass", list(asset.physics.links))):
            if bare := sorted(asset.body.links.keys() - set(known)):
                raise RuleError(
                    f"link `{bare[0]}` of `{label}` has no {what}",
                    code="DXB-B219",
                    facts={"links": listing(asset.body.links), what: listing(known) if known else "of no link"},
                    hint="`factorize.collision` and `factorize.physics` of the same body give both",
                )
