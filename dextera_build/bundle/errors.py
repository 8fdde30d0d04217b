"""Why a bundle is refused. A refused bundle leaves at most unreferenced blobs in the store."""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.errors import StoreError

_AGAIN = "download or copy the bundle again"


class BundleRefused(StoreError):  # noqa: N818 - says what happened, as `MissingBlob` does
    """A bundle is damaged, ill-formed, too large, or not trusted."""

    def __init__(
        self, message: str, *, code: str, facts: Mapping[str, object] | None = None, hint: str | None = None
    ) -> None:
        # Messages quote untrusted text, which must not control the terminal.
        super().__init__("".join(c if c.isprintable() else "?" for c in message), code=code, facts=facts, hint=hint)


def not_a_bundle(name: str, why: str, hint: str | None = None) -> BundleRefused:
    """The file or folder is not a bundle."""
    return BundleRefused(f"`{name}` is not a bundle: {why}", code="DXB-S301", hint=hint)


def damaged(what: str, digest: str, why: str) -> BundleRefused:
    """A digest or size does not match."""
    facts = {"digest": digest}
    return BundleRefused(f"the bundle is damaged: {what} {why}", code="DXB-S302", facts=facts, hint=_AGAIN)


def lacking(what: str, digest: str) -> BundleRefused:
    """A blob that the bundle names is missing."""
    return BundleRefused(f"the bundle lacks {what}", code="DXB-S303", facts={"digest": digest}, hint=_AGAIN)


def archive(name: str, why: str) -> BundleRefused:
    """An archive holds something that dxb never writes: a link, a path that leads out, a duplicate name."""
    return BundleRefused(f"an archive of the bundle is refused: `{name[:200]}` {why}", code="DXB-S304")


def too_large(what: str, size: int, most: int) -> BundleRefused:
    """A limit of dxb is exceeded."""
    return BundleRefused(f"{what} of the bundle is too large", code="DXB-S305", facts={"size": size, "most": most})


def ill_formed(what: str, why: str) -> BundleRefused:
    """A document is malformed."""
    return BundleRefused(f"{what} of the bundle is refused: {why}", code="DXB-S306")


def wrong_result(node: str, why: str) -> BundleRefused:
    """A result belongs to another node."""
    return BundleRefused(f"the result of `{node}` in the bundle is refused: {why}", code="DXB-S307")
