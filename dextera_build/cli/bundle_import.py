"""`dxb bundle import`, `pull` and `keygen`: from a bundle to a store that can be worked with."""

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

from dextera_build.cli import options
from dextera_build.errors import UsageError, listing
from dextera_build.report.wording import count
from dextera_build.store.bundle import layout, oci, receive, signing, trust

if TYPE_CHECKING:
    from dextera_build.project import Project
    from dextera_build.store.bundle.contents import Build
    from dextera_build.store.bundle.receive import Opened
    from dextera_build.store.store import Store


def source_of(text: str) -> oci.Source:
    """The bundle that an argument names.

    Raises:
        UsageError: There is no such file or folder.
        BundleRefused: It is no bundle.
    """
    if text.startswith("oci://"):
        from dextera_build.store.bundle import registry

        return registry.Repository(registry.parse(text))
    path = Path(text)
    if not path.exists():
        raise UsageError(
            f"there is no file or folder `{text}`", code="DXB-U146", hint="dxb bundle create RECIPE -o FILE.tar"
        )
    return layout.read(path)


def judged(args: argparse.Namespace, project: Project, bundle: Opened) -> trust.Voucher:
    """Who vouches for a bundle.

    Raises:
        BundleRefused: A signature is wrong, or one is required and there is none.
    """
    keys = signing.trusted(project.trusted_keys) if bundle.said or args.require_signed else []
    voucher = trust.judge(bundle, keys)
    if args.require_signed or project.require_signed:
        trust.require(bundle, voucher, keys)
    return voucher


def take(args: argparse.Namespace) -> int:
    """Import; print one line per target: its address, a tab, its output's digest."""
    from dextera_build.store.store import Store

    project = options.project(args)
    bundle = receive.open_bundle(source_of(args.bundle))
    voucher = judged(args, project, bundle)
    store = Store(project.cache)
    taken = receive.take(bundle, store)
    for build in bundle.contents.builds:
        _remember(project, store, build, bundle)
    _say(bundle, voucher, taken)
    outputs = {address: node.output for address, node in bundle.contents.nodes()}
    targets = {name: outputs[name] for name in bundle.contents.targets()}
    if args.json:
        told = {"digest": bundle.descriptor.digest, "signature": voucher.state, "targets": targets, **vars(taken)}
        print(json.dumps(told, indent=1))
    else:
        print("".join(f"{name}\t{output}\n" for name, output in targets.items()), end="")
    return 0


def pull(args: argparse.Namespace) -> int:
    """Copy a bundle from a registry; print its path and digest."""
    if not args.bundle.startswith("oci://"):
        raise UsageError(f"`{args.bundle}` is not of the form `oci://HOST/NAME:TAG`", code="DXB-U147")
    found = layout.write(source_of(args.bundle), Path(args.out))
    print(f"{args.out}\tsha256:{found[0].digest}")
    return 0


def keygen(args: argparse.Namespace) -> int:
    """Make keys; print the path of the public one and the key's id."""
    path = Path(args.file)
    key = signing.generate(path, args.name or f"{getpass.getuser()}@{platform.node()}")
    print(f"{path}.pub\t{key.id}")
    return 0


def _remember(project: Project, store: Store, build: Build, bundle: Opened) -> None:
    """An import is a run whose nodes were fetched, so that every verb finds them."""
    from dextera_build.engine import events
    from dextera_build.engine.eventlog import EventLog
    from dextera_build.engine.history import Entry, History

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


def _say(bundle: Opened, voucher: trust.Voucher, taken: receive.Taken) -> None:
    nodes = [node for _, node in bundle.contents.nodes()]
    bare = f" ({taken.bare} without their bytes)" if taken.bare else ""
    counts = f"{count(len(nodes), 'node')}: {count(taken.new, 'result')} new{bare}, {taken.known} known"
    print(f"{bundle.source.name}   {counts}   {voucher}", file=sys.stderr)
    if taken.other:
        print(
            f"the store keeps its own results where the bundle has others under the same key: {listing(taken.other)}",
            file=sys.stderr,
        )
    if voucher.state != "trusted":
        print(
            "nobody whom you trust vouches for it: its results are worth what its maker is worth to you",
            file=sys.stderr,
        )
