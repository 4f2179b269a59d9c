"""`panoptic evaluate --study refine`: what the motion of the surface is worth on a capture with truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import PatchTrajectories
from panoptic_ros.domain.parts import HEAD_WORDS
from panoptic_ros.evaluation.refinement_scores import refinement_scores
from panoptic_ros.evaluation.surface import association_scores
from panoptic_ros.io.surface_truth import read_surface
from panoptic_ros.running.plans.parameters import Parameters
from panoptic_ros.running.studies.refine_depth import free_space, transforms
from panoptic_ros.running.studies.refine_ways import FILTERS, Played, Posed, offline, paper, play, smoothed
from panoptic_ros.stage import Progress, StageContext

LAGS = (0.0, 0.12, 1.0)  # s


def study_refinement(
    folder: Path, cameras: Sequence[str], settings: Parameters, depth: str, seed: int, progress: Progress
) -> dict[str, Any]:
    """Figures of every method and lag, for JSON.

    Args:
        folder: a capture folder with its truth. cameras: only these; empty = all.
        settings: {stage: {parameter: value}}, for all methods.
        depth, seed: see `play`; rows whose name does not say so go without depth maps.

    Raises:
        UsageError: if the folder has no truth, or is no capture.
    """
    sensed = play(folder, cameras, settings, depth, seed, progress)
    played = sensed.without_maps()
    patches = played.patches()
    ways: dict[str, tuple[Played, Sequence[PatchTrajectories]]] = {
        "smoother": (played, ()),
        "smoother, patches": (played, patches),
    }
    pairs = played.pairs(played.raw)
    told = {"images": patch_scores(folder, played, patches)}
    if sensed.maps:
        seen = sensed.patches()
        ways["smoother, patches, depth"] = sensed, seen
        told["depth"] = patch_scores(folder, sensed, seen)
        names = [name.lower() for name in played.truth.joint_names]
        face = np.array([any(word in name for word in HEAD_WORDS) for name in names])
        told["depth"] |= free_space(sensed.rig, sensed.maps, pairs, face)
    progress(0.9, "smoothing")
    rows = [_row("none", 0.0, played.raw, played)]
    rows += [_row(name, lag, way(played.raw), played) for name, (lag, way) in FILTERS.items()]
    for lag in LAGS:
        rows += [_row(name, lag, smoothed(own, lag, found), own) for name, (own, found) in ways.items()]
    for name, (own, _) in list(ways.items())[1:]:
        words = name.partition(", ")[2]
        averaged, rounds = paper(own)
        rows.append(_row(f"averaging, {words}", None, averaged, own) | {"rounds": rounds})
        rows.append(_row(f"offline, {words}", None, offline(own), own))
    progress(1.0, "scoring")
    used = list(played.rig.names)
    return {"study": "refine", "capture": str(folder), "cameras": used, "rows": rows, "motions": told}


def study_lines(result: Mapping[str, Any]) -> list[str]:
    """The figures as a table."""
    lines = [
        f"refinement of {result['capture']}, {len(result['cameras'])} cameras",
        f"{'method':26} {'lag s':>6} {'acc m/s2':>9} {'MPJPE mm':>9} {'offset-free mm':>15} {'p95':>6} "
        f"{'> 1 m/s':>8} {'PCK 10 cm':>10}",
    ]
    for row in result["rows"]:
        lines.append(
            f"{row['method']:26} {lag_shown(row['lag_s']):>6} {row['acceleration_error']:9.2f} "
            f"{row['mpjpe_mm']:9.1f} {row['offset_free_mm']:15.2f} {row['offset_free_p95_mm']:6.1f} "
            f"{row['fast_mm']:8.2f} {row['pck_10cm']:10.4f}"
        )
    for name, own in result["motions"].items():
        lines.append(
            f"parts, by {name}: joints carried over one instant err by {own['t_median_mm']:.1f} mm (median), "
            f"{own['t_p90_mm']:.1f} mm (90 %), for {own['t_available']:.1%} of them"
        )
        if "on_part" in own:
            lines.append(
                f"patches, by {name}: {own['on_part']:.3f} are on the right part, "
                f"{own['wrong_person']:.2%} on somebody else, {own['off_body']:.2%} on nobody"
            )
        if "free_true" in own:
            lines.append(
                f"free space: {own['free_true']:.2%} of true and {own['free_measured']:.2%} of good measured "
                f"joints taken for outliers, {own['free_outliers']:.0%} of those that are 15 cm off found"
            )
    return lines


def lag_shown(lag: float | None) -> str:
    """Of a row."""
    return "all" if lag is None else f"{lag:.2f}"


def patch_scores(folder: Path, played: Played, patches: Sequence[PatchTrajectories]) -> dict[str, float]:
    """How well motions of parts carry true joints, and how many patches are on the right part if the folder
    tells where the surface is."""
    context, pairs = StageContext(played.rig, played.skeleton), played.pairs(played.raw)
    found = transforms(patches, pairs, context, played.truth_order)
    surface = read_surface(folder)
    return found if surface is None else found | association_scores(patches, pairs, surface, played.skeleton)


def _row(method: str, lag: float | None, items: Posed, played: Played) -> dict[str, Any]:
    scores = refinement_scores(played.pairs(items), played.truth.joint_names)
    return {"method": method, "lag_s": lag, **scores}
