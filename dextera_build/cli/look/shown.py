"""Content of `dxb view` for a recipe or a node: the scene, the task, the episodes, or one artifact."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

from dextera_build.artifacts.cameras.camera import Photograph
from dextera_build.artifacts.objects.object import Asset
from dextera_build.artifacts.robots.robot import RobotModel
from dextera_build.artifacts.scenes.scene import Scene
from dextera_build.artifacts.tasks.episode import Episodes
from dextera_build.artifacts.tasks.task import TaskBundle
from dextera_build.artifacts.tasks.trials import Trials
from dextera_build.building import fetch, part
from dextera_build.cli import built
from dextera_build.cli.built import PARTS
from dextera_build.engine.graph import parse_address
from dextera_build.errors import RuleError, UsageError, listing
from dextera_build.explain import ancestors
from dextera_build.policy.robot_run import REAL
from dextera_build.project.planning import inputs_to_give, refuse_unknown
from dextera_build.report.wording import count
from dextera_build.session import Session, notices

if TYPE_CHECKING:
    from dextera_build.cli.look.mending import Mending

Fill = Callable[[Any], Iterator[float]]
"""Fills a viewer, and gives the times of the further states of a recording [s]; each item moves the scene on."""


def of(session: Session, node: str, episode: str | None = None) -> Fill:
    """The values to show of a node, or of a recipe if `node` is empty.

    Args:
        session: The recipe.
        node: Its node, or "".
        episode: Index of the episode to begin with.

    Raises:
        UsageError: The recipe has nothing to show, or there is no such episode.
    """
    if not node:
        _refuse_episode(session.recipe, episode)
        return _recipe(session)
    wanted = part.named(session, node)
    fetch.bring(session, [wanted.node] if wanted.node in session.history else [])
    artifact = part.artifact(session, wanted)
    if isinstance(artifact, Episodes | Trials) and not wanted.fields:
        return _episodes(session, node, artifact, episode)
    _refuse_episode(f"{session.recipe}:{node}", episode)
    if wanted.fields:
        return _plain(artifact, node)
    if isinstance(artifact, TaskBundle):
        return _task(session, node, artifact)
    if isinstance(artifact, Scene):
        return _written(session, node, artifact)
    if isinstance(artifact, RobotModel):
        return _robot(node, artifact)
    return _plain(artifact, node)


def _refuse_episode(target: str, episode: str | None) -> None:
    if episode is not None:
        raise UsageError(
            f"`{target}` holds no episodes",
            code="DXB-U324",
            hint="`dxb ls RECIPE` lists nodes; `--episode` is for episodes",
        )


def _plain(artifact: Any, node: str) -> Fill:
    from dextera_build.view import framing
    from dextera_build.view.show import show

    def fill(viewer: Any) -> Iterator[float]:
        show(artifact, viewer, f"/{node}")
        framing.look_at(viewer, artifact)
        return iter(())

    return fill


def _robot(node: str, robot: RobotModel) -> Fill:
    from dextera_build.view.robot import RobotView

    def fill(viewer: Any) -> Iterator[float]:
        return RobotView(viewer, f"/{node}", robot).sweep()

    return fill


def _written(session: Session, node: str, scene: Scene) -> Fill:
    from dextera_build.view.task import show_model

    materials = _materials(session, node)

    def fill(viewer: Any) -> Iterator[float]:
        show_model(viewer, f"/{node}", scene, materials)
        return iter(())

    return fill


def _task(session: Session, node: str, bundle: TaskBundle) -> Fill:
    from dextera_build.view.task import TaskView

    materials = _materials(session, node)

    def fill(viewer: Any) -> Iterator[float]:
        TaskView(viewer, f"/{node}", bundle, materials)
        return iter(())

    return fill


def _episodes(session: Session, node: str, artifact: Episodes | Trials, episode: str | None) -> Fill:
    from dextera_build.view.replay import ReplayView, is_asked, titles

    episodes = artifact.examples if isinstance(artifact, Trials) else artifact
    bundle = _world(session, node, artifact)
    materials = _materials(session, node)
    known = titles(episodes)
    chosen = next((title for title in known if episode is None or is_asked(title.partition(" ")[0], episode)), None)
    if chosen is None:
        raise UsageError(
            f"`{session.recipe}:{node}` has no episode `{episode}`" if known else f"`{node}` holds no episode",
            code="DXB-U324",
            facts={"episodes": listing((title.partition(" ")[0] for title in known), most=30)},
        )

    def fill(viewer: Any) -> Iterator[float]:
        view = ReplayView(viewer, f"/{node}", bundle, episodes, materials)
        view.choose(chosen)
        return view.recording()

    return fill


def _world(session: Session, node: str, artifact: Episodes | Trials) -> TaskBundle:
    """The task that the episodes were made in: the nearest one behind the node, in the trials' kind of world."""
    bundles = [made for _, made in ancestors.found(session, node, TaskBundle) if isinstance(made, TaskBundle)]
    if isinstance(artifact, Trials):
        wanted = "twin" if artifact.world == REAL else artifact.world  # a robot is shown in the model of its twin
        bundles = [made for made in bundles if made.kind == wanted]
    if not bundles:
        raise RuleError(
            f"the task that the episodes of `{node}` were made in is not in the store",
            code="DXB-B404",
            hint=f"`dxb build '{session.recipe}:{node}'`",
        )
    return bundles[0]


