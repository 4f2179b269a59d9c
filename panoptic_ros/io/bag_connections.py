"""Topics of bags with the definitions of their messages, which bags keep inside."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

IDL = "=" * 80 + "\nIDL: "  # how a definition in that language begins
UNKNOWN_DIGEST = "RIHS01_" + 64 * "0"
CDR = "cdr"  # the one serialization of messages that is read and written
VIDEO = "CompressedVideo"  # how Foxglove's type for packets of a video ends, in every serialization
DEFINED = ("ros2msg", "ros2idl", "omgidl", "", "unknown")  # languages of definitions; recorders use the last
SERIALIZATIONS = {
    "ros1": "ROS 1",
    "json": "JSON",
    "protobuf": "protobuf",
    "flatbuffer": "FlatBuffers",
    "cbor": "CBOR",
    "": "messages of an unstated serialization",
}


class Connection(NamedTuple):
    """A topic as a bag describes it.

    Args:
        kind: "package/msg/Name". definition: with all that it needs, "" = not in the bag.
        digest: RIHS01, "" = not in the bag. qualities: QoS profiles that were offered.
    """

    topic: str
    kind: str
    definition: str = ""
    digest: str = ""
    qualities: tuple[Any, ...] = ()

    @property
    def is_latched(self) -> bool:
        """Whether all of its publishers keep messages for subscribers who come late."""
        durable = [q.durability == QosDurability.TRANSIENT_LOCAL for q in self.qualities]
        return bool(durable) and all(durable)

    @property
    def is_best_effort(self) -> bool:
        """Whether none of its publishers sends lost messages again."""
        effort = [q.reliability == QosReliability.BEST_EFFORT for q in self.qualities]
        return bool(effort) and all(effort)

    @property
    def has_header(self) -> bool:
        """Whether its messages begin with a header, by the definition."""
        words = (line.split("#")[0].split() for line in self.definition.splitlines())
        first = next((found for found in words if found), [""])
        return first[0] in ("std_msgs/Header", "std_msgs/msg/Header", "Header")

    def offered(self, reliable: bool, latched: bool) -> Connection:
        """The same topic as publishers offer it."""
        always = QosTime(9223372036, 854775807)
        quality = Qos(
            QosHistory.KEEP_LAST,
            64 if latched else 10,
            QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            always,
            always,
            QosLiveliness.AUTOMATIC,
            always,
            False,
        )
        return self._replace(qualities=(quality,))


def serialization_but_cdr(message: str, definition: str, kind: str) -> str:
    """Name what messages are that cannot be read; empty: they are CDR of a known type.

    Args:
        message: the serialization that the bag states. definition: the language of its definition.
        kind: "package/msg/Name", or what else the bag calls the type.
    """
    if message != CDR:
        what = SERIALIZATIONS.get(message, message[:40])
        return f"{what} video" if kind.endswith(VIDEO) else what
    if definition not in DEFINED:
        return f"CDR of {SERIALIZATIONS.get(definition, definition[:40])} types"
    return "" if kind.count("/") == 2 else "CDR of no stated type"


def full_kind(kind: str) -> str:
    """Return "package/msg/Name" of the "package/Name" that the first versions of ROS 2 wrote."""
    return kind.replace("/", "/msg/") if kind.count("/") == 1 else kind


def qualities_in(words: Any) -> tuple[Any, ...]:
    """QoS profiles as a bag states them, in a text or a list.

    Raises:
        ValueError: if they are none.
    """
    try:
        return tuple(parse_qos(words))
    except Exception as error:  # rosbags trusts what it reads: damage shows as anything
        raise ValueError("no QoS") from error


@lru_cache(maxsize=1024)
def qualities_of(text: str) -> tuple[Any, ...]:
    """Return `qualities_in` of a text; most topics of a bag state the same."""
    return qualities_in(text)


@lru_cache(maxsize=256)
def types_of(kind: str, definition: str) -> Typestore | None:
    """The types of a definition, None if there is none or it cannot be read."""
    store = get_typestore(Stores.EMPTY)
    read = get_types_from_idl if definition.startswith(IDL) else None
    try:
        store.register(read(definition) if read else get_types_from_msg(definition, kind))
    except (TypesysError, KeyError, ValueError):
        return None
    return store if kind in store.types else None


def digest_of(connection: Connection) -> str:
    """RIHS01 of the definition, as the bag says or as it comes to."""
    return connection.digest or _digest_of(connection.kind, connection.definition)


@lru_cache(maxsize=256)
def _digest_of(kind: str, definition: str) -> str:
    store = types_of(kind, definition)
    try:
        return UNKNOWN_DIGEST if store is None else store.hash_rihs01(kind)
    except (TypesysError, KeyError):  # a part of the definition is missing
        return UNKNOWN_DIGEST
