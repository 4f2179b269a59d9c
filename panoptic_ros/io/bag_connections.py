"""Topics of bags with the definitions of their messages, which bags keep inside."""
from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

IDL = "=" * 80 + "\nIDL: "  # how a definition in that language begins
UNKNOWN_DIGEST = "RIHS01_" + 64 * "0"


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
            QosHistory.KEEP_LAST, 64 if latched else 10,
            QosReliability.RELIABLE if reliable else QosReliability.BEST_EFFORT,
            QosDurability.TRANSIENT_LOCAL if latched else QosDurability.VOLATILE,
            always, always, QosLiveliness.AUTOMATIC, always, False,
        )  # fmt: skip
        return self._replace(qualities=(quality,))


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
    if connection.digest:
        return connection.digest
    store = types_of(connection.kind, connection.definition)
    try:
        return UNKNOWN_DIGEST if store is None else store.hash_rihs01(connection.kind)
    except (TypesysError, KeyError):  # a part of the definition is missing
        return UNKNOWN_DIGEST
