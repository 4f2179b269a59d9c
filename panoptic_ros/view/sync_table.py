"""Text table of a sync report, the report about the clocks of a capture."""

from __future__ import annotations

from typing import Any

UNSEEN = (
    "stamps cannot show constant errors, e.g. a latency of 30 ms; if people move, `panoptic solve "
    "--offsets-from-motion` finds them (live: offsets.active)"
)


def sync_table(document: dict[str, Any]) -> list[str]:
    """Return a sync report as text lines: cameras, timecode devices, aligned recordings, sets, notices."""
    lines: list[str] = []
    if document["cameras"]:
        width = max(6, *(len(row["camera"]) for row in document["cameras"]))
        lines.append(
            f"{'camera':{width}} {'frames':>6} {'fps':>9} {'off ppm':>8} {'phase ms':>8} {'jitter ms':>9} "
            f"{'late p99':>8} {'lost':>5} {'gaps':>5} {'beat ms':>7}"
        )
    for row in document["cameras"]:
        phase = "-" if row["phase_ms"] is None else f"{row['phase_ms']:.2f}"
        lines.append(
            f"{row['camera']:{width}} {row['frames']:6} {row['rate_hz']:9.4f} {row['off_ppm']:8.0f} "
            f"{phase:>8} "
            f"{row['jitter_ms']:9.3f} {row['late_p99_ms']:8.2f} {row['lost']:5} {row['gaps']:5} "
            f"{row['beat_ms']:7.2f}"
        )
    for row in document["devices"]:
        lines.append(
            f"{row['device']}: master time is its clock {row['offset_s']:+.6f} s, drift "
            f"{row['drift_ppm']:+.3f} +- "
            f"{row['drift_std_ppm']:.3f} ppm, +- {row['std_us']:.2f} us at its last word"
        )
    for row in document["aligned"]:
        lines.append(
            f"{row['recording']}: channel 0 is {row['offset_s']:+.7f} s ahead of channel 1, drift "
            f"{row['drift_ppm']:+.4f} ppm, +- {row['std_us']:.2f} us"
        )
    grouping = document["grouping"]
    if grouping:
        lines.append(
            f"sync: {grouping['sets']} sets of {grouping['views_per_set']:.2f} views, {grouping['used']} of "
            f"{grouping['frames']} frames used, {grouping['used_twice']} twice; "
            f"{grouping['away_ms_mean']:.2f} ms "
            f"from their set's instant on average, {grouping['away_ms_max']:.1f} at most"
        )
    lines += [f"{note['severity']}: {note['text']}" for note in document["notices"]]
    if not document["notices"]:
        lines.append("the stamps show no fault of these clocks")
    if grouping:
        lines.append(UNSEEN)
    return lines
