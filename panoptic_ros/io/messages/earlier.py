"""Convert messages of earlier versions to the current definitions, with the definitions that bags store.

Fields have been added over time, and a few have changed their type. Fields in both definitions are copied.
New fields get the value for "unknown", which for most fields is empty or 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys.store import Typestore

from panoptic_ros.io.bag_connections import types_of
from panoptic_ros.io.messages.family import bag_typestore, decode_cdr

Fill = Callable[[Any], Any]  # returns a current field's value from the old message


def _joint_count(people: Any) -> int:
    return len(people[0].scores) if len(people) else 0


# Values of added fields for which empty or 0 would not mean "unknown".
ADDED: Mapping[str, Mapping[str, Fill]] = {
    "AudioBlock": {"channels": lambda old: 1},
    "Camera": {"lens": lambda old: "brown"},
    "ClockModel": {"until_ns": lambda old: 2**63 - 1},
    "Skeletons": {
        "newest_stamp": lambda old: old.header.stamp,
        "joint_count": lambda old: _joint_count(old.skeletons),
    },
    "ViewDetections": {
        "joint_count": lambda old: len(old.scores) // old.person_count if old.person_count else 0,
    },
}
# Fields without which a message of that type has no use: it cannot be converted.
NEEDED: Mapping[str, frozenset[str]] = {"ProposalSet": frozenset({"association"})}


def bringing_up(kind: str, definition: str) -> Callable[[bytes], bytes] | None:
    """Return a function that converts CDR bytes of an earlier version; None if conversion is impossible.

    Args:
        kind: "package/msg/Name".
        definition: message definition from the bag.
    """
    before, now = types_of(kind, definition), bag_typestore()
    if before is None or not _can_follow(kind, before, now):
        return None

    def bring(data: bytes) -> bytes:
        message = _brought_up(decode_cdr(data, kind, before), kind, before, now)
        return bytes(now.serialize_cdr(message, kind))

    return bring


def _can_follow(kind: str, before: Typestore, now: Typestore) -> bool:
    """Return whether a message type can be converted to the current version, with all its nested types.

    No needed field may be missing, and at least one own field must exist in both versions.
    """
    if kind not in before.types:
        return False
    old, new = _fields(kind, before), _fields(kind, now)
    if not (set(old) - {"header"}) & set(new) and set(new) - {"header"}:
        return False
    if NEEDED.get(_name(kind), frozenset()) - set(old):
        return False
    inner = [part for name, node in new.items() if name in old and (part := _message_in(node)) is not None]
    return all(_can_follow(part, before, now) for part in inner if part != kind)


def _brought_up(old: Any, kind: str, before: Typestore, now: Typestore) -> Any:
    had, added = _fields(kind, before), ADDED.get(_name(kind), {})
    values = {}
    for field, node in _fields(kind, now).items():
        if field in had:
            values[field] = _converted(getattr(old, field), node, before, now)
        elif field in added:
            values[field] = added[field](old)
        else:
            values[field] = _nothing(node, now)
    return now.types[kind](**values)


def _converted(value: Any, node: Any, before: Typestore, now: Typestore) -> Any:
    what, about = node
    if what == Nodetype.NAME:
        return _brought_up(value, about, before, now)
    if what == Nodetype.BASE:
        return _base(value, about[0])
    (inner, about_inner), _ = about
    if inner == Nodetype.NAME:
        return [_brought_up(item, about_inner, before, now) for item in value]
    return list(value) if about_inner[0] == "string" else np.asarray(value).astype(_dtype(about_inner[0]))


def _nothing(node: Any, now: Typestore) -> Any:
    what, about = node
    if what == Nodetype.NAME:
        return now.types[about](**{name: _nothing(part, now) for name, part in _fields(about, now).items()})
    if what == Nodetype.BASE:
        return _base(0, about[0]) if about[0] != "string" else ""
    (inner, about_inner), count = about
    if inner == Nodetype.NAME or about_inner[0] == "string":
        return []
    return np.zeros(count if what == Nodetype.ARRAY else 0, _dtype(about_inner[0]))


def _base(value: Any, name: str) -> Any:
    if name == "string":
        return str(value)
    if name == "bool":
        return bool(value)
    return float(value) if name.startswith("float") else round(value)


def _dtype(name: str) -> str:
    return {"octet": "uint8", "byte": "uint8", "char": "uint8"}.get(name, name)


def _message_in(node: Any) -> str | None:
    """Return the message type nested in a field; None if it has none."""
    what, about = node
    if what in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        what, about = about[0]
    return str(about) if what == Nodetype.NAME else None


def _fields(kind: str, store: Typestore) -> dict[str, Any]:
    return dict(store.fielddefs[kind][1])


def _name(kind: str) -> str:
    return kind.split("/")[-1]
