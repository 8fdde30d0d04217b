"""Environment variables that dxb reads, and warnings about unknown variables with its prefix."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from dextera_build.errors import did_you_mean
from dextera_build.session import warnings

if TYPE_CHECKING:
    from dextera_build.project.project import Project

PREFIX = "DXB_"
SETTINGS = {
    "DXB_CACHE": "the store's folder, or which stores to use",
    "DXB_MODELS": "folders with the weights of models; new ones go into the first",
    "DXB_REMOTES": "which stores to use, where `DXB_CACHE` is the folder",
    "DXB_PROFILE": "stub, cpu, picture, gpu or cloud",
    "DXB_JOBS": "number of cores to use",
    "DXB_RESOURCES": "resources of this machine",
    "DXB_EXECUTOR": "where nodes run",
    "DXB_CONSOLE": "live, plain, jsonl or none",
    "DXB_CALLS": "how calls of services are treated",
    "DXB_MAX_COST": "the most that the calls of one command may cost",
    "DXB_DURABLE": "whether the end of a build waits for the disk",
    "DXB_TRUSTED_KEYS": "a file or folder with the public keys of trusted signers",
    "DXB_REQUIRE_SIGNED": "whether unsigned results from elsewhere are refused",
}
"""Variables that override a setting of `dxb.toml`; `dxb show --config` lists those in force."""
OTHERS = {
    "DXB_ACCEPT_LICENCES": "models whose licences are accepted, separated by commas",
    "DXB_CONSENT": "data that may be sent to services: SERVICE:KIND,... or all",
    "DXB_KEY_PASSPHRASE": "opens the private key that `--sign` names",
    "DXB_SERVE_SECRET": "the password of the user `dxb` for `dxb cache serve`",
    "DXB_CALL_TERMS": "limits, prices and costs of services, passed to worker processes",
    "DXB_LEDGER": "the account of costs that several processes share",
    "DXB_NODE_STORE": "the store's folder of a Ray worker",
    "DXB_HUNYUAN_URL": "address of the service of backend `hunyuan3d_cloud`, if another",
    "DXB_HUNYUAN_REGION": "region of Tencent Cloud for backend `hunyuan3d_cloud`",
    "DXB_OUTSIDE": "set by dxb: by it all processes of an outside program are known",
    "DXB_VLM_URL": "address of the service of backend `vlm`",
    "DXB_VLM_API_KEY": "API key of backend `vlm`",
    "DXB_ROS_PYTHON": "a Python with rclpy, for `--transport rclpy`",
    "DXB_BUNDLES": "folders of task bundles that `import dextera_build.envs` registers for Gymnasium",
    "DXB_FAILPOINT": "for tests: the step at which a process stops",
}


def warn(project: Project) -> None:
    """Warn of unknown `DXB_*` variables, with the nearest known name."""
    addresses = [spec.address for spec in project.remotes.known.values()] if project.config else []
    for name in strangers(os.environ, addresses):
        warnings[f"nothing reads the variable `{name}`; {meant(name)}"] = None


def strangers(environment: Mapping[str, str], addresses: Iterable[str]) -> list[str]:
    """Unknown variables with dxb's prefix; those named in the address of a remote are the user's."""
    known = {*SETTINGS, *OTHERS, *(name for address in addresses for name in re.findall(r"\$\{(\w+)\}", address))}
    return sorted(name for name in environment if name.startswith(PREFIX) and name not in known)


def meant(name: str) -> str:
    """A hint with the nearest variable of a setting."""
    return did_you_mean(name, SETTINGS) or "`dxb show --config` names every setting"
