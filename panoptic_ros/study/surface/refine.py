"""The study `refine`: the value of surface motion, on a capture with ground truth."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.domain import PatchTrajectories
from panoptic_ros.domain.parts import HEAD_WORDS
from panoptic_ros.evaluation.refinement_scores import refinement_scores
from panoptic_ros.evaluation.surface import association_scores
from panoptic_ros.io.surface_truth import read_surface
from panoptic_ros.running.plans.parameters import read_parameters
from panoptic_ros.stage import Progress, StageContext, part_of
from panoptic_ros.study.options import add_capture, add_seeds, add_settings
from panoptic_ros.study.study import Case, Column, Result, Row, Study
from panoptic_ros.study.surface.refine_depth import free_space, transforms
from panoptic_ros.study.surface.refine_ways import (
    FILTERS,
    PoseSequence,
    RefinementInputs,
    offline,
    paper,
    play,
    smoothed,
)

LAGS = (0.0, 0.12, 1.0)  # s, of the smoother


class SurfaceStudy(Study):
    """Base of the studies of a capture with its truth, whose surface is followed."""

    @classmethod
    def add_options(cls, parser: argparse.ArgumentParser) -> None:
        """See `Study`."""
        add_capture(parser, "capture folder with its truth")
        parser.add_argument(
            "--depth",
            choices=("none", "given", "kinect"),
            default="given",
            help="depth maps of the capture: unused (none), unchanged (given, default), or, for simulated "
            "ones, with the noise of a sensor (kinect)",
        )
        add_seeds(parser, "0")
        add_settings(parser)

    def played(self, progress: Progress) -> RefinementInputs:
        """Run the capture; the first seed draws the noise of the depth sensors."""
        given = self.options
        settings, seed = read_parameters(None, given.settings), given.seeds.start
        return play(given.capture, given.cameras, settings, given.depth, seed, part_of(progress, 0.0, 0.9))


class RefinementStudy(SurfaceStudy):
    """A capture is run once and smoothed in every way; rows go without depth maps unless they say so.

    Rows with depth maps have "depth" in their names.
    """

    columns = (
        Column("method", "method"),
        Column("lag", "lag s"),
        Column("acceleration_error", "acc m/s2", ".2f"),
        Column("mpjpe_mm", "MPJPE mm", ".1f"),
        Column("offset_free_mm", "offset-free mm", ".2f"),
        Column("offset_free_p95_mm", "p95", ".1f"),
        Column("fast_mm", "> 1 m/s", ".2f"),
        Column("pck_10cm", "PCK 10 cm", ".4f"),
    )

    def measure(self, case: Case, progress: Progress) -> list[Row]:
        """See `Study`."""
        folder, sensed = self.options.capture, self.played(progress)
        played = sensed.without_maps()
        patches = played.patches()
        ways: dict[str, tuple[RefinementInputs, Sequence[PatchTrajectories]]] = {
            "smoother": (played, ()),
            "smoother, patches": (played, patches),
        }
        pairs = played.pairs(played.raw)
        self.motions = {"images": patch_scores(folder, played, patches)}
        if sensed.maps:
            seen = sensed.patches()
            ways["smoother, patches, depth"] = sensed, seen
            self.motions["depth"] = patch_scores(folder, sensed, seen)
            names = [name.lower() for name in played.truth.joint_names]
            face = np.array([any(word in name for word in HEAD_WORDS) for name in names])
            self.motions["depth"] |= free_space(sensed.rig, sensed.maps, pairs, face)
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
        return rows

    def summary(self, rows: list[Row]) -> dict[str, Any]:
        """See `Study`."""
        return {"capture": str(self.options.capture), "motions": self.motions}

    def lines(self, result: Result) -> Iterator[str]:
        """See `Study`."""
        yield from super().lines(result)
        for name, own in result["motions"].items():
            yield (
                f"parts, by {name}: joints propagated over one instant err by {own['t_median_mm']:.1f} mm "
                f"(median), {own['t_p90_mm']:.1f} mm (90 %), for {own['t_available']:.1%} of them"
            )
            if "on_part" in own:
                yield (
                    f"patches, by {name}: {own['on_part']:.3f} are on the right part, "
                    f"{own['wrong_person']:.2%} on somebody else, {own['off_body']:.2%} on nobody"
                )
            if "free_true" in own:
                yield (
                    f"free space: {own['free_true']:.2%} of true and {own['free_measured']:.2%} of good "
                    f"measured joints taken for outliers, {own['free_outliers']:.0%} of those that are 15 cm "
                    "off found"
                )


def lag_shown(lag: float | None) -> str:
    """Return the lag (s) of a row as text; "all" = the whole recording."""
    return "all" if lag is None else f"{lag:.2f}"


def patch_scores(
    folder: Path, played: RefinementInputs, patches: Sequence[PatchTrajectories]
) -> dict[str, float]:
    """Score the motions of body parts, and the association of patches if the folder has the true surface.

    The motions are scored on the true joints that they propagate.
    """
    context, pairs = StageContext(played.rig, played.skeleton), played.pairs(played.raw)
    found = transforms(patches, pairs, context, played.truth_order)
    surface = read_surface(folder)
    return found if surface is None else found | association_scores(patches, pairs, surface, played.skeleton)


def _row(method: str, lag: float | None, items: PoseSequence, played: RefinementInputs) -> dict[str, Any]:
    scores = refinement_scores(played.pairs(items), played.truth.joint_names)
    return {"method": method, "lag_s": lag, "lag": lag_shown(lag), **scores}
