"""Selection of the topics of one camera in a recording."""

from __future__ import annotations

from typing import NamedTuple

from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import listing
from dextera_build.formats.mcap import JOINTS, LENSES, PICTURES
from dextera_build.rule import Context


class CameraTopics(NamedTuple):
    """Topics of one camera."""

    image: str
    """Pictures."""
    depth: str
    """Depth, or empty."""
    lens: str
    """Intrinsics."""


def of_camera(ctx: Context, stream: Stream, image: str, depth: str, lens: str) -> CameraTopics:
    """The camera's topics; an empty `image` or `lens` selects the only candidate."""
    pictures = _named(stream, PICTURES)
    chosen = image or _only(ctx, [topic for topic in pictures if not _is_depth(topic)], "pictures", "image", stream)
    for option, topic in (("image", chosen), ("depth", depth)):
        if topic and topic not in pictures:
            ctx.fail(
                f"option `{option}`: there are no pictures on topic `{topic}`",
                topics=listing(pictures) or "none",
                hint="name one of these topics",
            )
    lenses = _named(stream, LENSES)
    if lens and lens not in lenses:
        ctx.fail(
            f"option `camera_info`: there is no camera on topic `{lens}`",
            topics=listing(lenses) or "none",
            hint="name one of these topics",
        )
    return CameraTopics(chosen, depth, lens or beside(ctx, chosen, lenses))


def only_depth(ctx: Context, stream: Stream) -> str:
    """The only topic of depth, registered to the pictures if several are; empty if there is none."""
    known = [topic for topic in _named(stream, PICTURES) if "depth" in topic.lower()]
    known = [topic for topic in known if "aligned" in topic.lower()] or known
    return _only(ctx, known, "depth", "depth", stream) if known else ""


def of_joints(ctx: Context, stream: Stream, topic: str) -> str:
    """The topic of the joint states."""
    known = _named(stream, JOINTS)
    if topic and topic not in known:
        ctx.fail(
            f"option `joints`: there are no joint states on topic `{topic}`",
            topics=listing(known) or "none",
            hint="name one of these topics",
        )
    return topic or _only(ctx, known, "joint states", "joints", stream)


def beside(ctx: Context, image: str, lenses: list[str]) -> str:
    """The topic of intrinsics that shares most of its path with the pictures, following the naming of drivers."""
    shared = {topic: in_common(image, topic) for topic in lenses}
    best = max(shared.values(), default=0)
    found = [topic for topic in lenses if shared[topic] == best]
    if len(lenses) != 1 and (not best or len(found) != 1):
        ctx.fail(
            f"which topic has the intrinsics of `{image}` is not clear"
            if lenses
            else "the recording has no intrinsics",
            topics=listing(lenses) or "none",
            hint="set option `camera_info`" if lenses else "record the topic `camera_info` with the pictures",
        )
    return found[0]


def in_common(one: str, other: str) -> int:
    """Number of leading parts that the names of two topics have in common."""
    count = 0
    for left, right in zip(one.strip("/").split("/"), other.strip("/").split("/"), strict=False):
        if left != right:
            break
        count += 1
    return count


def _is_depth(topic: str) -> bool:
    return any(word in topic.lower() for word in ("depth", "infra", "/ir/", "disparity", "confidence"))


def _named(stream: Stream, kinds: tuple[str, ...]) -> list[str]:
    return [each.topic for each in stream.channels if each.kind in kinds and each.count]


def _only(ctx: Context, found: list[str], what: str, option: str, stream: Stream) -> str:
    if len(found) != 1:
        ctx.fail(
            f"the recording has {what} on {len(found)} topics" if found else f"the recording has no {what}",
            topics=listing(found or [f"{each.topic} ({each.kind})" for each in stream.channels]),
            hint=f"choose one by option `{option}`" if found else f"record {what}, or name their recording",
        )
    return found[0]
