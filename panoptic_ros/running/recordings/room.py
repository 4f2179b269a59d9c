"""How much of a recording the disk has room for."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from pathlib import Path

from panoptic_ros.errors import EnvironmentProblem
from panoptic_ros.io.bag_split import GB
from panoptic_ros.running.recordings.options import RecordOptions


def told_room(path: Path, rates: Mapping[str, float], options: RecordOptions) -> str:
    """What the disk has room for, in one line.

    Args:
        path: of the recording. rates: bytes per second by topic.

    Raises:
        EnvironmentProblem: if the time that is asked for does not fit.
    """
    total = sum(rates.values())
    place = next(p for p in (path, *path.resolve().parents) if p.exists())
    free = shutil.disk_usage(place).free - options.keep_free_gb * GB
    room = min(free, options.budget_gb * GB) if options.budget_gb else free
    line = f"{total / 1e6:.2f} MB/s on {len(rates)} topics, {3600 * total / GB:.1f} GB an hour"
    if not total:
        return f"nothing comes yet on the topics; room for {room / GB:.1f} GB"
    seconds = room / total
    if options.duration_s is not None and seconds < options.duration_s:
        raise EnvironmentProblem(
            f"{options.duration_s:g} s need {options.duration_s * total / GB:.2f} GB, but there is room for "
            f"{max(0.0, room) / GB:.2f} GB ({line}); free some, or use --no-images, --topic, --keep-free"
        )
    largest = max(rates, key=lambda topic: rates[topic])
    return f"{line} (most of it {largest}); room for {room / GB:.1f} GB, {seconds / 3600:.1f} h"
