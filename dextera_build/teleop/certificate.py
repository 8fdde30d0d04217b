"""The certificate of a session: the user's, or one that this machine signs for itself."""

from __future__ import annotations

import datetime
import ipaddress
import ssl
from pathlib import Path
from typing import Any

from dextera_build.errors import MachineError, UsageError, install_extra
from dextera_build.store import files

VALID_DAYS = 365


def own(folder: Path, host: str) -> tuple[Path, Path]:
    """Files of a certificate and its key for an address; made once, so that a headset asks about it once.

    Args:
        folder: Where they are kept.
        host: Name or address that the page is opened with.

    Raises:
        MachineError: cryptography is not installed.
    """
    name = "".join(letter if letter.isalnum() else "_" for letter in host)
    paths = folder / f"{name}.crt", folder / f"{name}.key"
    if not all(path.is_file() for path in paths) or _expires(paths[0]):
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        made = _made(host)
        for path, data in zip(paths, made, strict=True):
            files.write(str(path), data, 0o600)
    return paths


def context(certificate: Path, key: Path) -> ssl.SSLContext:
    """What a server needs to speak HTTPS.

    Raises:
        UsageError: The files hold no certificate and its key.
    """
    made = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    try:
        made.load_cert_chain(certificate, key)
    except (OSError, ssl.SSLError) as error:
        raise UsageError(
            f"`{certificate}` and `{key}` are no certificate and its key",
            code="DXB-U331",
            facts={"system": getattr(error, "strerror", None) or str(error)},
            hint="both are PEM files, and the key has no password",
        ) from None
    return made


def fingerprint(certificate: Path) -> str:
    """SHA-256 of a certificate as browsers show it: `AB:CD:...`."""
    import hashlib

    found = hashlib.sha256(ssl.PEM_cert_to_DER_cert(_first(certificate.read_text()))).hexdigest().upper()
    return ":".join(found[place : place + 2] for place in range(0, len(found), 2))


def _first(text: str) -> str:
    end = "-----END CERTIFICATE-----"
    return text[text.index("-----BEGIN CERTIFICATE-----") : text.index(end) + len(end)]


def _expires(path: Path) -> bool:
    x509 = _cryptography()[0]
    ends = x509.load_pem_x509_certificate(path.read_bytes()).not_valid_after_utc
    return bool(ends < datetime.datetime.now(datetime.UTC) + datetime.timedelta(days=1))


def _made(host: str) -> tuple[bytes, bytes]:
    """Certificate and key of an address, as PEM."""
    x509, hashes, serialization, ec = _cryptography()
    key, now = ec.generate_private_key(ec.SECP256R1()), datetime.datetime.now(datetime.UTC)
    try:
        name = x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        name = x509.DNSName(host)
    title = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "dxb teleop")])
    made = (
        x509.CertificateBuilder()
        .subject_name(title)
        .issuer_name(title)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))
        .not_valid_after(now + datetime.timedelta(days=VALID_DAYS))
        .add_extension(x509.SubjectAlternativeName([name]), critical=False)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .sign(key, hashes.SHA256())
    )
    form = serialization.PrivateFormat.PKCS8
    secret = key.private_bytes(serialization.Encoding.PEM, form, serialization.NoEncryption())
    return made.public_bytes(serialization.Encoding.PEM), secret


def _cryptography() -> tuple[Any, Any, Any, Any]:
    """Modules of cryptography: x509, hashes, serialization, ec.

    Raises:
        MachineError: It is not installed.
    """
    try:
        from cryptography import x509
        from cryptography.hazmat.primitives import hashes, serialization
        from cryptography.hazmat.primitives.asymmetric import ec
    except ImportError:
        raise MachineError(
            "a certificate for HTTPS needs cryptography, which is not installed",
            code="DXB-E325",
            hint=f"{install_extra('teleop')}, or bring your own by `--cert FILE --key FILE`",
        ) from None
    return x509, hashes, serialization, ec
