"""Why a bundle is not taken: one error, and nothing of it enters the store but blobs that nothing names."""

from __future__ import annotations

from collections.abc import Mapping

from dextera_build.errors import StoreError

MAGIC = {
    b"\x1f\x8b": "gzip",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"\xfd7zXZ": "xz",
    b"BZh": "bzip2",
    b"PK\x03\x04": "zip",
}


class BundleRefused(StoreError):  # noqa: N818 - says what happened, as `MissingBlob` does
    """A bundle is damaged, ill-formed, too large, or not trusted."""

    def __init__(
        self, message: str, *, code: str, facts: Mapping[str, object] | None = None, hint: str | None = None
    ) -> None:
        # A message may quote what the bundle says, and that shall not speak to the terminal.
        super().__init__("".join(c if c.isprintable() else "?" for c in message), code=code, facts=facts, hint=hint)


def not_a_bundle(name: str, why: str, hint: str | None = None) -> BundleRefused:
    """What was named is no bundle at all."""
    return BundleRefused(f"`{name}` is not a bundle: {why}", code="DXB-S301", hint=hint)


def damaged(what: str, digest: str, why: str) -> BundleRefused:
    """Bytes are not those that the bundle names."""
    return BundleRefused(
        f"the bundle is damaged: {what} {why}",
        code="DXB-S302",
        facts={"digest": digest},
        hint="download or copy the bundle again",
    )


def lacking(what: str, digest: str) -> BundleRefused:
    """Bytes that the bundle names are not in it."""
    return BundleRefused(
        f"the bundle lacks {what}",
        code="DXB-S303",
        facts={"digest": digest},
        hint="download or copy the bundle again",
    )


def archive(name: str, why: str) -> BundleRefused:
    """An archive holds what no archive of ours holds: a link, a way out of it, the same name twice."""
    return BundleRefused(f"an archive of the bundle is refused: `{name}` {why}", code="DXB-S304")


def too_large(what: str, size: int, most: int) -> BundleRefused:
    """Something exceeds what dxb reads."""
    return BundleRefused(f"{what} of the bundle is too large", code="DXB-S305", facts={"bytes": size, "most": most})


def ill_formed(what: str, why: str) -> BundleRefused:
    """A document does not have the form that it must have."""
    return BundleRefused(f"{what} of the bundle is refused: {why}", code="DXB-S306")


def wrong_result(node: str, why: str) -> BundleRefused:
    """A result is not that of its node."""
    return BundleRefused(f"the result of `{node}` in the bundle is refused: {why}", code="DXB-S307")