def _materials(session: Session, node: str) -> dict[str, str]:
    """Root body -> row of the material table, from the assets behind a node."""
    from dextera_build.sim.model.names import body_names

    assets = {
        label: asset.physics.material
        for address, asset in ancestors.found(session, node, Asset)
        if isinstance(asset, Asset) and (label := (parse_address(address.rpartition(":")[2]).labels or ("",))[-1])
    }
    bodies = body_names(assets)
    return {bodies[label]: material for label, material in assets.items()}


def _recipe(session: Session) -> Fill:
    """The recipe's task, or else the twin's scene from the parts that the last build made or as written, or a robot."""
    nodes = built.by_type(session)
    if (own := built.own_task(session)) is not None:
        fetch.bring(session, nodes.get("Asset", []))
        return _task(session, *own)
    missing = [kind for kind in PARTS if kind not in nodes]
    if missing and (robots := [node for node in nodes.get("RobotModel", []) if ":" not in node]):
        return of(session, robots[-1])
    if missing:
        raise _nothing(session, missing if nodes else [])
    named = nodes.pop("Segmentation", [])[-1:]
    bare = fetch.bring(session, [*(nodes[kind][-1] for kind in PARTS), *nodes.get("Asset", []), *named])
    if named and named[0] not in bare:
        nodes["Segmentation"] = named
    return _as_written(session, nodes, bare) if {*bare} - {*named} else _scene(session, nodes)


def _nothing(session: Session, missing: list[str]) -> UsageError:
    """The error for a recipe without anything to show; `missing` is empty if no build of it is known."""
    build = f"dxb build {session.recipe}{inputs_to_give(session.project, session.recipe)}"
    if missing:
        return UsageError(
            f"`{session.recipe}` has no scene to show yet, and neither a task nor a robot",
            code="DXB-U113",
            facts={"missing": ", ".join(missing)},
            hint=f"`{build}`, or name a node: `dxb view {session.recipe}:NODE`",
        )
    refuse_unknown(session.project, session.recipe)
    return UsageError(f"`{session.recipe}` was never built here", code="DXB-U113", hint=f"`{build}`")


def _as_written(session: Session, nodes: dict[str, list[str]], bare: list[str]) -> Fill:
    """The file of the scene that was exported, where a remote or a bundle brought no more than that.

    Raises:
        RuleError: The store has none.
    """
    told = f"the store lacks the bytes of {count(len(bare), 'part')} of the scene"
    hint = f"`dxb build --whole {session.recipe}`"
    for node in reversed(nodes.get("Scene", [])):
        if not session.is_bare(session.past(node).key) and isinstance(scene := session.artifact(node), Scene):
            notices[f"shown as `{node}` was written, without the photograph: {told}; {hint} brings them"] = None
            return _written(session, node, scene)
    raise RuleError(f"{told}: {listing(bare, most=3)}", code="DXB-B401", hint=hint)


def _scene(session: Session, nodes: dict[str, list[str]]) -> Fill:
    from dextera_build.view.scene import show_scene

    loaded: dict[str, Any] = {kind: session.artifact(nodes[kind][-1]) for kind in PARTS}
    addresses = {(parse_address(node).labels or (node,))[-1]: node for node in nodes.get("Asset", [])}
    assets: dict[str, Any] = {label: session.artifact(node) for label, node in addresses.items()}
    photograph = loaded["Capture"].photograph
    held = _held(session, nodes.get("Scene", []), assets)

    def fill(viewer: Any) -> Iterator[float]:
        show_scene(
            viewer,
            assets,
            loaded["Background"],
            loaded["Support"],
            photograph.camera,
            photo=photograph.rgb,
            addresses=addresses,
            held=held,
            mending=_mending(session, nodes, photograph, viewer),
        )
        return iter(())

    return fill


def _held(session: Session, nodes: list[str], assets: Mapping[str, Asset]) -> dict[str, str]:
    """Label -> why the last scene holds the object; empty without the bytes of a scene."""
    from dextera_build.sim.model.names import body_names

    if not nodes or nodes[-1] in fetch.bring(session, nodes[-1:]):
        return {}
    scene = session.artifact(nodes[-1])
    reasons = scene.held if isinstance(scene, Scene) else {}
    return {label: reasons[body] for label, body in body_names(assets).items() if body in reasons}


def _mending(session: Session, nodes: dict[str, list[str]], photograph: Photograph, viewer: Any) -> Mending | None:
    """What the panel does with the objects; None without segmented objects."""
    from dextera_build.cli.look.mending import Mending
    from dextera_build.view import server

    if "Segmentation" not in nodes:
        return None
    objects: Any = session.artifact(nodes["Segmentation"][-1])

    def show(built: Session) -> None:
        fill = _recipe(built)
        server.clear(viewer)
        fill(viewer)

    return Mending(session, photograph, objects, show)
