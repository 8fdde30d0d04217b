"""Whether the signer of a bundle is trusted."""

from __future__ import annotations

import base64
import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

from dextera_build.bundle import documents
from dextera_build.bundle.documents import TEXT
from dextera_build.bundle.errors import BundleRefused, ill_formed
from dextera_build.bundle.importer import Opened
from dextera_build.bundle.sign import PublicKey, message
from dextera_build.errors import listing

State: TypeAlias = Literal["trusted", "unknown", "unsigned"]
_MOST = 1 << 16
_WHAT = "the signature"


@dataclass(frozen=True)
class Voucher:
    """The origin of a bundle."""

    state: State
    """`trusted`: signed by a trusted key. `unknown`: signed by a key that is not trusted here."""
    signer: str = ""
    """Name and id of a trusted key, or the id of another."""

    def __str__(self) -> str:
        """One line."""
        if self.state == "unsigned":
            return "not signed"
        return f"signed by {self.signer}, {'' if self.state == 'trusted' else 'not '}trusted here"


def judge(bundle: Opened, keys: Sequence[PublicKey]) -> Voucher:
    """Read and check the signature of a bundle.

    Raises:
        BundleRefused: It is malformed, or wrong in the name of a trusted key.
    """
    layer = bundle.manifest.signature
    if layer is None:
        return Voucher("unsigned")
    signer, signature = read_signature(bundle.source.whole(layer, _WHAT, _MOST))
    for key in keys:
        if key.verifies(signature, message(bundle.digest)):
            return Voucher("trusted", f"{key.name} ({key.id})")
        if key.id == signer:
            raise BundleRefused(
                f"the bundle says that `{key.name}` signed it, but the signature is wrong",
                code="DXB-S310",
                facts={"key": key.id},
                hint="download or copy the bundle again",
            )
    return Voucher("unknown", signer)


def read_signature(data: bytes) -> tuple[str, bytes]:
    """(id of the key, signature) of an untrusted document.

    Raises:
        BundleRefused: It is malformed.
    """
    found = documents.parse(data, {"key": TEXT, "signature": TEXT}, _WHAT)
    try:
        return found["key"], base64.b64decode(found["signature"], validate=True)
    except ValueError:
        raise ill_formed(_WHAT, "it is not base64") from None


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
            "signed by": voucher.signer or "-",
            "trusted": listing(f"{key.name} ({key.id})" for key in keys),
        },
        hint=hint,
    )
