"""Whether the cameras of a recording saw anything at the same time, by what their clocks say."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from panoptic_ros.errors import DataError

SECOND = 1_000_000_000
DAY_S = 86_400


def check_overlap(
    shifts: Mapping[str, int], stamps: Mapping[str, Sequence[int]], heard: Mapping[str, object]
) -> None:
    """Recordings that never overlap hear timecodes that have nothing to do with each other.

    Args:
        shifts: of cameras, from their stamps to master time, ns.
        stamps: of each camera's frames, the first and the last among them, ns.
        heard: the sound that is used; without any nothing is known of the clocks.

    Raises:
        DataError: naming the cameras that belong together, and when.
    """
    if not heard:
        return
    spans = sorted(
        (own[0] + shifts.get(name, 0), own[-1] + shifts.get(name, 0), name) for name, own in stamps.items()
    )
    groups: list[list[tuple[int, int, str]]] = []
    for span in spans:
        if groups and span[0] <= max(end for _, end, _ in groups[-1]):
            groups[-1].append(span)
        else:
            groups.append([span])
    if len(groups) > 1:
        said = "; ".join(
            f"{', '.join(sorted(name for _, _, name in group))} from {_clock(group[0][0])} to "
            f"{_clock(max(end for _, end, _ in group))}"
            for group in groups
        )
        raise DataError(
            f"by the timecode that they hear, the recordings never overlap: {said}. Different "
            "generators? Give a recording that hears both and name them in sound.yaml, or leave cameras "
            "out (--cameras)"
        )


def _clock(stamp_ns: int) -> str:
    """A time of the day."""
    seconds = stamp_ns / SECOND % DAY_S
    return f"{int(seconds // 3600):02d}:{int(seconds // 60 % 60):02d}:{seconds % 60:04.1f}"
