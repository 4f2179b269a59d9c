"""2D tracks and patches as messages."""

from __future__ import annotations

from typing import Any

import numpy as np

from panoptic_ros.domain import PartMotions, PatchTracks, PatchTrajectories
from panoptic_ros.io.messages.arrays import flat, shaped
from panoptic_ros.io.messages.family import Messages, stamp_of, time_ns

Fields = dict[str, tuple[Any, tuple[int, ...]]]  # type and shape of one value, by name

_TRACKS: Fields = {
    "begins": (np.float32, (2,)),
    "ends": (np.float32, (2,)),
    "information": (np.float32, (3,)),
    "persons": (np.int32, ()),
    "parts": (np.int32, ()),
}
_PATCHES: Fields = {
    "ages": (np.int32, ()),
    "people": (np.int64, ()),
    "parts": (np.int32, ()),
    "positions": (np.float32, (3,)),
    "normals": (np.float32, (3,)),
    "sigmas": (np.float32, ()),
}
_MOTIONS: Fields = {
    "parts": (np.int32, ()),
    "centres": (np.float64, (3,)),
    "rotations": (np.float64, (3,)),
    "translations": (np.float64, (3,)),
    "covariances": (np.float64, (6, 6)),
    "tracks": (np.int32, ()),
    "residuals": (np.float64, ()),
}


def write_tracks(item: PatchTracks, family: Messages, frame_id: str) -> Any:
    """The message of a view's 2D tracks."""
    return family.make(
        "PatchTracks",
        header=family.header(item.stamp_ns, item.camera),
        frame_number=item.frame_number,
        before=family.header(item.before_ns, item.camera).stamp,
        before_number=item.before_number,
        skeleton_hash=item.skeleton_hash,
        **{name: flat(family, getattr(item, name), kind) for name, (kind, _) in _TRACKS.items()},
    )


def read_tracks(message: Any) -> PatchTracks:
    """The record of a view's 2D tracks.

    Raises:
        DataError: if the arrays do not fit each other, or hold what cannot be.
    """
    count = len(message.persons)
    arrays = {
        name: shaped(getattr(message, name), f"PatchTracks.{name}", count, *tail)
        for name, (_, tail) in _TRACKS.items()
    }
    return PatchTracks(
        str(message.header.frame_id),
        stamp_of(message.header),
        int(message.frame_number),
        time_ns(message.before),
        int(message.before_number),
        str(message.skeleton_hash),
        **arrays,
    )


def write_trajectories(item: PatchTrajectories, family: Messages, frame_id: str) -> Any:
    """The message of the patches of an instant."""
    motions = item.motions
    return family.make(
        "PatchTrajectories",
        header=family.header(item.stamp_ns, frame_id),
        before=family.header(item.before_ns, frame_id).stamp,
        index=item.index,
        skeleton_hash=item.skeleton_hash,
        ids=flat(family, item.ids, np.int64),
        cameras=list(item.cameras),
        visible=flat(family, item.visible, np.float32),
        motion_people=flat(family, motions.people, np.int64),
        free=flat(family, item.free, np.int64),
        **{name: flat(family, getattr(item, name), kind) for name, (kind, _) in _PATCHES.items()},
        **{
            f"motion_{name}": flat(family, getattr(motions, name), kind)
            for name, (kind, _) in _MOTIONS.items()
        },
    )


def read_trajectories(message: Any) -> PatchTrajectories:
    """The record of the patches of an instant.

    Raises:
        DataError: if the arrays do not fit each other, or hold what cannot be.
    """
    count, number, cameras = len(message.ids), len(message.motion_people), tuple(message.cameras)
    patches = {
        name: shaped(getattr(message, name), f"PatchTrajectories.{name}", count, *tail)
        for name, (_, tail) in _PATCHES.items()
    }
    motions = {
        name: shaped(getattr(message, f"motion_{name}"), f"PatchTrajectories.motion_{name}", number, *tail)
        for name, (_, tail) in _MOTIONS.items()
    }
    return PatchTrajectories(
        int(message.index),
        stamp_of(message.header),
        time_ns(message.before),
        str(message.skeleton_hash),
        np.asarray(message.ids),
        cameras=tuple(str(name) for name in cameras),
        visible=shaped(message.visible, "PatchTrajectories.visible", count, len(cameras)),
        motions=PartMotions(np.asarray(message.motion_people), **motions),
        free=shaped(message.free, "PatchTrajectories.free", len(message.free) // 2, 2),
        **patches,
    )
