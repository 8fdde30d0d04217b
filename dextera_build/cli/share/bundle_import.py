"""`dxb bundle import` and `keygen`: from a bundle to a store that can be worked with."""

from __future__ import annotations

import argparse
import getpass
import json
import platform
import sys
import time
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

from dextera_build.bundle import importer, layout, sign, trust
from dextera_build.cli import options
from dextera_build.errors import UsageError, listing
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.bundle.config import Build
    from dextera_build.bundle.importer import Opened
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store


def source_of(text: str) -> layout.Layout:
    """The bundle that an argument names.

    Raises:
        UsageError: There is no such file.
        BundleRefused: It is no bundle.
    """
    _, separator, place = text.partition("://")
    if separator:
        raise UsageError(
            f"`{text}` is not a file",
            code="DXB-U147",
            facts={"registries": "`skopeo` copies from and to them"},
            hint=f"skopeo copy docker://{place} oci-archive:bundle.tar",
        )
    path = Path(text)
    if not path.exists():
        raise UsageError(f"there is no file `{text}`", code="DXB-U146", hint="dxb bundle create RECIPE -o FILE.tar")
    return layout.Layout(path)


def judged(args: argparse.Namespace, project: Project, bundle: Opened) -> trust.Voucher:
    """Who vouches for a bundle.

    Raises:
        BundleRefused: A signature is wrong, or one is required and there is none.
    """
    required = args.require_signed or project.require_signed
    keys = sign.trusted(project.trusted_keys) if bundle.manifest.signature or required else []
    voucher = trust.judge(bundle, keys)
    if required:
        trust.require(bundle, voucher, keys)
    return voucher


def take(args: argparse.Namespace) -> int:
    """Import; print one line per target: its address, a tab, its output's digest."""
    from dextera_build.store.store import Store

    project = options.project(args)
    bundle = importer.open_bundle(source_of(args.bundle))
    voucher = judged(args, project, bundle)
    store = Store(project.cache)
    taken = importer.take(bundle, store)
    for build in bundle.contents.builds:
        _remember(project, store, build, bundle)
    _say(bundle, voucher, taken)
    outputs = {address: node.output for address, node in bundle.contents.nodes()}
    targets = {name: outputs[name] for name in bundle.contents.targets()}
    if args.json:
        told = {"digest": bundle.digest, "signature": voucher.state, "targets": targets, **vars(taken)}
        print(json.dumps(told, indent=1))
    else:
        print("".join(f"{name}\t{output}\n" for name, output in targets.items()), end="")
    return 0


def keygen(args: argparse.Namespace) -> int:
    """Make keys; print the path of the public one and the key's id."""
    path = Path(args.file)
    key = sign.generate(path, args.name or f"{getpass.getuser()}@{platform.node()}")
    print(f"{path}.pub\t{key.id}")
    return 0


def _remember(project: Project, store: Store, build: Build, bundle: Opened) -> None:
    """An import is a run whose nodes were fetched, so that every verb finds them."""
    from dextera_build.runs import events
    from dextera_build.runs.history import Entry, History
    from dextera_build.runs.log import EventLog

    now, history = time.time(), History(store, build.recipe, str(project.root))
    counts = Counter("fetched" if node.result else "cancelled" for node in build.nodes)
    with EventLog(store) as log:
        log(
            events.RunStarted(
                time=now,
                run=log.run,
                recipe=build.recipe,
                targets=list(build.targets),
                profile=build.profile,
                dxb=bundle.contents.dxb,
                calls=len(build.nodes),
                groups=0,
                argv=["bundle", "import", bundle.source.name],
            )
        )
        for node in build.nodes:
            result = store.actions.known(node.key) if node.result else None
            history.note(node.node, Entry(node.key, node.key, log.run, node.seconds, now))
            log(
                events.NodeFinished(
                    time=now,
                    node=node.node,
                    rule=node.rule,
                    backend=node.backend,
                    status="fetched" if node.result else "cancelled",
                    key=node.key,
                    output=result.output if result else node.output,
                    seconds=node.seconds,
                    line=result.line if result else "its result is not in the bundle",
                    result=result.digest if result else None,
                    log=result.log if result else None,
                    inputs=_inputs(store, node.key),
                    depends_on=list(node.depends_on),
                    files=dict(node.files),
                )
            )
        log(events.RunFinished(time.time(), True, time.time() - now, dict(counts), 0.0))
    history.save()


def _inputs(store: Store, key: str) -> dict[str, str]:
    return dict(json.loads(store.blobs.get(key))["inputs"])


def _say(bundle: Opened, voucher: trust.Voucher, taken: importer.Taken) -> None:
    nodes = [node for _, node in bundle.contents.nodes()]
    bare = f" ({taken.bare} without their bytes)" if taken.bare else ""
    counts = f"{count(len(nodes), 'node')}: {count(taken.new, 'result')} new{bare}, {taken.known} known"
    print(f"{bundle.source.name}   {counts}   {voucher}", file=sys.stderr)
    if taken.other:
        print(
            f"the store keeps its own results; the bundle has others under the same key: {listing(taken.other)}",
            file=sys.stderr,
        )
    if voucher.state != "trusted":
        print(
            "warning: not signed by a trusted key",
            file=sys.stderr,
        )
