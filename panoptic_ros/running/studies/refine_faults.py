"""`panoptic evaluate --study refine-faults`: true joints with noise, outliers and gaps, refined with the
motion of the surface in a capture's images.

2D tracks and identities are those of a run on the capture; so are the views of a person, whose 2D people
still show the wrists that are missing here.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import JointState, TrackedPoseSet
from panoptic_ros.domain.parts import HEAD_WORDS
from panoptic_ros.evaluation.motion_scores import acceleration_error
from panoptic_ros.params import config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.studies.refine import lag_shown
from panoptic_ros.running.studies.refine_ways import FILTERS, Played, Posed, offline, paper, play, smoothed
from panoptic_ros.simulation.skeleton_faults import Faulty, with_faults
from panoptic_ros.stage import Progress

Array = np.ndarray
LAGS = (0, 2, 5)  # frames
Rows = dict[tuple[str, float | None], list[dict[str, float | None]]]  # of each seed, by method and lag


def study_faults(
    folder: Path,
    cameras: Sequence[str],
    settings: Parameters,
    depth: str,
    seeds: Sequence[int],
    progress: Progress,
) -> dict[str, Any]:
    """Figures of every method and lag, means over the seeds, for JSON; the rest as for `study_refinement`."""
    sensed = play(folder, cameras, settings, depth, seeds[0], progress)
    rows: Rows = {}
    for number, seed in enumerate(seeds):
        for way in [sensed.without_maps(), *([sensed] if sensed.maps else [])]:
            _one(way, seed, "depth" if way.maps else "images", rows)
        progress(0.8 + 0.2 * (number + 1) / len(seeds), "smoothing")
    means = [
        {"method": method, "lag_s": lag} | {name: _mean([row[name] for row in found]) for name in found[0]}
        for (method, lag), found in rows.items()
    ]
    for mean, found in zip(means, rows.values()):
        worst = [row["worst_gap_mm"] for row in found if row["worst_gap_mm"] is not None]
        mean["worst_gap_mm"] = max(worst, default=None)
    return {"study": "refine-faults", "capture": str(folder), "seeds": list(seeds), "rows": means}


def _one(played: Played, seed: int, kind: str, rows: Rows) -> None:
    """Add the figures of a seed."""
    faulty, played = _with_faults(played, seed)
    patches = played.patches()
    period = 1e-9 * float(np.median(np.diff([item.stamp_ns for item in played.raw])))

    def add(method: str, lag: float | None, items: Posed) -> None:
        rows.setdefault((method, lag), []).append(_scores(played, faulty, items))

    if kind == "images":
        add("none", 0.0, played.raw)
        for name, (lag, way) in FILTERS.items():
            add(name, lag, way(played.raw))
        for frames in LAGS:
            add("smoother", frames * period, smoothed(played, frames * period, ()))
    for frames in LAGS:
        add(f"patches, {kind}", frames * period, smoothed(played, frames * period, patches))
    add(f"averaging, {kind}", None, paper(played)[0])
    add(f"offline, {kind}", None, offline(played))


def _with_faults(played: Played, seed: int) -> tuple[Faulty, Played]:
    """The run with true joints that have faults in place of those that were measured."""
    pairs, order = {pair.stamp_ns: pair for pair in played.pairs(played.raw)}, played.truth_order
    truth: list[Mapping[int, Array]] = []
    for item in played.raw:
        pair = pairs.get(item.stamp_ns)
        own = (
            {}
            if pair is None
            else {
                number: pair.truth[row][order] for (_, number), (row, _) in zip(pair.match_ids, pair.matches)
            }
        )
        truth.append({number: places for number, places in own.items() if number in item.ids.tolist()})
    faulty = with_faults(truth, played.skeleton.joint_names, seed)
    raw = [_posed(item, joints, faulty.covariance) for item, joints in zip(played.raw, faulty.joints)]
    # the detector's biases are not those of true joints
    none = replace(config_of(played.plan.configs, RefinementConfig), bias_floor=0.0)
    plan = replace(played.plan, configs={**played.plan.configs, "refinement": none})
    return faulty, replace(played, raw=raw, plan=plan)


def _posed(item: TrackedPoseSet, joints: Mapping[int, Array], covariance: Array) -> TrackedPoseSet:
    positions = np.full(item.positions.shape, np.nan)
    for row, number in enumerate(item.ids.tolist()):
        positions[row] = joints.get(number, np.nan)
    there = np.isfinite(positions[..., 0])
    states = np.where(there, np.uint8(JointState.MEASURED), np.uint8(JointState.MISSING))
    return replace(
        item,
        positions=positions,
        covariances=np.where(there[..., None, None], covariance, np.nan),
        scores=there.astype(float),
        views=np.where(there, 3, 0),
        states=states,
    )


def _scores(played: Played, faulty: Faulty, items: Posed) -> dict[str, float | None]:
    """Errors in mm of joints of the body, of those in gaps, and the share of these that stay missing."""
    numbers = {item.stamp_ns: k for k, item in enumerate(played.raw)}
    names, true_names = played.skeleton.joint_names, played.truth.joint_names
    own_number = {name: joint for joint, name in enumerate(names)}
    body = [not any(word in name.lower() for word in HEAD_WORDS) for name in true_names]
    errors, gaps, missing = [np.zeros(0)], [], 0
    pairs = played.pairs(items)
    for pair in pairs:
        for (_, number), (row, column) in zip(pair.match_ids, pair.matches):
            off = 1e3 * np.linalg.norm(pair.result[column] - pair.truth[row], axis=-1)
            errors.append(off[np.isfinite(off) & body])
            for joint in np.flatnonzero(body).tolist():
                if (numbers[pair.stamp_ns], number, own_number[true_names[joint]]) in faulty.gaps:
                    gaps.append(off[joint])
                    missing += int(np.isnan(off[joint]))
    every, known = np.concatenate(errors), [value for value in gaps if np.isfinite(value)]
    return {
        "mpjpe_mm": float(every.mean()),
        "p95_mm": float(np.quantile(every, 0.95)),
        "acceleration_error": acceleration_error(pairs),
        "gap_mm": _mean(known),
        "worst_gap_mm": max(known, default=None),
        "unfilled": missing / max(len(gaps), 1),
    }


def _mean(values: Sequence[float | None]) -> float | None:
    """Of those that are known; None if none is."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None


def fault_lines(result: Mapping[str, Any]) -> list[str]:
    """The figures as a table."""
    lines = [
        f"{result['capture']}: true joints with 20 mm noise, 5 % outliers of 15 cm, gaps of the wrists of "
        f"5 to 15 instants; {len(result['seeds'])} seeds",
        f"{'method':20} {'lag s':>6} {'MPJPE mm':>9} {'p95':>6} {'acc m/s2':>9} {'in gaps mm':>11} "
        f"{'worst':>6} {'unfilled':>9}",
    ]
    for row in result["rows"]:
        gaps = row["gap_mm"], row["worst_gap_mm"]
        mean, worst = ("-" if value is None else f"{value:.1f}" for value in gaps)
        lines.append(
            f"{row['method']:20} {lag_shown(row['lag_s']):>6} {row['mpjpe_mm']:9.2f} {row['p95_mm']:6.1f} "
            f"{row['acceleration_error']:9.2f} {mean:>11} {worst:>6} {row['unfilled']:9.1%}"
        )
    return lines
