"""Bags of ROS 1 and ROS 2, and MCAP: a column for each number of a message, ``topic.field.subfield``.

Messages are read by the definitions that the bag carries. The reader of bags makes code of them; therefore names in
them must be plain words, lists in them have bounded lengths, and definitions in IDL are not read.
"""

import re
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from keyword import iskeyword
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float

from manoeuvre_nn.core.errors import InputError
from manoeuvre_nn.core.memory import check_memory
from manoeuvre_nn.core.plain_text import harmless, listed
from manoeuvre_nn.recording.read.containers import BAG_FOLDER, NOTES, QUESTIONS, reads
from manoeuvre_nn.recording.read.streams import Stream, on_one_axis

MAX_DEFINITION = 1 << 20
"""Letters of a message's definition."""
MAX_ARRAY, MAX_LIST = 10_000, 100_000
"""Numbers of a list of fixed length in a definition, and of a list in a message."""
MAX_PARTS = 64
"""Numbers, and messages in it, of a message that becomes columns; one with more is no measurement of a ship."""
MEMORY = 4.0
"""Bytes of memory that a byte of a bag takes."""
BYTES = ("uint8", "int8", "byte", "char", "octet")
"""What pictures and clouds of points are lists of."""
PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_]*(/[A-Za-z][A-Za-z0-9_]*)*")
TURN = "geometry_msgs/msg/Quaternion"
VECTORS = {"geometry_msgs/msg/Vector3", "geometry_msgs/msg/Point"}
UNITS = {"position": "m", "linear": "m/s", "angular": "rad/s", "angular_velocity": "rad/s"}
"""Vectors in messages of ROS itself -> their unit (REP 103)."""
MOVES = re.compile(r"latitude|position|orientation|linear|angular|heading|yaw|rudder|helm|steer|delta|\bdata\b")
"""Fields, or topics of plain numbers, of sensors of motion or rudder."""
NED = re.compile(r"(?<![a-z])ned(?![a-z])", re.IGNORECASE)
ENU = re.compile(r"(?<![a-z])enu(?![a-z])|^/?(map|earth|utm|world)$", re.IGNORECASE)
"""Frames whose names tell that z points down, or that x points east."""
Getter = Callable[[Any], float]
Series = Float[np.ndarray, " n"]


class Node(IntEnum):
    """Kinds of fields in a definition, as rosbags numbers them."""

    VALUE = 1
    MESSAGE = 2
    ARRAY = 3
    LIST = 4


@dataclass
class _Topic:
    """What is read of a topic.

    Attributes:
        getters: Column -> how it is taken out of a message.
        stamped: Whether messages have a header.
        turns: Whether headings are among the columns.
        times: Receive times and header stamps [s].
        rows: Numbers of each message.
        frame: ``frame_id`` of the first message.
    """

    getters: dict[str, Getter]
    stamped: bool
    turns: bool
    times: list[tuple[float, float]] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)
    frame: str = ""


@reads(".bag", ".mcap", ".db3", BAG_FOLDER)
def bag_frame(path: Path, columns: Sequence[str] | None = None) -> pd.DataFrame:
    """Columns of a bag: ``/gps/fix.latitude [deg]``, ``/imu.angular_velocity.z``, ``/imu.orientation.heading [rad]``.

    Times are those of the headers where all messages of a topic have one, else of receiving. An orientation becomes
    roll, pitch and heading clockwise from north: axes are taken for east, north, up (REP 103) unless ``frame_id`` says
    ned, and ``attrs`` say where that is an assumption. Other numbers stand as the bag has them.

    Args:
        path: A file of ROS 1 or 2, an MCAP file, or a folder of ROS 2 with metadata.yaml.
        columns: Columns that are wanted; None is all.

    Returns:
        The columns on one axis of time, see :func:`~manoeuvre_nn.recording.read.streams.on_one_axis`.

    Raises:
        InputError: If rosbags is not installed, it is no bag, damaged, or holds no numbers.
        MemoryError: If it unpacks to more than may be had.
    """
    files = path.rglob("*") if path.is_dir() else [path]
    size = sum(part.stat().st_size for part in files)
    check_memory(f"{path.name}: {size / 1e9:.2g} GB of messages", MEMORY * size, "cut the bag into parts")
    try:
        import rosbags.highlevel  # noqa: F401  only whether it is there
    except ImportError as error:
        raise InputError(
            f"{path.name}: bags of ROS need rosbags: pip install 'manoeuvre-nn[ros]', or export the topics as CSV"
        ) from error
    try:
        topics, left_out = _read(path)
    except MemoryError:
        raise
    except Exception as error:  # its readers raise many kinds on foreign, hostile files
        said = harmless(" ".join(str(error).split()))[:100] or type(error).__name__
        raise InputError(f"{path.name}: not a bag of ROS, or damaged ({said}); record or reindex it again") from None
    streams = [_stream(name, topic) for name, topic in topics.items() if topic.rows]
    if not streams:
        raise InputError(f"{path.name}: no topic with plain numbers; it has: {listed(left_out)}")
    frame = on_one_axis(streams, columns, dated=True)
    frame.attrs[NOTES] = [f"Topics that hold no plain numbers are left out: {listed(left_out)}."] if left_out else []
    frame.attrs[QUESTIONS] = dict(pair for name, topic in topics.items() for pair in _assumed(name, topic))
    return frame


