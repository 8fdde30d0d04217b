"""capture.bag: conversion of a ROS bag to a recording: ROS 2 folders and files, ROS 1, RealSense."""

from __future__ import annotations

import contextlib
import io
import resource
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from dextera_build.artifacts.base import File, Folder
from dextera_build.artifacts.robots.stream import Stream
from dextera_build.errors import RuleError, listing
from dextera_build.formats import hand_stream, mcap
from dextera_build.formats.mcap import FRAMES, IMUS, JOINTS, LENSES, PICTURES, POSES, TRANSFORMS
from dextera_build.rule import Context, Options, rule

FORMS = {b"#ROSBAG V2.0": "bag.bag", b"SQLite format 3\x00": "bag.db3", b"\x89MCAP0\r\n": "bag.mcap"}
"""First bytes of a file -> file name with which the reader detects its format."""
KINDS = (
    *(*JOINTS, *POSES, *PICTURES, *LENSES, *TRANSFORMS, *IMUS, *FRAMES),
    *(*hand_stream.HANDS, *hand_stream.INPUTS, "std_msgs/msg/Float32", "std_msgs/msg/Float64"),
)
STATIC = "/tf_static"
"""End of the topic of transforms that do not change; the others can be computed from the joints."""
MOST_BYTES = 4 << 30
"""Memory limit of the conversion [bytes]; a chunk compressed with bzip2 can be a millionth of its size."""
DISTRIBUTION = "ros2_humble"
"""ROS 2 distribution of the message definitions, for bags that contain none, such as SQLite before ROS 2 Iron."""


class BagOptions(Options):
    """Options of capture.bag."""

    topics: tuple[str, ...] = ()
    """Topics to keep; empty: all."""


@rule(version=1, packages=("mcap", "mcap-ros2-support", "numpy", "rosbags"))
def bag(ctx: Context, file: File | Folder, *, options: BagOptions) -> Stream:
    """Return the joint states, poses, pictures, cameras and accelerations of a bag as MCAP of ROS 2 messages.

    `file` is a folder of ROS 2 with `metadata.yaml`, a single `.db3` or `.mcap`, or a `.bag` of ROS 1, as written by
    RealSense cameras. Other messages are left out. Stamps are those of the bag.
    """
    source = _placed(ctx, file)
    found = _converted(ctx, source, _chosen(ctx, source, options.topics))
    ctx.metric("duration", found.duration_s(), "s")
    ctx.say(", ".join(found.facts()))
    return found


def _placed(ctx: Context, file: File | Folder) -> Path:
    """The bag on disk, under a file name that identifies its format."""
    if isinstance(file, Folder):
        file.export(ctx.scratch / "source", "bag")
        metadata = next(iter(sorted((ctx.scratch / "source").rglob("metadata.yaml"))), None)
        if metadata is None:
            ctx.fail(
                "the folder is not a bag of ROS 2: `metadata.yaml` is missing",
                here=listing(file.files),
                hint="copy the whole folder that `ros2 bag record` wrote, or `ros2 bag reindex` it",
            )
        if b"<<" in metadata.read_bytes():
            ctx.fail("`metadata.yaml` merges mappings (`<<`), which no recorder writes", hint="write the values down")
        return metadata.parent
    with file.open() as stream:
        begins = stream.read(16)
    name = next((name for magic, name in FORMS.items() if begins.startswith(magic)), None)
    if name is None:
        ctx.fail(
            "the file is not a bag",
            begins=repr(begins),
            wanted="a `.bag` of ROS 1, a `.db3` or an `.mcap`",
            hint="give the folder if the bag is one",
        )
    path = ctx.scratch / name
    file.place(path)
    return path


def _chosen(ctx: Context, source: Path, topics: tuple[str, ...]) -> list[str]:
    """Topics of the bag that are kept."""
    from rosbags.highlevel import AnyReader

    with _reading(ctx), AnyReader([source], default_typestore=_store()) as reader:
        known = {each.topic: each.msgtype for each in reader.connections if each.msgcount}
    moving = {topic for topic, kind in known.items() if kind in FRAMES and not topic.endswith(STATIC)}
    usable = [topic for topic, kind in sorted(known.items()) if kind in KINDS or topic == hand_stream.ABOUT]
    usable = [topic for topic in usable if topic not in moving]
    here = listing(f"{topic} ({kind})" for topic, kind in sorted(known.items()))
    for topic in topics:
        if topic not in usable:
            ctx.fail(
                f"the bag has no joint states, poses, hands, pictures or cameras on topic `{topic}`",
                topics=here,
                hint="name another topic, or leave it out of option `topics`",
            )
    if not usable:
        ctx.fail(
            "the bag has no joint states, poses, hands or pictures",
            topics=here,
            hint="record `/joint_states` and the camera's topics",
        )
    return list(topics or usable)


def _converted(ctx: Context, source: Path, topics: list[str]) -> Stream:
    """The recording of these topics."""
    from rosbags.convert import convert

    out = ctx.scratch / "converted"
    with _reading(ctx), contextlib.redirect_stdout(io.StringIO()):  # it prints the types that it copies
        convert(
            [source],
            out,
            dst_storage="mcap",
            dst_version=9,
            compress=None,
            compress_mode="file",
            default_typestore=_store(),
            typestore=_store(),
            exclude_topics=(),
            include_topics=topics,
            exclude_msgtypes=(),
            include_msgtypes=(),
        )
    (made,) = out.glob("*.mcap")
    return mcap.of(File.of(made), made.name)


def _store() -> Any:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores(DISTRIBUTION))


@contextlib.contextmanager
def _reading(ctx: Context) -> Iterator[None]:
    """Convert any exception of the reader on damaged bags to one error.

    The reader unpacks whole chunks of any size, so the memory is limited meanwhile.
    """
    before = resource.getrlimit(resource.RLIMIT_DATA)
    known = [each for each in before if each != resource.RLIM_INFINITY]
    taken = 1024 * int(Path("/proc/self/status").read_text().partition("VmData:")[2].split()[0])
    resource.setrlimit(resource.RLIMIT_DATA, (min([taken + MOST_BYTES, *known]), before[1]))
    try:
        yield
    except RuleError:
        raise
    except Exception as error:
        if isinstance(error, MemoryError) or isinstance(error.__cause__, MemoryError):
            ctx.fail(
                "the bag unpacks to more than fits in memory",
                most=f"{MOST_BYTES / 2**30:g} GiB at once",
                hint="write it with smaller chunks, or without compression",
            )
        ctx.fail(
            "the bag cannot be read",
            reader=str(error) or type(error).__name__,
            hint="`ros2 bag info BAG` or `rosbag info BAG` shows the fault; `ros2 bag reindex` and `rosbag reindex` "
            "repair a bag that was not closed",
        )
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, before)
