"""The study `refine-faults`: refine true joints with noise, outliers and gaps, using surface motion.

The surface motion comes from a capture's images. 2D tracks and identities are those of a run on the capture.
The views of a person are those of the run too; their 2D poses still contain the wrists that are missing in
the gaps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from panoptic_ros.domain import JointState, TrackedPoseSet
from panoptic_ros.domain.parts import HEAD_WORDS
from panoptic_ros.evaluation.motion_scores import acceleration_error
from panoptic_ros.params import config_of
from panoptic_ros.refinement.config import RefinementConfig
from panoptic_ros.simulation.skeleton_faults import FaultyJoints, with_faults
from panoptic_ros.stage import Progress, each, part_of
from panoptic_ros.study.study import Case, Column, Result, Row
from panoptic_ros.study.surface.refine import SurfaceStudy, lag_shown
from panoptic_ros.study.surface.refine_ways import (
    FILTERS,
    PoseSequence,
    RefinementInputs,
    offline,
    paper,
    smoothed,
)

Array = np.ndarray
LAGS = (0, 2, 5)  # frames
Rows = dict[tuple[str, float | None], dict[str, float | None]]  # by method and lag (s)


class RefineFaults(SurfaceStudy):
    """Figures of every method and lag; each seed draws other faults."""

    columns = (
        Column("method", "method"),
        Column("lag", "lag s"),
        Column("mpjpe_mm", "MPJPE mm", ".2f"),
        Column("p95_mm", "p95", ".1f"),
        Column("acceleration_error", "acc m/s2", ".2f"),
        Column("gap_mm", "in gaps mm", ".1f"),
        Column("worst_gap_mm", "worst", ".1f"),
        Column("unfilled", "unfilled", ".1%"),
    )
    over = ("method", "lag")

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        seeds, sensed = self.options.seeds, self.played(progress)
        ways = [sensed.without_maps(), *([sensed] if sensed.maps else [])]
        for seed in each(seeds, len(seeds), part_of(progress, 0.9, 1.0), "smoothing"):
            rows: Rows = {}
            for way in ways:
                _one(way, seed, "depth" if way.maps else "images", rows)
            for (method, lag), scores in rows.items():
                yield {"method": method, "lag_s": lag, "lag": lag_shown(lag), "seed": seed, **scores}

    def head(self, result: Result) -> str:
        """See `Study`."""
        return (
            f"{self.options.capture}: true joints with 20 mm noise, 5 % outliers of 15 cm, gaps of the "
            f"wrists of 5 to 15 instants; {len(self.options.seeds)} seeds"
        )


def _one(played: RefinementInputs, seed: int, kind: str, rows: Rows) -> None:
    """Add the figures of a seed to the rows."""
    faulty, played = _with_faults(played, seed)
    patches = played.patches()
    period = 1e-9 * float(np.median(np.diff([item.stamp_ns for item in played.raw])))

    def add(method: str, lag: float | None, items: PoseSequence) -> None:
        rows[method, lag] = _scores(played, faulty, items)

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


def _with_faults(played: RefinementInputs, seed: int) -> tuple[FaultyJoints, RefinementInputs]:
    """Return joints with simulated faults, and the run with these joints instead of the measured joints."""
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
    # true joints do not have the detector's biases
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


def _scores(played: RefinementInputs, faulty: FaultyJoints, items: PoseSequence) -> dict[str, float | None]:
    """Score the joints of the body, and those in gaps separately.

    Returns:
        errors in mm, acceleration error in m/s^2, and the share of joints in gaps that stay missing.
    """
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
    """Return the mean of the known values; None if there is none."""
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
