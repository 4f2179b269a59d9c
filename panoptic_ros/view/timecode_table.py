"""Timecode read from a recording, as a text table and as a JSON document."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from typing import Any

from panoptic_ros.domain import TimecodeReading
from panoptic_ros.io.user_bits import date_of

FORMAT = "panoptic-ltc-1"


def readings_document(sample_rate: int, readings: Sequence[TimecodeReading]) -> dict[str, Any]:
    """Return the document of `panoptic ltc decode --json`; see docs/time.md."""
    rate = float(readings[-1].timecode.rate.exact) if readings else None
    frames = [
        {
            "timecode": str(r.timecode),
            "start_sample": r.start_sample,
            "std_samples": r.std_samples,
            "reverse": r.reverse,
            "user_bits": f"{r.user_bits:08x}",
        }
        for r in readings
    ]
    return {"format": FORMAT, "rate_hz": sample_rate, "frame_rate": rate, "frames": frames}


def readings_table(sample_rate: int, readings: Sequence[TimecodeReading]) -> str:
    """Return a text table: one line per LTC word, the frame rate, and the date in the user bits, if any."""
    lines = [f"{'timecode':11}  {'start_sample':>14}  {'seconds':>12}  {'std us':>7}  user bits"]
    for r in readings:
        seconds, std = r.start_sample / sample_rate, 1e6 * r.std_samples / sample_rate
        back = "  reverse" if r.reverse else ""
        lines.append(
            f"{r.timecode!s:11}  {r.start_sample:14.3f}  {seconds:12.7f}  {std:7.3f}  {r.user_bits:08x}{back}"
        )
    rate = readings[-1].timecode.rate
    drop = " drop-frame" if rate.drop_frame else ""
    lines.append(f"{len(readings)} words at {float(rate.exact):.5g} Hz{drop}")
    found = date_of(readings[-1].user_bits)
    if found is not None:
        zone = "" if found.zone is None else f", zone {_zone(found.zone)}"
        lines.append(f"as a date (SMPTE ST 309) the user bits mean {found.date.isoformat()}{zone}")
    return "\n".join(lines)


def _zone(zone: datetime.timedelta) -> str:
    minutes = round(zone.total_seconds() / 60.0)
    return f"{'-' if minutes < 0 else '+'}{abs(minutes) // 60:02d}:{abs(minutes) % 60:02d}"
