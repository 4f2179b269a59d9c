"""Parts of a long recording that are used to estimate constant values."""

from __future__ import annotations

import numpy as np

Array = np.ndarray
Span = tuple[int, int]  # ns, the end is exclusive
WINDOWS, WINDOW_S = 12, 6.0  # number of windows used in a long capture, and their length in s


def telling_spans(stamps: Array, people: Array) -> list[Span]:
    """Return the time spans used for the estimate: all of a short capture, or windows of a long one.

    A long capture is cut into equal parts. Each part gives the window with the most 2D poses.

    Args:
        stamps: (N,) ns, timestamps of the sets, at least one.
        people: (N,) number of 2D poses in each set.
    """
    first_ns, last_ns = int(stamps[0]), int(stamps[-1])
    if 1e-9 * (last_ns - first_ns) <= WINDOWS * WINDOW_S:
        return [(first_ns, last_ns + 1)]
    length = round(1e9 * WINDOW_S)
    total = np.concatenate([[0], np.cumsum(people)])
    seen = total[np.searchsorted(stamps, stamps + length)] - total[np.arange(len(stamps))]
    borders = np.linspace(stamps[0], stamps[-1], WINDOWS + 1)
    chosen: list[Span] = []
    first = 0
    for border in borders[1:]:
        last = int(np.searchsorted(stamps, border - 1e9 * WINDOW_S))
        if last > first:
            begin = int(stamps[first + int(seen[first:last].argmax())])
            chosen.append((begin, begin + length))
        first = int(np.searchsorted(stamps, border))
    return chosen
