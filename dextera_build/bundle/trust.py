"""Provenance and signatures of bundles, and whether their signers are trusted."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, TypeAlias

from dextera_build.bundle import oci, provenance
from dextera_build.bundle.errors import BundleRefused
from dextera_build.bundle.importer import Opened
from dextera_build.bundle.sign import Envelope, PublicKey
from dextera_build.errors import listing

State: TypeAlias = Literal["trusted", "unknown", "unsigned"]
_MOST = 64 << 20


@dataclass(frozen=True)
class Voucher:
    """The origin of a bundle."""

    state: State
    """`trusted`: signed by a trusted key. `unknown`: signed by a key that is not trusted here."""
    signers: tuple[str, ...] = ()
    """Names of trusted keys, or ids of the others."""
    statement: dict[str, Any] = field(default_factory=dict)
    """The in-toto statement; a signature covers it only where the state is `trusted`."""

    def __str__(self) -> str:
        """One line."""
        if self.state == "trusted":
            return f"signed by {', '.join(self.signers)}, trusted here"
        return f"signed by {', '.join(self.signers)}, not trusted here" if self.signers else "not signed"


def judge(bundle: Opened, keys: Sequence[PublicKey]) -> Voucher:
    """Read and check the provenance of a bundle.

    Raises:
        BundleRefused: A signature is wrong, or about another bundle.
    """
    layer = bundle.manifest.provenance
    if layer is None:
        return Voucher("unsigned")
    content = bundle.source.whole(layer, "the provenance", _MOST)
    if layer.media_type == oci.IN_TOTO:
        return Voucher("unsigned", (), _statement(bundle, content))
    envelope = Envelope.read(content)
    signers = _signers(envelope, keys)
    statement = _statement(bundle, envelope.payload)
    if signers:
        return Voucher("trusted", tuple(signers), statement)
    return Voucher("unknown", tuple(name for name, _ in envelope.signatures), statement)


def require(bundle: Opened, voucher: Voucher, keys: Sequence[PublicKey]) -> None:
    """Refuse a bundle that no trusted key signed.

    Raises:
        BundleRefused: None did.
    """
    if voucher.state == "trusted":
        return
    if voucher.state == "unsigned":
        message = f"`{bundle.source.name}` is not signed"
        hint = "its maker signs it: `dxb bundle create RECIPE -o FILE.tar --sign KEY`"
    else:
        message = f"`{bundle.source.name}` is signed by a key that is not trusted here"
        folder = f"{os.environ.get('XDG_CONFIG_HOME', '~/.config')}/dxb/trusted_keys"
        hint = f"if you trust the signer: `mkdir -p {folder} && cp SIGNER.pub {folder}/`"
    raise BundleRefused(
        message,
        code="DXB-S309",
        facts={
            "signed by": listing(voucher.signers),
            "trusted": listing(f"{key.name} ({key.id})" for key in keys),
        },
        hint=hint,
    )


def _signers(envelope: Envelope, keys: Sequence[PublicKey]) -> list[str]:
    """Trusted keys that signed; a wrong signature in the name of a trusted key is an error."""
    names = []
    for identity, signature in envelope.signatures:
        for key in keys:
            if key.verifies(signature, envelope.signed):
                names.append(f"{key.name} ({key.id})")
            elif key.id == identity:
                raise BundleRefused(
                    f"the bundle says that `{key.name}` signed it, but the signature is wrong",
                    code="DXB-S310",
                    facts={"key": key.id},
                    hint="download or copy the bundle again",
                )
    return names


def _statement(bundle: Opened, payload: bytes) -> dict[str, Any]:
    subject, statement = provenance.subject_of(payload)
    if subject != bundle.digest:
        raise BundleRefused(
            "the provenance is that of another bundle",
            code="DXB-S311",
            facts={"about": f"sha256:{subject}", "bundle": f"sha256:{bundle.digest}"},
            hint="download or copy the bundle again",
        )
    return statement