def _read(path: Path) -> tuple[dict[str, _Topic], list[str]]:
    """Numbers of all messages, and topics that have none."""
    from rosbags import rosbag1, rosbag2

    older = path.suffix.lower() == ".bag"
    with rosbag1.Reader(path) if older else rosbag2.Reader(path) as reader:
        store = _store(reader.connections)
        topics: dict[str, _Topic] = {}
        for link in reader.connections:
            if link.msgtype in store.fielddefs and link.topic not in topics:
                topics[link.topic] = _topic(store.fielddefs, link.topic, link.msgtype)
        good = [link for link in reader.connections if link.topic in topics and topics[link.topic].getters]
        left_out = sorted({link.topic for link in reader.connections} - {link.topic for link in good})
        decode = store.deserialize_ros1 if older else store.deserialize_cdr
        for link, received, raw in reader.messages(connections=good) if good else ():
            _add(topics[link.topic], decode(raw, link.msgtype), 1e-9 * received)
    return {name: topic for name, topic in topics.items() if topic.getters}, left_out


def _store(connections: Sequence[Any]) -> Any:
    """Definitions that a bag carries, checked; those of ROS 2 itself where it carries none."""
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    types: dict[str, Any] = {}
    for link in connections:
        if link.msgdef.format == MessageDefinitionFormat.MSG:
            if len(link.msgdef.data) > MAX_DEFINITION:
                raise ValueError(f"the definition of {link.msgtype} is too long")
            types.update(get_types_from_msg(link.msgdef.data, link.msgtype))
    if not types:
        types = dict(get_typestore(Stores.ROS2_HUMBLE).fielddefs)
    for name, (constants, fields) in types.items():
        words = [name, *(c[0] for c in constants), *(f[0] for f in fields)]
        if not all(PLAIN.fullmatch(word) for word in words):
            raise ValueError(f"{name!r} holds names that are no plain words")
        if any(node == Node.ARRAY and what[1] > MAX_ARRAY for _, (node, what) in fields):
            raise ValueError(f"{name} holds a list of more than {MAX_ARRAY} entries")
    store = get_typestore(Stores.EMPTY)
    store.max_sequence_length = MAX_LIST
    store.register(types)
    return store


def _topic(definitions: Mapping[str, Any], name: str, kind: str) -> _Topic:
    """What can be taken out of messages of a kind."""
    getters = {f"{name}.{'.'.join(way)}": getter for way, getter in _getters(definitions, kind)}
    fields = [f[0] for f in definitions[kind][1]]
    turns = any(column.endswith("heading [rad]") for column in getters)
    return _Topic(getters, "header" in fields, turns)


