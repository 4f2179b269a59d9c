"""Remove from recorded sets the views whose timestamps disagree with the majority of their set."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from panoptic_ros.domain import DetectionSet
from panoptic_ros.stage import Notice

SECOND = 1_000_000_000
# ns, tolerance of a view's timestamp; at any video rate, views of one instant differ by less
LEAST_REACH_NS = SECOND
REACH_PERIODS = 1  # periods of the sets, tolerance of a view's timestamp if this is more than LEAST_REACH_NS


def without_far_views(sets: Sequence[DetectionSet]) -> tuple[list[DetectionSet], list[Notice]]:
    """Remove views whose timestamps are far from the majority of their set.

    The set then gets the timestamp of the majority. Among groups of equal size, the group nearest to the
    timestamp of the set is kept.

    Args:
        sets: sets in timestamp order.

    Returns:
        The sets, and a notice for each camera whose views were removed.
    """
    steps = sorted(later.stamp_ns - item.stamp_ns for item, later in pairwise(sets))
    period = steps[len(steps) // 2] if steps else 0
    reach = max(LEAST_REACH_NS, REACH_PERIODS * period)
    kept: list[DetectionSet] = []
    lost: Counter[str] = Counter()
    offsets: dict[str, int] = {}
    ties: set[str] = set()
    for item in sets:
        stamps = [view.stamp_ns for view in item.views]
        if not stamps or max(max(stamps), item.stamp_ns) - min(min(stamps), item.stamp_ns) <= reach:
            kept.append(item)
            continue
        near, count = _majority(stamps, item.stamp_ns, reach)
        middle = sorted(near)[(len(near) - 1) // 2]
        views = tuple(view for view in item.views if min(near) <= view.stamp_ns <= max(near))
        for view in (view for view in item.views if view not in views):
            lost[view.camera] += 1
            offsets[view.camera] = view.stamp_ns - middle
            if count > 1:
                ties.add(view.camera)
        stamp = item.stamp_ns if abs(item.stamp_ns - middle) <= reach else middle
        stamp = max(stamp, kept[-1].stamp_ns + 1) if kept else stamp
        kept.append(replace(item, views=views, stamp_ns=stamp))
    return kept, [_notice(name, lost[name], len(sets), offsets[name], name in ties) for name in sorted(lost)]


def _majority(stamps: Sequence[int], wanted: int, reach: int) -> tuple[list[int], int]:
    """Return the largest group of timestamps within reach, and the number of groups of that size.

    Args:
        wanted: timestamp that decides between groups of equal size.
    """
    ordered = sorted(stamps)
    groups = [[other for other in ordered[k:] if other - first <= reach] for k, first in enumerate(ordered)]
    largest = max(len(group) for group in groups)
    best = [group for group in groups if len(group) == largest]
    near = min(best, key=lambda group: abs(group[(len(group) - 1) // 2] - wanted))
    apart = [group for group in best if group[0] > near[-1] or group[-1] < near[0]]
    return near, 1 + len(apart)


def _notice(camera: str, count: int, sets: int, offset: int, tie: bool) -> Notice:
    side = "ahead of" if offset > 0 else "behind"
    whose = (
        "those that are nearer to the stamps of the frames, as there is no majority"
        if tie
        else ("those of the other cameras")
    )
    text = (
        f"stamps of camera {camera} are {abs(offset) / SECOND:.1f} s {side} {whose}: its views are left out "
        f"of {count} of {sets} frames; correct its stamps, e.g. with --offsets"
    )
    return Notice(
        "sync.clock_off",
        "warning",
        text,
        {"camera": camera, "device": camera, "offset_s": offset / SECOND, "views": count},
    )
