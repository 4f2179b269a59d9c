"""Choice of the views whose timestamps can be right, in a recording with faults."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Mapping, Sequence
from itertools import pairwise

import numpy as np

from panoptic_ros.solving.frames import CameraFrame
from panoptic_ros.stage import Notice

Array = np.ndarray
SECOND = 1_000_000_000
PAUSE_NS = 2 * SECOND  # ns, shortest pause of a recording
PAUSE_PERIODS = 4  # the same limit for slow cameras, in periods of the camera
LATE_PERIODS = 2.5  # periods of a camera by which a view may be out of order
FEW = 3  # minimum number of views of a camera between two pauses
# ns, interval at which an image that stays the same is used, half of `follow.MEMORY_S`: exact simulations of
# people at rest consist of such images
SAME_NS = SECOND // 4
SHARE_NS = SECOND  # ns, minimum time without views at an end of the recording that is reported
NAMED = 6  # number of cameras that a notice names


def usable_views(
    frames: Sequence[CameraFrame], cameras: Sequence[str]
) -> tuple[list[CameraFrame], list[Notice]]:
    """Return the views whose timestamps can be right, in the order of timestamps, and notices.

    A view that repeats counts once. The timestamps of a camera must increase; the largest number of views
    that do is kept. So are views that are out of order by a few periods, because such views were often
    recorded late, with the right timestamps. Images that a camera repeats with a later timestamp, two views
    or fewer between two pauses, and views that no other camera accompanies, are left out.

    Args:
        frames: views in the order of recording of each camera.
        cameras: names of the cameras.
    """
    of_cameras: dict[int, list[CameraFrame]] = {c: [] for c in range(len(cameras))}
    for frame in frames:
        of_cameras[frame.camera].append(frame)
    back: dict[int, int] = {}
    late: dict[int, int] = {}
    stray: dict[int, int] = {}
    same: dict[int, int] = {}
    kept: list[CameraFrame] = []
    for camera, own in of_cameras.items():
        own = _once(own)
        ordered, late[camera] = _ordered(own)
        fresh = _fresh(ordered)
        near = _without_strays(fresh)
        back[camera], same[camera] = len(own) - len(ordered), len(ordered) - len(fresh)
        stray[camera] = len(fresh) - len(near)
        kept += near
    kept.sort(key=lambda frame: (frame.stamp_ns, frame.camera))
    together, alone = _accompanied(kept)
    for camera, count in alone.items():
        stray[camera] += count
    out = "are left out, because their stamps"
    texts = {
        "continuous.stamps_back": (back, f"{out} repeat or run backwards"),
        "continuous.late_views": (late, "come after later ones, and are used at the times of their stamps"),
        "continuous.repeated_images": (same, "are left out, because their images repeat the previous ones"),
        "continuous.stray_stamps": (stray, f"{out} are far from all others"),
    }
    found = [_counted(code, counts, text, len(frames), cameras) for code, (counts, text) in texts.items()]
    return together, [notice for notices in found for notice in notices]


def partial_notices(
    frames: Sequence[CameraFrame], cameras: Sequence[str], known: Collection[int] = ()
) -> list[Notice]:
    """Return a notice about cameras that begin late or end early.

    Args:
        frames: at least one, in the order of timestamps.
        cameras: names of the cameras.
        known: cameras that need no notice.
    """
    begin, end = frames[0].stamp_ns, frames[-1].stamp_ns
    spans: dict[int, tuple[int, int]] = {}
    for frame in frames:
        first, _ = spans.get(frame.camera, (frame.stamp_ns, 0))
        spans[frame.camera] = first, frame.stamp_ns
    late = {
        c: (first - begin, last - begin)
        for c, (first, last) in sorted(spans.items())
        if max(first - begin, end - last) > SHARE_NS and c not in known
    }
    if not late:
        return []
    listed = listed_names(
        [f"{cameras[c]} ({a / SECOND:.1f} to {b / SECOND:.1f} s)" for c, (a, b) in late.items()]
    )
    text = f"cameras have views in a part of the {(end - begin) / SECOND:.1f} s only: {listed}"
    return [Notice("continuous.partial_camera", "info", text, {"cameras": [cameras[c] for c in late]})]


def rising_stamps(stamps: Sequence[int]) -> list[int]:
    """Return the indices of a longest subsequence that increases; of equal values, the first counts."""
    ends: list[int] = []  # least last timestamp of a subsequence, by length - 1
    last: list[int] = []  # its index
    before: list[int] = []  # index of the previous element
    for k, stamp in enumerate(stamps):
        at = bisect_left(ends, stamp)
        if at < len(ends) and ends[at] == stamp:
            before.append(-1)
            continue
        before.append(last[at - 1] if at else -1)
        ends[at : at + 1], last[at : at + 1] = [stamp], [k]
    chosen = []
    k = last[-1] if last else -1
    while k >= 0:
        chosen.append(k)
        k = before[k]
    return chosen[::-1]


def _once(frames: Sequence[CameraFrame]) -> list[CameraFrame]:
    """Return the views of a camera without copies of a view with the same timestamp and 2D people."""
    found: dict[int, list[CameraFrame]] = {}
    chosen = []
    for frame in frames:
        others = found.setdefault(frame.stamp_ns, [])
        if not any(_same(frame, other) for other in others):
            others.append(frame)
            chosen.append(frame)
    return chosen


def _same(one: CameraFrame, other: CameraFrame) -> bool:
    return np.array_equal(one.plane, other.plane, equal_nan=True) and np.array_equal(one.scores, other.scores)


def _fresh(frames: Sequence[CameraFrame]) -> list[CameraFrame]:
    """Return the views of a camera without those whose 2D people equal the previous ones.

    A camera or recorder that lacks an image repeats the last one with a new timestamp.
    """
    chosen: list[CameraFrame] = []
    for frame in frames:
        old = bool(chosen) and frame.stamp_ns - chosen[-1].stamp_ns < SAME_NS
        if not (old and len(frame.plane) and _same(frame, chosen[-1])):
            chosen.append(frame)
    return chosen


def _without_strays(frames: Sequence[CameraFrame]) -> list[CameraFrame]:
    """Return the views of a camera without those that stand alone between two pauses."""
    stamps = np.array([frame.stamp_ns for frame in frames], np.int64)
    parts = _parts(stamps)
    if not any(last - first >= FEW for first, last in parts):
        return list(frames)
    return [frame for first, last in parts if last - first >= FEW for frame in frames[first:last]]


def _accompanied(frames: Sequence[CameraFrame]) -> tuple[list[CameraFrame], Mapping[int, int]]:
    """Return the views of the parts in which two cameras record, and the number of others by camera.

    If no part has two cameras, all views are returned.
    """
    chosen: list[CameraFrame] = []
    alone: dict[int, int] = {}
    for first, last in _parts(np.array([frame.stamp_ns for frame in frames], np.int64)):
        part = frames[first:last]
        if len({frame.camera for frame in part}) > 1:
            chosen += part
        else:
            alone[part[0].camera] = alone.get(part[0].camera, 0) + len(part)
    return (chosen, alone) if chosen else (list(frames), {})


def _parts(stamps: Array) -> list[tuple[int, int]]:
    """Return the first and last index, exclusive, of the parts between two pauses."""
    if not len(stamps):
        return []
    steps = np.diff(stamps.astype(np.float64))  # integers could overflow
    pause = max(PAUSE_NS, PAUSE_PERIODS * float(np.median(steps))) if len(steps) else PAUSE_NS
    borders = [0, *(np.flatnonzero(steps > pause) + 1).tolist(), len(stamps)]
    return list(pairwise(borders))


def _ordered(frames: Sequence[CameraFrame]) -> tuple[list[CameraFrame], int]:
    """Return the views of a camera whose timestamps can be right, by timestamp, and how many came late."""
    stamps = [frame.stamp_ns for frame in frames]
    rising = rising_stamps(stamps)
    if len(rising) == len(frames):
        return list(frames), 0
    reach = LATE_PERIODS * float(np.median(np.diff([stamps[k] for k in rising]))) if len(rising) > 1 else 0.0
    chosen, used = set(rising), {stamps[k] for k in rising}
    for k in sorted(set(range(len(frames))) - chosen):
        place = bisect_left(rising, k)
        early = stamps[rising[place - 1]] - stamps[k] if place else 0
        behind = stamps[k] - stamps[rising[place]] if place < len(rising) else 0
        if max(early, behind) <= reach and stamps[k] not in used:
            chosen.add(k)
            used.add(stamps[k])
    kept = sorted((frames[k] for k in chosen), key=lambda frame: frame.stamp_ns)
    return kept, len(kept) - len(rising)


def _counted(
    code: str, counts: Mapping[int, int], text: str, total: int, cameras: Sequence[str]
) -> list[Notice]:
    """Return a notice about views of `total`, by camera; no notice if there is none."""
    found = {cameras[c]: count for c, count in counts.items() if count}
    if not found:
        return []
    listed = listed_names([f"{name} ({count})" for name, count in found.items()])
    text = f"{sum(found.values())} of {total} views {text}: {listed}"
    return [Notice(code, "warning", text, {"views": found})]


def listed_names(texts: Sequence[str]) -> str:
    """Return texts in one line, at most `NAMED` of them."""
    more = f" and {len(texts) - NAMED} more" if len(texts) > NAMED else ""
    return ", ".join(texts[:NAMED]) + more
