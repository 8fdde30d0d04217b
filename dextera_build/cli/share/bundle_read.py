"""`dxb bundle inspect`, `import` and `keygen`."""

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

from dextera_build import digest
from dextera_build.bundle import importer, layout, oci, sign
from dextera_build.cli import options, table
from dextera_build.errors import UsageError, did_you_mean, listing
from dextera_build.report.wording import count

if TYPE_CHECKING:
    from dextera_build.bundle.config import Build
    from dextera_build.bundle.importer import Opened
    from dextera_build.project.project import Project
    from dextera_build.store.store import Store


def _open(args: argparse.Namespace, project: Project) -> tuple[Opened, sign.Voucher]:
    """Open the bundle that the arguments name, and check its signature.

    Raises:
        UsageError: The file does not exist.
        BundleRefused: It is not a bundle, a signature is wrong, or a required signature is missing.
    """
    _, separator, place = args.bundle.partition("://")
    if separator:
        raise UsageError(
            f"`{args.bundle}` is not a file",
            code="DXB-U147",
            facts={"registries": "`skopeo` copies bundles from and to them"},
            hint=f"skopeo copy docker://{place} oci-archive:bundle.tar",
        )
    path = Path(args.bundle)
    if not path.exists():
        raise UsageError(f"there is no file `{path}`", code="DXB-U146", hint="dxb bundle create RECIPE -o FILE.tar")
    bundle = importer.open_bundle(layout.Layout(path))
    required = args.require_signed or project.require_signed
    keys = sign.trusted(project.trusted_keys) if bundle.manifest.signature or required else []
    voucher = sign.judge(bundle, keys)
    if required:
        sign.require(bundle, voucher, keys)
    return bundle, voucher


def take(args: argparse.Namespace) -> int:
    """Import a bundle; print one line per target: its address, a tab, its output's digest."""
    from dextera_build.store.store import Store

    project = options.project(args)
    bundle, voucher = _open(args, project)
    store = Store(project.cache)
    taken = importer.take(bundle, store)
    for build in bundle.contents.builds:
        _remember(project, store, build, bundle)
    _say(bundle, voucher, taken)
    outputs = {address: node.output for address, node in bundle.contents.nodes()}
    targets = {name: outputs[name] for name in bundle.contents.targets()}
    told = {"digest": f"sha256:{bundle.digest}", "signature": voucher.state, "targets": targets, **vars(taken)}
    cells = [{"target": name, "output": output} for name, output in targets.items()]
    return table.give("bundle.import", told, as_json=args.json, cells=cells)


def keygen(args: argparse.Namespace) -> int:
    """Make a pair of keys; print the path of the public one and the key's id."""
    path = Path(args.file)
    with table.writing(path):
        key = sign.generate(path, args.name or f"{getpass.getuser()}@{platform.node()}")
    return table.give("bundle.keygen", {"file": f"{path}.pub", "key": key.id}, as_json=args.json)


def _remember(project: Project, store: Store, build: Build, bundle: Opened) -> None:
    """Record an import as a run that fetched its nodes, which makes it visible to every verb."""
    from dextera_build.project.planning import Added
    from dextera_build.runs import events, workspaces
    from dextera_build.runs.history import Entry, History
    from dextera_build.runs.log import EventLog
    from dextera_build.session import Session, variant_of

    session = Session(project, build.recipe, makes=True)
    variant = variant_of(build.profile if build.profile != project.own_profile else "", Added())
    now, history = time.time(), History(store, build.recipe, session.workspace, variant)
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
                variant=variant,
                workspace=workspaces.mark(session.workspace),
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
                    inputs=dict(json.loads(store.blobs.get(node.key))["inputs"]),
                    depends_on=list(node.depends_on),
                    files=dict(node.files),
                )
            )
        log(events.RunFinished(time.time(), True, time.time() - now, dict(counts), 0.0))
    history.save()
    session.note_built(variant)


def _say(bundle: Opened, voucher: sign.Voucher, taken: importer.Taken) -> None:
    nodes = count(sum(1 for _ in bundle.contents.nodes()), "node")
    bare = f" ({taken.bare} without their bytes)" if taken.bare else ""
    told = [f"{bundle.source.name}   {nodes}: {count(taken.new, 'result')} new{bare}, {taken.known} known   {voucher}"]
    if taken.other:
        told.append(f"the store keeps its own results; the bundle has others under these keys: {listing(taken.other)}")
    if voucher.state != "trusted":
        told.append("warning: not signed by a trusted key")
    print("\n".join(told), file=sys.stderr)


def inspect(args: argparse.Namespace) -> int:
    """Print rows of name and value, the whole bundle as JSON, or one recipe."""
    bundle, voucher = _open(args, options.project(args))
    if args.recipe:
        text = _recipe(bundle, args.recipe)
        if args.json:
            return table.give("bundle.recipe", {"recipe": args.recipe, "yaml": text}, as_json=True)
        print(text, end="")
        return 0
    everything = {
        "digest": f"sha256:{bundle.digest}",
        "bytes": bundle.size,
        "manifest": json.loads(bundle.manifest.spell()),
        "config": json.loads(bundle.contents.spell()),
        "signature": {"state": voucher.state, "signer": voucher.signer or None},
    }
    cells = [{"name": name, "value": str(value)} for name, value in _rows(bundle, voucher)]
    return table.give("bundle.inspect", everything, as_json=args.json, cells=cells)


def _rows(bundle: Opened, voucher: sign.Voucher) -> list[tuple[str, object]]:
    nodes = [node for _, node in bundle.contents.nodes()]
    layers = bundle.manifest.layers
    return [
        ("digest", f"sha256:{bundle.digest}"),
        ("created", bundle.manifest.annotations.get(oci.CREATED, "-")),
        *(("target", name) for name in bundle.contents.targets()),
        ("closure", bundle.contents.closure),
        ("nodes", len(nodes)),
        ("results", len({node.key for node in nodes if node.result})),
        ("with bytes", len({node.key for node in nodes if node.is_whole})),
        ("layers", len(layers)),
        ("bytes", bundle.size),
        *(
            ("recipe", f"{name}\tsha256:{digest.of_bytes(text.encode())}")
            for name, text in bundle.contents.recipes.items()
        ),
        ("made by", f"dxb {bundle.contents.dxb}"),
        ("inputs", len({path for node in nodes for path in node.files.values()})),
        ("signature", str(voucher)),
    ]


def _recipe(bundle: Opened, name: str) -> str:
    known = bundle.contents.recipes
    if name not in known:
        raise UsageError(
            f"there is no recipe `{name}` in the bundle",
            code="DXB-U148",
            facts={"recipes": listing(known)},
            hint=did_you_mean(name, known),
        )
    return known[name]
