"""Messages of earlier versions that bags may hold, brought up to the definitions of now."""
from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from panoptic_ros.io.messages.family import PACKAGE, bag_typestore, decode_cdr

# As they were before fields were added at their ends, and what these fields then say.
EARLIER: dict[str, tuple[str, dict[str, Any]]] = {
    "AudioBlock": (
        "std_msgs/Header header\nuint64 first_sample\nuint32 sample_rate\nfloat32[] samples\n",
        {"channels": 1, "clocks": []},
    ),
    "TimecodeReading": (
        "std_msgs/Header header\nuint8 hours\nuint8 minutes\nuint8 seconds\nuint8 frames\n"
        "uint32 rate_numerator\nuint32 rate_denominator\nbool drop_frame\nfloat64 start_sample\n"
        "float64 std_samples\nbool reverse\nuint32 user_bits\n",
        {"clock": "", "sample_rate": 0},
    ),
}


def bringing_up(kind: str, digest: str) -> Callable[[bytes], bytes] | None:
    """What makes CDR bytes of now of those of an earlier version; None: that version is not known.

    Args:
        kind: "package/msg/Name". digest: of the definition in the bag.
    """
    name = kind.split("/")[-1]
    if name not in EARLIER or _earlier().hash_rihs01(kind) != digest:
        return None
    added = EARLIER[name][1]

    def bring(data: bytes) -> bytes:
        store, before = bag_typestore(), decode_cdr(data, kind, _earlier())
        message = store.types[kind](**{**vars(before), **added})
        return bytes(store.serialize_cdr(message, kind))

    return bring


@lru_cache(maxsize=1)
def _earlier() -> Typestore:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, (text, _) in EARLIER.items():
        store.register(get_types_from_msg(text, f"{PACKAGE}/msg/{name}"))
    return store
