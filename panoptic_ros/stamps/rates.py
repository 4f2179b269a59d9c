"""Rates in Hz as exact fractions."""

from __future__ import annotations

from fractions import Fraction


def exact_rate(rate_hz: float) -> Fraction:
    """Return the exact rate meant by a rounded one: 23.976, 29.97 and 59.94 are 24, 30 and 60 * 1000/1001."""
    television = Fraction(round(rate_hz * 1.001) * 1000, 1001)
    if abs(float(television) - rate_hz) < 1e-3:
        return television
    return Fraction(rate_hz).limit_denominator(10_000)
