"""Who we are to a gRPC server, and whom we trust: from the address or the environment, so that no secret is in a file.

`DXB_REMOTE_TOKEN` is a bearer token, `DXB_REMOTE_METADATA` more headers (`name=value,name=value`). PEM files:
`DXB_REMOTE_CA` names the authorities to trust, `DXB_REMOTE_CERT` and `DXB_REMOTE_KEY` our own certificate.
"""

from __future__ import annotations

import base64
import os
import re

from dextera_build.errors import StoreError

_LOCAL = re.compile(r"unix:.*|(localhost|127\.[0-9.]+|\[::1\])(:[0-9]+)?")
_NAME = re.compile(r"[a-z0-9_.-]+")
_FILES = {"certificate_chain": "DXB_REMOTE_CERT", "private_key": "DXB_REMOTE_KEY", "root_certificates": "DXB_REMOTE_CA"}


def metadata(target: str, secret: str, *, tls: bool) -> list[tuple[str, str]]:
    """The headers that every call carries.

    Args:
        target: `host:port`.
        secret: A token or `user:password`; empty takes `DXB_REMOTE_TOKEN`.
        tls: Whether the connection is encrypted.

    Raises:
        StoreError: A secret would be sent in the clear, or a header is malformed.
    """
    secret = secret or os.environ.get("DXB_REMOTE_TOKEN", "").strip()
    more = os.environ.get("DXB_REMOTE_METADATA", "")
    if (secret or more) and not tls and not _LOCAL.fullmatch(target):
        raise StoreError(
            "a secret is not sent over a connection that others can read",
            code="DXB-S220",
            facts={"remote": f"grpc://{target}"},
            hint=f"write `grpcs://{target}`, or unset `DXB_REMOTE_TOKEN` and `DXB_REMOTE_METADATA`",
        )
    found = [_header(part) for part in more.split(",") if part]
    if secret:
        found.append(("authorization", _authorization(secret)))
    return found


def certificates() -> dict[str, bytes]:
    """Arguments of `grpc.ssl_channel_credentials`.

    Raises:
        StoreError: A file cannot be read.
    """
    found = {}
    for part, variable in _FILES.items():
        if path := os.environ.get(variable):
            try:
                with open(path, "rb") as file:
                    found[part] = file.read()
            except OSError as error:
                raise StoreError(
                    f"the file that `{variable}` names cannot be read",
                    code="DXB-S222",
                    facts={"file": path, "system says": error.strerror},
                    hint=f"export {variable}=FILE.pem",
                ) from None
    return found


def _authorization(secret: str) -> str:
    if not secret.isprintable() or not secret.isascii():
        raise StoreError("the token holds what no header may hold", code="DXB-S221", hint="set `DXB_REMOTE_TOKEN` anew")
    if ":" in secret:
        return f"Basic {base64.b64encode(secret.encode()).decode()}"
    return f"Bearer {secret}"


def _header(part: str) -> tuple[str, str]:
    name, sign, value = (piece.strip() for piece in part.partition("="))
    name = name.lower()
    if not sign or not _NAME.fullmatch(name) or name.endswith("-bin") or not (value.isascii() and value.isprintable()):
        raise StoreError(
            "`DXB_REMOTE_METADATA` is not a list of names and values",
            code="DXB-S221",
            facts={"name": repr(name), "names": "lower-case letters, digits, `.`, `-` and `_`"},
            hint="export DXB_REMOTE_METADATA=name=value,name=value",
        )
    return name, value
