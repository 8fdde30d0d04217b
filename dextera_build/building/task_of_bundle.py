"""The task in a bundle, for programs that have no project: a file, or one that skopeo copies from a registry.

The results go into a store that is deleted again, with every check of an import. Signatures are not judged.
"""

from __future__ import annotations

import json
import re
import subprocess
import tempfile
from pathlib import Path

from dextera_build.artifacts.core.identity import identity, parse
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.bundle import importer, layout
from dextera_build.errors import MachineError, UsageError, listing
from dextera_build.store.store import Store

_REGISTRY = re.compile(r"(docker://|oci:|oci-archive:)")
"""Transports of skopeo that a reference may have."""


def is_reference(text: str) -> bool:
    """Whether a text names a bundle in a registry or a layout, as skopeo does: `docker://ghcr.io/lab/mug:v1`."""
    return _REGISTRY.match(text) is not None


def read(bundle: str | Path) -> TaskBundle:
    """The task in a bundle.

    Args:
        bundle: A file of `dxb bundle create`, or a reference.

    Raises:
        BundleRefused: Something in the bundle is wrong.
        MachineError: skopeo is missing, or could not copy the bundle.
        UsageError: Its targets are not exactly one task.
    """
    with tempfile.TemporaryDirectory(prefix="dxb-") as name:
        scratch = Path(name)
        path = _copied(str(bundle), scratch / "bundle.tar") if is_reference(str(bundle)) else Path(bundle)
        opened = importer.open_bundle(layout.Layout(path))
        store = Store(scratch / "store")
        importer.take(opened, store)
        outputs = {address: node.output for address, node in opened.contents.nodes() if node.output is not None}
        targets = {target: outputs[target] for target in opened.contents.targets()}
        tasks = [target for target, output in targets.items() if _type(store.blobs.get(output)) == identity(TaskBundle)]
        if len(tasks) != 1:
            raise UsageError(
                f"the bundle `{bundle}` has {len(tasks)} tasks among its targets",
                code="DXB-U153",
                facts={"targets": listing(targets)},
                hint="make it of one task: `dxb bundle create task/close_laptop:task -o FILE.tar`",
            )
        return TaskBundle.decode(targets[tasks[0]], store.blobs.get)


def _copied(reference: str, path: Path) -> Path:
    command = ["skopeo", "copy", "--quiet", reference, f"oci-archive:{path}:bundle"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        raise MachineError(
            f"`{reference}` cannot be copied: skopeo is not installed",
            code="DXB-E308",
            hint="apt-get install skopeo",
        ) from None
    if done.returncode:
        said = (done.stderr.strip().splitlines() or ["nothing"])[-1]
        raise MachineError(
            f"`{reference}` cannot be copied",
            code="DXB-E309",
            facts={"skopeo": said},
            hint=f"skopeo copy {reference} oci-archive:bundle.tar",
        )
    return path


def _type(header: bytes) -> str:
    return parse(json.loads(header)["artifact"])[0]
