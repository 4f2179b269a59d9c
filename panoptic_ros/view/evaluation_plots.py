"""Plots of an evaluation: PCK curve, error by joint, error over time, identities over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from panoptic_ros.evaluation.identity_scores import found_ids
from panoptic_ros.evaluation.joint_scores import matched_distances, pck_curve
from panoptic_ros.evaluation.pairing import FramePair
from panoptic_ros.io.files import atomic_path
from panoptic_ros.view.plotting import Axes, Figure, FigureCanvasAgg

Draw = Callable[[Axes, Sequence[FramePair], Sequence[str]], None]
LARGEST = 0.15  # m; upper end of the PCK curve
COLOURS = 10  # number of colours in matplotlib's default cycle


def write_plots(folder: Path, pairs: Sequence[FramePair], joint_names: Sequence[str]) -> list[Path]:
    """Draw all plots as PNG into `folder` and return their paths.

    Raises:
        EnvironmentProblem: If a file cannot be written.
    """
    paths = []
    for name, draw in PLOTS.items():
        figure = Figure(figsize=(8.0, 4.5), dpi=110, layout="constrained")
        FigureCanvasAgg(figure)
        draw(figure.subplots(), pairs, joint_names)
        paths.append(Path(folder) / f"{name}.png")
        with atomic_path(paths[-1]) as temporary:
            figure.savefig(temporary)
    return paths


def draw_pck(axes: Axes, pairs: Sequence[FramePair], joint_names: Sequence[str]) -> None:
    """Draw the share of joints with an error below a threshold, for matched and for all true people."""
    thresholds = np.linspace(0.0, LARGEST, 151)
    for everybody, label, style in ((False, "matched people", "-"), (True, "everybody", "--")):
        curve = pck_curve(pairs, len(joint_names), thresholds, everybody)
        axes.plot(100 * thresholds, curve, style, label=label)
    axes.set(xlabel="threshold [cm]", ylabel="PCK", xlim=(0, 100 * LARGEST), ylim=(0, 1.02))
    axes.legend(loc="lower right")
    axes.grid(alpha=0.3)


def draw_joints(axes: Axes, pairs: Sequence[FramePair], joint_names: Sequence[str]) -> None:
    """Draw the error of every joint: median, quartiles as a box, 5th and 95th percentile as whiskers."""
    columns = [column[~np.isnan(column)] for column in matched_distances(pairs, len(joint_names)).T]
    axes.boxplot([1e3 * column for column in columns], whis=(5, 95), showfliers=False)
    axes.set_xticks(range(1, len(joint_names) + 1), joint_names, rotation=60, ha="right")
    axes.set(ylabel="error [mm]", ylim=(0, None))
    axes.grid(axis="y", alpha=0.3)


def draw_times(axes: Axes, pairs: Sequence[FramePair], joint_names: Sequence[str]) -> None:
    """Draw the mean joint error of every true person over time, with gaps at frames without a match."""
    times = _seconds(pairs)
    for number in _people(pairs):
        errors = np.full(len(pairs), np.nan)
        for i, pair in enumerate(pairs):
            for (who, _), mean in zip(pair.match_ids, pair.means):
                if who == number:
                    errors[i] = 1e3 * mean
        axes.plot(times, errors, marker=".", markersize=3, linewidth=1, label=f"person {number}")
    axes.set(xlabel="time [s]", ylabel="mean joint error [mm]", ylim=(0, None))
    axes.grid(alpha=0.3)
    if _people(pairs):
        axes.legend(ncols=4, fontsize="small")


def draw_identities(axes: Axes, pairs: Sequence[FramePair], joint_names: Sequence[str]) -> None:
    """Draw one row per true person: grey where missed, else coloured by the matched track id."""
    times, people = _seconds(pairs), _people(pairs)
    step = float(np.median(np.diff(times))) if len(times) > 1 else 1.0
    found = [found_ids(pair) for pair in pairs]
    for row, who in enumerate(people):
        there = [who in pair.truth_ids for pair in pairs]
        spans = [(time, step) for time, seen in zip(times, there) if seen]
        names = [ids.get(who) for ids, seen in zip(found, there) if seen]
        colours = ["0.88" if name is None else f"C{name % COLOURS}" for name in names]
        axes.broken_barh(spans, (row - 0.35, 0.7), facecolors=colours, linewidth=0)
    axes.set_yticks(range(len(people)), [f"person {number}" for number in people])
    axes.set(xlabel="time [s]", title="found, coloured by reported id (grey: missed)")
    axes.set_xlim(0.0, (times[-1] if len(times) else 0.0) + step)


def _seconds(pairs: Sequence[FramePair]) -> np.ndarray:
    return np.array([1e-9 * (pair.stamp_ns - pairs[0].stamp_ns) for pair in pairs])


def _people(pairs: Sequence[FramePair]) -> list[int]:
    return sorted({number for pair in pairs for number in pair.truth_ids.tolist()})


PLOTS: dict[str, Draw] = {
    "pck": draw_pck,
    "error_by_joint": draw_joints,
    "error_over_time": draw_times,
    "identities": draw_identities,
}
