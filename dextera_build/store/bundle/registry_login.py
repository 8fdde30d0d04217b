"""Logging in at a registry: what Docker remembers of it, and the tokens that it gives for that."""

from __future__ import annotations

import base64
import json
import os
import re
import subprocess
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from dextera_build.errors import MachineError

if TYPE_CHECKING:
    import httpx

_PART = re.compile(r'(\w+)="([^"]*)"')
_HUB = "https://index.docker.io/v1/"
_HUB_HOSTS = ("docker.io", "registry-1.docker.io", "index.docker.io")
_HELPER_S = 30.0


class Login:
    """Answers the challenges of one registry.

    Args:
        http: Takes tokens from where the registry says that they are given out.
        host: The registry.
    """

    def __init__(self, http: httpx.Client, host: str) -> None:
        self._http = http
        self._host = host

    def answer(self, challenge: str, scope: str) -> str:
        """The `Authorization` header that a `WWW-Authenticate` header asks for.

        Raises:
            MachineError: There is no way in.
        """
        kind, _, rest = challenge.partition(" ")
        known = credentials(self._host)
        if kind.lower() == "basic" and known:
            return _basic(*known)
        if kind.lower() != "bearer":
            raise self._refused("it asks for a name and a password" if kind else "it does not say how to log in")
        parts = dict(_PART.findall(rest))
        realm = parts.get("realm", "")
        address = urlsplit(realm)
        if address.scheme != "https" and address.hostname not in ("localhost", "127.0.0.1", "::1"):
            raise self._refused("it gives tokens over a connection that others can read")
        question = {"service": parts.get("service", ""), "scope": parts.get("scope", scope)}
        headers = {"Authorization": _basic(*known)} if known else {}
        answer = self._http.get(realm, params=question, headers=headers)
        with suppress(ValueError, TypeError, AttributeError):
            given = answer.json()
            token = given.get("token") or given.get("access_token")
            if answer.status_code == 200 and isinstance(token, str) and token.isprintable():
                return f"Bearer {token}"
        raise self._refused(f"it gave no token (status {answer.status_code})")

    def _refused(self, why: str) -> MachineError:
        return MachineError(
            f"`{self._host}` does not let you in",
            code="DXB-E343",
            facts={"reason": why, "logins": str(_config_file())},
            hint=f"docker login {self._host}",
        )


def credentials(host: str) -> tuple[str, str] | None:
    """Name and password for a registry, as `docker login` left them, or None."""
    config: Any = {}
    with suppress(OSError, ValueError):
        config = json.loads(_config_file().read_bytes())
    if not isinstance(config, dict):
        return None
    names = [_HUB, *_HUB_HOSTS] if host in _HUB_HOSTS else [host, f"https://{host}"]
    helpers, entries = config.get("credHelpers"), config.get("auths")
    for name in names:
        entry = entries.get(name) if isinstance(entries, dict) else None
        if isinstance(entry, dict) and isinstance(entry.get("auth"), str) and entry["auth"]:
            with suppress(ValueError):
                user, _, password = base64.b64decode(entry["auth"]).decode().partition(":")
                return user, password
    for name in names:
        helper = (helpers.get(name) if isinstance(helpers, dict) else None) or config.get("credsStore")
        found = _helped(str(helper), name) if helper else None
        if found:
            return found
    return None


def _helped(helper: str, name: str) -> tuple[str, str] | None:
    """What a credential helper of Docker says (`docker-credential-NAME get`)."""
    if not re.fullmatch(r"[A-Za-z0-9_.-]+", helper):
        return None
    with suppress(OSError, ValueError, KeyError, TypeError, subprocess.SubprocessError):
        command = [f"docker-credential-{helper}", "get"]
        done = subprocess.run(command, input=name.encode(), capture_output=True, timeout=_HELPER_S, check=True)
        said = json.loads(done.stdout)
        return str(said["Username"]), str(said["Secret"])
    return None


def _config_file() -> Path:
    return Path(os.environ.get("DOCKER_CONFIG") or Path.home() / ".docker") / "config.json"


def _basic(name: str, password: str) -> str:
    return "Basic " + base64.b64encode(f"{name}:{password}".encode()).decode()