def _getters(definitions: Mapping[str, Any], kind: str) -> list[tuple[tuple[str, ...], Getter]]:
    """Numbers of a message by their places; lists, texts and headers are passed over.

    Args:
        definitions: Fields of all kinds of messages.
        kind: The kind.

    Returns:
        Place and getter of each number; none for messages with a list of bytes, as pictures and clouds of points have,
        or with too many parts.
    """
    found: list[tuple[tuple[str, ...], Getter]] = []
    left: deque[tuple[tuple[str, ...], str]] = deque([((), kind)])
    seen = 0
    while left:
        way, part = left.popleft()
        seen += 1
        for name, (node, what) in definitions[part][1]:
            here = (*way, name)
            if node == Node.LIST and what[0] in {(Node.VALUE, (byte, 0)) for byte in BYTES}:
                return []
            if node == Node.VALUE and what[0] not in {"string", "wstring"}:
                degrees = " [deg]" if name in {"latitude", "longitude"} else ""
                found.append(((*way, name + degrees), _taken(here)))
            elif node == Node.MESSAGE and what == TURN:
                angles = enumerate(("roll", "pitch", "heading"))
                found += [((*here, f"{angle} [rad]"), _turned(here, k)) for k, angle in angles]
            elif node == Node.MESSAGE and what in VECTORS:
                unit = f" [{UNITS[name]}]" if name in UNITS else ""
                found += [((*here, f"{axis}{unit}"), _taken((*here, axis))) for axis in "xyz"]
            elif node == Node.MESSAGE and what != "std_msgs/msg/Header":
                left.append((here, what))
        if max(len(found), seen + len(left)) > MAX_PARTS:
            return []
    return found


def _taken(way: Sequence[str]) -> Getter:
    """How a number is taken out of a message."""

    def take(message: Any) -> float:
        return float(_part(message, way))

    return take


def _part(message: Any, way: Sequence[str]) -> Any:
    """A part of a message; rosbags writes words of Python with a stroke behind."""
    for name in way:
        message = getattr(message, f"{name}_" if iskeyword(name) else name)
    return message


def _turned(way: Sequence[str], k: int) -> Getter:
    """How roll, pitch or yaw (k = 0, 1, 2) is taken out of a message's quaternion; NaN where there is none."""

    def take(message: Any) -> float:
        turn = _part(message, way)
        return _angles(turn.x, turn.y, turn.z, turn.w)[k]

    return take


def _angles(x: float, y: float, z: float, w: float) -> tuple[float, float, float]:
    """Roll, pitch, yaw of a unit quaternion, turned about z, then y, then x [rad]; NaN if it is none."""
    if abs(x * x + y * y + z * z + w * w - 1) > 0.05:
        return np.nan, np.nan, np.nan
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2 * (w * y - z * x), -1, 1))
    return float(roll), float(pitch), float(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))


def _add(topic: _Topic, message: Any, received: float) -> None:
    """Take the numbers of a message."""
    header = message.header if topic.stamped else None
    stamp = getattr(header, "stamp", None)
    if header is not None and not topic.rows:
        topic.frame = str(getattr(header, "frame_id", ""))
    topic.times.append((received, np.nan if stamp is None else stamp.sec + 1e-9 * stamp.nanosec))
    topic.rows.append([take(message) for take in topic.getters.values()])


def _stream(name: str, topic: _Topic) -> Stream:
    """A topic as a sensor; angles of a quaternion as those of a ship, x ahead, y to starboard, z down."""
    received, stamps = np.array(topic.times).T
    columns = dict(zip(topic.getters, np.array(topic.rows, dtype=float).T, strict=True))
    if f"{name}.status.status" in columns:  # NavSatFix: below 0 there is no fix
        columns = {k: np.where(columns[f"{name}.status.status"] < 0, np.nan, v) for k, v in columns.items()}
    if not NED.search(topic.frame):
        for column in columns:
            if column.endswith(".heading [rad]"):
                columns[column] = np.pi / 2 - columns[column]
            elif column.endswith(".pitch [rad]"):
                columns[column] = -columns[column]
    circles = {c: 2 * np.pi for c in columns if c.endswith("[rad]")} | {c: 360.0 for c in columns if "longitude" in c}
    leads = any(MOVES.search(column.lower()) for column in columns)
    return Stream(stamps if bool((stamps > 0).all()) else received, columns, leads, circles)


def _assumed(name: str, topic: _Topic) -> Iterator[tuple[str, str]]:
    """What was assumed of a topic's headings."""
    if topic.turns and not NED.search(topic.frame) and not ENU.search(topic.frame):
        for column in topic.getters:
            if column.endswith("heading [rad]"):
                frame = harmless(topic.frame)[:40]
                yield column, f"frame_id {frame!r} tells no axes: x is taken for east, y for north, z for up (REP 103)"
