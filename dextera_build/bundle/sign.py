"""ed25519 keys, signatures of bundles, and whether a signer is trusted.

Private keys are files written by `ssh-keygen` or `openssl` (OpenSSH or PKCS 8), public keys are lines
`ssh-ed25519 AAAA... name`.
"""

from __future__ import annotations

import base64
import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from dextera_build import digest as digests
from dextera_build.bundle import documents
from dextera_build.bundle.documents import TEXT
from dextera_build.bundle.errors import BundleRefused, ill_formed
from dextera_build.errors import MachineError, UsageError, install_extra, listing
from dextera_build.store import files

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    from dextera_build.bundle.importer import Opened

_WHAT = "the signature"
_MOST_KEY = 1 << 16
PASSPHRASE = "DXB_KEY_PASSPHRASE"


@dataclass(frozen=True)
class PublicKey:
    """A public key."""

    id: str
    """`SHA256:...`, as `ssh-keygen -l` prints it."""
    name: str
    """The owner, from the file."""
    raw: bytes
    """Its 32 bytes."""
    line: bytes
    """As OpenSSH writes it, without the name."""

    def verifies(self, signature: bytes, message: bytes) -> bool:
        """Whether this key signed `message`."""
        from cryptography.exceptions import InvalidSignature
        from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

        try:
            Ed25519PublicKey.from_public_bytes(self.raw).verify(signature, message)
        except (InvalidSignature, ValueError):
            return False
        return True


def seal(bundle: str, key: Path) -> tuple[bytes, PublicKey]:
    """Sign a bundle (digest) with the private key in a file; return the signature's document and the public key.

    Raises:
        UsageError: The file holds no ed25519 private key.
        MachineError: The package for keys is not installed.
    """
    private = _private(key)
    public = _public(private.public_key(), key.stem)
    signature = base64.b64encode(private.sign(message(bundle))).decode()
    return digests.canonical({"key": public.id, "signature": signature}), public


def message(bundle: str) -> bytes:
    """The bytes that the signature of a bundle (digest) covers."""
    return f"dxb bundle sha256:{bundle}".encode()


def generate(path: Path, name: str) -> PublicKey:
    """Write a new private key to `path`, readable only by its owner, and the public key to `path.pub`.

    Raises:
        UsageError: One of the files exists.
        StoreError: They cannot be written.
        MachineError: The package for keys is not installed.
    """
    _require()
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    public_path = path.with_name(f"{path.name}.pub")
    for file in (path, public_path):
        if file.exists():
            raise UsageError(f"`{file}` already exists", code="DXB-U143", hint="name another file")
    private = Ed25519PrivateKey.generate()
    public = _public(private.public_key(), name)
    secret = private.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, form.NoEncryption())
    files.write(os.path.abspath(path), secret, 0o600)
    files.write(os.path.abspath(public_path), b"%s %s\n" % (public.line, public.name.encode()), 0o644)
    return public


def trusted(places: Sequence[Path]) -> list[PublicKey]:
    """The public keys in files, and in the files `*.pub` of folders.

    Raises:
        UsageError: A file holds no ed25519 public key.
        MachineError: The package for keys is not installed.
    """
    found: dict[bytes, PublicKey] = {}
    for place in places:
        for file in sorted(place.glob("*.pub")) if place.is_dir() else [place]:
            for key in _read_public(file):
                found.setdefault(key.raw, key)
    return list(found.values())


def _read_public(file: Path) -> list[PublicKey]:
    data = _bytes_of(file)
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives.serialization import load_ssh_public_key

    found = []
    try:
        for line in data.splitlines():
            if line.strip() and not line.startswith(b"#"):
                name = b" ".join(line.split()[2:]).decode(errors="replace")
                found.append(_public(load_ssh_public_key(line), name or file.stem))
    except (ValueError, TypeError, UnsupportedAlgorithm) as error:
        raise _no_key(file, "public", str(error)) from None
    return found


def _private(file: Path) -> Ed25519PrivateKey:
    data = _bytes_of(file)
    from cryptography.exceptions import UnsupportedAlgorithm
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey

    load = form.load_ssh_private_key if b"OPENSSH PRIVATE KEY" in data else form.load_pem_private_key
    words = os.environ.get(PASSPHRASE, "").encode() or None
    try:
        found = load(data, words)
    except TypeError as error:
        hint = f"set `{PASSPHRASE}`" if words is None else f"unset `{PASSPHRASE}`"
        raise UsageError(
            f"the passphrase does not fit `{file}`", code="DXB-U144", facts={"reason": error}, hint=hint
        ) from None
    except (ValueError, UnsupportedAlgorithm) as error:
        raise _no_key(file, "private", str(error)) from None
    if not isinstance(found, Ed25519PrivateKey):
        raise _no_key(file, "private", "it is of another kind")
    return found


def _public(key: object, name: str) -> PublicKey:
    from cryptography.hazmat.primitives import serialization as form
    from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PublicKey

    if not isinstance(key, Ed25519PublicKey):
        raise ValueError("it is of another kind than ed25519")
    raw = key.public_bytes(form.Encoding.Raw, form.PublicFormat.Raw)
    line = key.public_bytes(form.Encoding.OpenSSH, form.PublicFormat.OpenSSH)
    fingerprint = base64.b64encode(hashlib.sha256(base64.b64decode(line.split()[1])).digest()).decode().rstrip("=")
    return PublicKey(f"SHA256:{fingerprint}", "".join(c for c in name if c.isprintable())[:200], raw, line)


def _bytes_of(file: Path) -> bytes:
    _require()
    try:
        with file.open("rb") as opened:
            return opened.read(_MOST_KEY)
    except OSError as error:
        raise _no_key(file, "usable", str(error.strerror)) from None


def _no_key(file: Path, kind: str, why: str) -> UsageError:
    return UsageError(
        f"`{file}` holds no {kind} ed25519 key",
        code="DXB-U144",
        facts={"reason": why.splitlines()[0] if why else "-"},
        hint="`dxb bundle keygen FILE` makes a pair of keys",
    )


def _require() -> None:
    try:
        import cryptography  # noqa: F401 - imported here to raise the error before any work
    except ImportError:
        raise MachineError(
            "keys and signatures need the package `cryptography`",
            code="DXB-E340",
            hint=install_extra("share"),
        ) from None


@dataclass(frozen=True)
class Voucher:
    """The origin of a bundle."""

    state: Literal["trusted", "unknown", "unsigned"]
    """`trusted`: signed by a trusted key. `unknown`: signed by a key that is not trusted here."""
    signer: str = ""
    """Name and id of a trusted key, or the id of an unknown one."""

    def __str__(self) -> str:
        """One line."""
        if self.state == "unsigned":
            return "not signed"
        return f"signed by {self.signer}, {'' if self.state == 'trusted' else 'not '}trusted here"


def judge(bundle: Opened, keys: Sequence[PublicKey]) -> Voucher:
    """Read and check the signature of a bundle.

    Raises:
        BundleRefused: It is malformed, or claims a trusted key and is wrong.
    """
    layer = bundle.manifest.signature
    if layer is None:
        return Voucher("unsigned")
    signer, signature = read_signature(bundle.source.whole(layer, _WHAT, _MOST_KEY))
    for key in keys:
        if key.verifies(signature, message(bundle.digest)):
            return Voucher("trusted", f"{key.name} ({key.id})")
        if key.id == signer:
            raise BundleRefused(
                f"the bundle claims to be signed by `{key.name}`, but the signature is wrong",
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
        BundleRefused: No trusted key signed it.
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
