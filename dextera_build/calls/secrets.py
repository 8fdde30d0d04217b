"""Secrets such as API keys: from the environment or the keyring of the system, never from files of a project."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator

from dextera_build.errors import MachineError, Place, RecipeError
from dextera_build.redact import SHORTEST, hidden, hide, hide_address, spellings

KEYRING = "dxb"
"""Name of the service in the keyring; the name of the secret is the user name there."""
NAMES = re.compile(r"KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIAL", re.IGNORECASE)
"""Variables with such a name hold secrets."""
_FORMS = re.compile(
    r"(?<![A-Za-z0-9_-])(?:sk-(?=[A-Za-z_-]*[0-9])[A-Za-z0-9_-]{20,}|AKID[A-Za-z0-9]{16,}|AKIA[A-Z0-9]{16}|AIza[A-Za-z0-9_-]{35}|gh[pousr]_[A-Za-z0-9]{36,}"
    r"|hf_[A-Za-z0-9]{30,}|xox[abprs]-[A-Za-z0-9-]{10,})|-----BEGIN [A-Z ]*PRIVATE KEY-----"
)
"""Keys of OpenAI, Tencent Cloud, AWS, Google, GitHub, Hugging Face and Slack, and private keys in PEM."""
_BEGINS = ("sk-", "AKI", "AIza", "ghp_", "gho_", "ghu_", "ghs_", "ghr_", "hf_", "xox", "PRIVATE KEY")
"""Each key contains one of these; looking for them is faster than the pattern."""
_PUBLIC = re.compile(r"PUBLIC|TRUSTED", re.IGNORECASE)
"""Keys in variables with such a name are no secrets: `DXB_TRUSTED_KEYS`."""
_OWN = "DXB_"
REMOTES = "DXB_REMOTES"
"""Variable whose addresses may hold passwords."""
_NEEDLESS = ("DXB_KEY_PASSPHRASE", "DXB_SERVE_SECRET")
"""Secrets that no worker needs."""
_withheld: dict[str, str] = {}
"""Variables that `withhold` took out of the environment."""
_PATHS = ("/", "./", "../", "~")
_LEAST_WRITTEN = 12
"""Shorter values of variables may occur in a file by chance [characters]."""


def get(name: str) -> str:
    """The secret called `name`: the variable of that name, or else its entry in the keyring.

    Raises:
        MachineError: There is none.
    """
    value = variable(name) or _from_keyring(name)
    if not value:
        raise MachineError(
            f"there is no secret `{name}`",
            code="DXB-E366",
            facts={"looked in": "the environment, the keyring"},
            hint=f"export {name}=..., or `keyring set {KEYRING} {name}`",
        )
    hide(name, value)
    return value


def variable(name: str) -> str | None:
    """The value of an environment variable, also of one that `withhold` took out."""
    return os.environ.get(name, _withheld.get(name))


def hide_own() -> None:
    """Hide the secrets in dxb's own variables, and the passwords of the addresses there."""
    for name, value in os.environ.items():
        if _is_own(name):
            hide(name, value)
        if name.startswith(_OWN):
            hide_address(value)


def withhold() -> None:
    """Take dxb's own secrets out of the environment: rules, and programs that they start, could pass it on."""
    for name in [name for name in os.environ if _is_own(name) or name == REMOTES]:
        _withheld[name] = os.environ.pop(name)


def for_workers() -> dict[str, str]:
    """The environment of this process without the secrets that no worker needs."""
    return {name: value for name, value in os.environ.items() if name not in _NEEDLESS}


def secret_in(data: bytes, secrets: Iterable[str] = ()) -> str | None:
    """A name for the secret that `data` contains, or None."""
    for name, value in _known(secrets):
        if value.encode(errors="surrogateescape") in data:
            return name
    return None


def without_secrets(text: str, secrets: Iterable[str] = ()) -> str:
    """`text` with every known secret replaced by `***`."""
    for _, value in _known(secrets):
        text = text.replace(value, "***")
    return text


def refuse_written(text: str, file: str) -> None:
    """Refuse a file of a project that holds a secret, because such files are shared.

    Args:
        text: Its content.
        file: Its name in messages.

    Raises:
        RecipeError: It holds the value of a variable such as `SERVICE_API_KEY`, or something of the form of a key.
    """
    forms = _FORMS.search(text) if any(begin in text for begin in _BEGINS) else None
    found = [(f"the value of `{name}`", value) for name, value in _of_variables() if value in text]
    found += [("what looks like a secret key", forms.group())] if forms else []
    for what, value in found[:1]:
        hide("of a file", value)  # messages quote the line
        before = text[: text.index(value)]
        raise RecipeError(
            f"`{file}` holds {what}",
            code="DXB-R406",
            where=Place(file, before.count("\n") + 1, len(before) - before.rfind("\n")),
            hint=f"remove it, and have it replaced if others have seen it; a rule takes `ctx.secret(NAME)` from the "
            f"environment or from `keyring set {KEYRING} NAME`",
        )


def _is_own(name: str) -> bool:
    """Whether a variable of dxb holds a secret."""
    return name.startswith(_OWN) and NAMES.search(name) is not None and not _PUBLIC.search(name)


def _of_variables() -> Iterator[tuple[str, str]]:
    """Variables with the name of a secret and a value that is neither a word nor a path."""
    for name, value in os.environ.items():
        is_mixed = re.search(r"\d", value) and re.search(r"[A-Za-z]", value)
        if not (NAMES.search(name) and is_mixed and len(value) >= _LEAST_WRITTEN) or _PUBLIC.search(name):
            continue
        if not value.startswith(_PATHS) and not os.path.exists(value):
            yield name, value


def _known(secrets: Iterable[str]) -> Iterator[tuple[str, str]]:
    """(name, spelling) of everything that counts as a secret, longest first."""
    found = [("a secret", value) for value in secrets]
    variables = {**os.environ, **_withheld}
    found += [(f"the value of `{name}`", value) for name, value in variables.items() if NAMES.search(name)]
    spelled = {text: f"the secret `{name}`" for text, name in hidden().items()}
    spelled |= {text: name for name, value in found if len(value) >= SHORTEST for text in spellings(value)}
    yield from sorted(((name, text) for text, name in spelled.items()), key=lambda row: -len(row[1]))


def _from_keyring(name: str) -> str | None:
    try:
        import keyring
        from keyring.errors import KeyringError
    except ImportError:
        return None
    try:
        found: str | None = keyring.get_password(KEYRING, name)
    except KeyringError:
        return None
    return found
