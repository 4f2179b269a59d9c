"""`panoptic bench kinematics`: processor time of bodies, per solve and per instant."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from panoptic_ros.errors import UsageError
from panoptic_ros.stage import Progress

ABOUT = "bodies from cameras and IMUs: processor time per solve and per instant"
KINDS = ((8, 13), (4, 13), (4, 6), (1, 13), (8, 0), (0, 13))
LAGS = (0.0, 0.1)
SUBJECTS, RATE = 4, 60.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of this bench."""
    parser.add_argument("--seconds", type=float, default=6.0, metavar="S", help="of the capture (default 6)")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the capture")


def measure(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    """Solve a simulated capture from several mixes of cameras and IMUs.

    Raises:
        UsageError: if there is no capture of so many seconds.
    """
    from panoptic_ros.running.benches.body_costs import body_costs  # numba is slow to load

    if not 2.0 <= args.seconds <= 20.0:
        raise UsageError(f"--seconds {args.seconds} is not 2 to 20")
    rows = []
    for row in body_costs(args.seconds, args.seed, KINDS, LAGS):
        rows.append(row)
        progress(len(rows) / len(KINDS), f"{row['cameras']} cameras, {row['imus']} IMUs")
    worst = max(row[f"lag_{LAGS[-1]:g}_mean_ms"] for row in rows)
    return {"rows": rows, "share_of_core": 1e-3 * SUBJECTS * RATE * worst}


def lines(result: dict[str, Any]) -> Iterator[str]:
    """The table."""
    yield "processor time, ms: median (mean) per instant"
    yield "cameras IMUs   per solve  iterations      " + "      ".join(f"lag {lag:g} s" for lag in LAGS)
    for row in result["rows"]:
        steps = "  ".join(f"{row[f'lag_{g:g}_ms']:5.2f} ({row[f'lag_{g:g}_mean_ms']:.2f})" for g in LAGS)
        yield f"{row['cameras']:7} {row['imus']:4} {row['solve_ms']:11.3f} {row['iterations']:11.1f}  {steps}"
    share = 100.0 * result["share_of_core"]
    yield f"{SUBJECTS} subjects at {RATE:g} Hz, lag {LAGS[-1]:g} s, dearest of these: {share:.0f} % of a core"
