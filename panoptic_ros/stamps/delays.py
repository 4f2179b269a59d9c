"""Parses delays of timestamps, which may drift, from parameters."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from panoptic_ros.domain import StampLine
from panoptic_ros.errors import ConfigError, shown
from panoptic_ros.params import named_words
from panoptic_ros.params.named import ALL

NO_DELAY = StampLine(0, 0)


def named_delays(where: str, entries: Iterable[str]) -> dict[str, StampLine]:
    """Return {camera: delay} from entries "camera=ms" or "camera=ms,ppm,reference_ns"; "*" = all others.

    A delay with a drift (ppm) has its value at the timestamp `reference_ns`.

    Args:
        where: name of the parameter, for the message.

    Raises:
        ConfigError: for an entry of another form, a repeated name, or a value that is not a finite number.
    """
    return {name: _line(where, name, word) for name, word in named_words(where, entries).items()}


def delay_of(delays: Mapping[str, StampLine], name: str) -> StampLine:
    """Return the delay of a camera, else that of "*", else none."""
    return delays.get(name, delays.get(ALL, NO_DELAY))


def delay_entry(name: str, line: StampLine) -> str:
    """Return the entry of a camera, which `named_delays` reads."""
    ms = f"{name}={1e-6 * line.offset_ns:.4f}"
    return f"{ms},{1e6 * line.drift:.6g},{line.reference_ns}" if line.drift else ms


def _line(where: str, name: str, word: str) -> StampLine:
    parts = word.split(",")
    try:
        numbers = [float(part) for part in parts[:2]]
        reference = int(parts[2]) if len(parts) == 3 else 0
    except ValueError:
        numbers = [math.nan]
    if len(parts) not in (1, 3) or not all(math.isfinite(number) for number in numbers):
        raise ConfigError(f"{where}: {shown(word)} of {shown(name)} is not a number, nor ms,ppm,reference_ns")
    return StampLine(reference, round(1e6 * numbers[0]), numbers[1] / 1e6 if len(parts) == 3 else 0.0)
