"""Topics of bags and their message definitions, which every bag stores itself."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2.metadata import parse_qos
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

IDL = "=" * 80 + "\nIDL: "  # prefix of a definition in IDL, as bags store it
UNKNOWN_DIGEST = "RIHS01_" + 64 * "0"
CDR = "cdr"  # the only message serialization that is read and written
VIDEO = "CompressedVideo"  # suffix of Foxglove's message type for video packets, in every serialization
# Definition languages that are accepted. Recorders write "" or "unknown" if they have no definition.
DEFINED = ("ros2msg", "ros2idl", "omgidl", "", "unknown")
SERIALIZATIONS = {
    "ros1": "ROS 1",
    "json": "JSON",
    "protobuf": "protobuf",
    "flatbuffer": "FlatBuffers",
    "cbor": "CBOR",
    "": "messages of an unstated serialization",
}


class Connection(NamedTuple):
    """A topic with the type, definition and QoS that the bag states.

    Args:
        kind: message type, "package/msg/Name".
        definition: text of the message definition with all nested types; "" = not in the bag.
        digest: RIHS01 hash of the type; "" = not in the bag.
        qualities: QoS profiles that the publishers offered.
    """

    topic: str
    kind: str
    definition: str = ""
    digest: str = ""
    qualities: tuple[Any, ...] = ()

    @property
    def is_latched(self) -> bool:
        """Return whether all publishers are transient local: they keep messages for late subscribers."""
        durable = [q.durability == QosDurability.TRANSIENT_LOCAL for q in self.qualities]
        return bool(durable) and all(durable)

    @property
    def is_best_effort(self) -> bool:
        """Return whether all publishers are best-effort: they do not retransmit lost messages."""
        effort = [q.reliability == QosReliability.BEST_EFFORT for q in self.qualities]
        return bool(effort) and all(effort)

    @property
    def has_header(self) -> bool:
        """Return whether the first field of the message definition is a std_msgs header."""
        words = (line.split("#")[0].split() for line in self.definition.splitlines())
        first = next((found for found in words if found), [""])
        return first[0] in ("std_msgs/Header", "std_msgs/msg/Header", "Header")

    def offered(self, reliable: bool, latched: bool) -> Connection:
        """Return the topic with the QoS profile of a publisher.

        Args:
            reliable: reliable, else best-effort.
            latched: transient local with a history of 64 messages, else volatile with 10.
        """
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
    """Return the name of a serialization that cannot be read; "" for CDR of a stated type.

    Args:
        message: serialization that the bag states.
        definition: language of the message definition.
        kind: message type, "package/msg/Name" or the bag's own notation.
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
    """Parse the QoS profiles of a topic as a bag states them, as text or as a list.

    Raises:
        ValueError: if they cannot be parsed.
    """
    try:
        return tuple(parse_qos(words))
    except Exception as error:  # rosbags does not validate its input: a damaged bag can raise any exception
        raise ValueError("no QoS") from error


@lru_cache(maxsize=1024)
def qualities_of(text: str) -> tuple[Any, ...]:
    """Return `qualities_in` of a text from a cache: most topics of a bag have the same profiles."""
    return qualities_in(text)


@lru_cache(maxsize=256)
def types_of(kind: str, definition: str) -> Typestore | None:
    """Return the types of a message definition; None if it is empty or cannot be parsed."""
    store = get_typestore(Stores.EMPTY)
    read = get_types_from_idl if definition.startswith(IDL) else None
    try:
        store.register(read(definition) if read else get_types_from_msg(definition, kind))
    except (TypesysError, KeyError, ValueError):
        return None
    return store if kind in store.types else None


def digest_of(connection: Connection) -> str:
    """Return the RIHS01 hash that the bag states, else compute it from the definition.

    UNKNOWN_DIGEST if the definition is missing or incomplete.
    """
    return connection.digest or _digest_of(connection.kind, connection.definition)


@lru_cache(maxsize=256)
def _digest_of(kind: str, definition: str) -> str:
    store = types_of(kind, definition)
    try:
        return UNKNOWN_DIGEST if store is None else store.hash_rihs01(kind)
    except (TypesysError, KeyError):  # a nested type is missing in the definition
        return UNKNOWN_DIGEST
