"""The study `terms`: leave out one term or input at a time, compared with the paper's solver.

The study repeats Table 3 of Malleson et al. 2020, and varies the weight of accelerations (Fig. 9).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from panoptic_ros.io.files import write_bytes
from panoptic_ros.kinematics.pose.prior import PoseStatistics
from panoptic_ros.running.kinematics import PAPER, body_config
from panoptic_ros.stage import Progress, each
from panoptic_ros.study.bodies.cases import METHODS, OURS, SAME_PEOPLE, BodyCase, BodyStudy
from panoptic_ros.study.study import Case, Result, Row, shared_out

Array = np.ndarray
FREE = 1e6  # standard deviation so large that a term has no effect
TWELVE = tuple(s + n for s in "lr" for n in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle"))
FULL = "all"


def without_orientations(case: BodyCase) -> BodyCase:
    """Remove the orientations of IMUs; without them, world-frame accelerations are lost too."""
    devices = {
        name: replace(series, quaternions=np.full_like(series.quaternions, np.nan))
        for name, series in case.recording.devices.items()
    }
    return replace(case, recording=replace(case.recording, devices=devices))


def without_accelerations(case: BodyCase) -> BodyCase:
    """Remove the accelerations of IMUs; only orientations remain."""
    devices = {
        name: replace(series, forces=np.full_like(series.forces, np.nan))
        for name, series in case.recording.devices.items()
    }
    return replace(case, recording=replace(case.recording, devices=devices))


def without_projection(case: BodyCase) -> BodyCase:
    """Allow poses at any distance from the subspace of the prior."""
    given = case.statistics
    values, axes = np.linalg.eigh(given.projection)
    rest = axes[:, values > 0.5]
    components = np.ascontiguousarray(np.hstack([given.components, rest]))
    deviations = np.r_[given.deviations, np.full(rest.shape[1], FREE)]
    return replace(case, statistics=PoseStatistics(given.mean, components, deviations, given.spreads))


def without_deviation(case: BodyCase) -> BodyCase:
    """Allow any pose within the subspace of the prior."""
    given = case.statistics
    return replace(case, statistics=replace(given, deviations=np.full_like(given.deviations, FREE)))


def with_keypoints(names: Sequence[str], calibrated: bool) -> Callable[[BodyCase], BodyCase]:
    """Return a change that keeps only these joints of the detector (empty = all).

    Args:
        calibrated: use the calibrated joint offsets; False = the nominal ones.
    """

    def change(case: BodyCase) -> BodyCase:
        subjects = []
        for subject in case.subjects:
            own = subject.body.keypoints
            usual = case.model.body(subject.stature).keypoints
            kept = {n: own[n] if calibrated else usual[n] for n in own if not names or n in names}
            subjects.append(replace(subject, body=replace(subject.body, keypoints=kept)))
        return replace(case, subjects=tuple(subjects))

    return change


CHANGES: dict[str, Callable[[BodyCase], BodyCase]] = {
    FULL: lambda case: case,
    "no orientations": without_orientations,
    "no accelerations": without_accelerations,
    "no 2D joints": lambda case: case.with_inputs(0, 13),
    "no projection": without_projection,
    "no deviation": without_deviation,
    "no prior": lambda case: without_deviation(without_projection(case)),
    "25 keypoints, nominal": with_keypoints((), False),
    "12 keypoints": with_keypoints(TWELVE, True),
    "12 keypoints, nominal": with_keypoints(TWELVE, False),
}
SETTINGS: dict[str, dict[str, tuple[str, ...]]] = {  # by method
    OURS: {
        "instants alone": ("window=false",),
        "mounting as stated": ("mounting=false",),
        "no Cauchy": ("joint_scale=0", "prior_scale=0"),
        "no hinges": ("hinge_sd=1000",),
        "noise of 2D joints as assumed": ("noise_level=false",),
        "joints weigh as their scores": ("score_power=1",),
        "errors are new at each instant": ("error_time=0.0167",),
        "no errors that last": ("lasting_share=0",),
        "lag 0": ("lag=0",),
    }
    | {f"acceleration {sd:g} m/s^2": (f"acceleration_sd={sd:g}",) for sd in (0.5, 1.0, 4.0, 8.0)},
    PAPER: {f"acceleration {w:g}": (f"paper_acceleration={w:g}",) for w in (1e-6, 1e-5, 1e-4, 1e-3)},
}


class Terms(BodyStudy):
    """Errors of both methods on each capture with each change."""

    has_plot = True

    def measure(self, case: Case, progress: Progress) -> Iterator[Row]:
        """See `Study`."""
        capture = self.capture(case)
        presets = {OURS: ("", tuple(self.options.settings)), PAPER: (PAPER, (SAME_PEOPLE,))}
        for method, told in zip(METHODS, shared_out(progress, [1.0] * len(METHODS))):
            preset, given = presets[method]
            todo = [(name, change(capture), given) for name, change in CHANGES.items()]
            todo += [(name, capture, (*given, *more)) for name, more in SETTINGS[method].items()]
            for name, changed, values in each(todo, len(todo), told, method):
                kind = {"scene": capture.name, "seed": capture.seed, "method": method, "change": name}
                yield kind | changed.score(body_config(preset, values))

    def lines(self, result: Result) -> Iterator[str]:
        """Yield the table: means over the captures, and the change relative to all terms."""
        yield f"{self.head(result)}; means"
        yield (
            f"{'method':<15}{'change':<32}{'mm':>8}{'after root':>12}{'deg':>8}{'m/s^2':>8}{'in 95 %':>9}   "
            "mm, deg against all"
        )
        rows = result["rows"]
        for method in METHODS:
            full = _means([row for row in rows if (row["method"], row["change"]) == (method, FULL)])
            for name in dict.fromkeys(row["change"] for row in rows if row["method"] == method):
                means = _means([row for row in rows if (row["method"], row["change"]) == (method, name)])
                cells = f"{means[0]:>8.1f}{means[1]:>12.1f}{means[2]:>8.2f}{means[3]:>8.1f}"
                cells += f"{means[4]:>9.3f}" if np.isfinite(means[4]) else f"{'-':>9}"
                share = [100.0 * (means[k] / full[k] - 1.0) for k in (0, 2)]
                yield f"{method:<15}{name:<32}{cells}   {share[0]:+.0f} %, {share[1]:+.0f} %"

    def plot(self, path: Path, result: Result) -> None:
        """See `Study`."""
        # imported here because matplotlib is slow to load
        from panoptic_ros.view.term_study_plot import term_study_plot

        write_bytes(path, term_study_plot(result["rows"], FULL))


def _means(rows: list[dict[str, Any]]) -> list[float]:
    keys = ("mm", "relative_mm", "deg", "acc", "inside")
    return [float(np.mean([row[key] for row in rows])) for key in keys]
