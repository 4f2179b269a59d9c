"""Find the message definitions of installed packages, which bags store with their topics."""

from __future__ import annotations

import importlib.util
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import TypesysError, get_types_from_msg
from rosbags.typesys.store import Typestore

from panoptic_ros.io.bag_connections import Connection
from panoptic_ros.io.messages.family import bag_typestore


@lru_cache(maxsize=256)
def described(topic: str, kind: str) -> Connection | None:
    """Return a topic with its message definition; None if no definition is found.

    Args:
        kind: "package/msg/Name" of ROS 2 Jazzy, of this project, or of a package whose .msg files are
            installed.
    """
    store = bag_typestore()
    try:
        if not _has(store, kind):
            return None
        definition, _ = store.generate_msgdef(kind, ros_version=2)
        return Connection(topic, kind, definition, store.hash_rihs01(kind))
    except (TypesysError, KeyError):
        return None


def _has(store: Typestore, kind: str) -> bool:
    """Return whether a type and all its nested types are registered, after reading installed .msg files."""
    if kind in store.types:
        return True
    path = _file_of(kind)
    if path is None:
        return False
    store.register(get_types_from_msg(path.read_text(), kind))
    return all(_has(store, part) for part in _parts(store, kind))


def _parts(store: Typestore, kind: str) -> list[str]:
    """Return the names of the message types nested in a type."""
    nodes: list[Any] = [node for _, node in store.fielddefs[kind][1]]
    inner = [node[1][0] if node[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE) else node for node in nodes]
    return [str(about) for what, about in inner if what == Nodetype.NAME]


def _file_of(kind: str) -> Path | None:
    package, _, name = kind.split("/")
    spec = importlib.util.find_spec(package)
    if spec is None or spec.origin is None:
        return None
    inside = Path(spec.origin).parent
    places = [inside, *(parent / "share" / package for parent in inside.parents)]
    return next((p for place in places if (p := place / "msg" / f"{name}.msg").is_file()), None)
