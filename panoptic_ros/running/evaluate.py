"""Scores the skeletons of one file against the truth in another file."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.evaluation import (
    PCP_RULES,
    SkeletonSequence,
    evaluate_pcp,
    failures,
    find_time_offset,
    pair_sequences,
    parse_limit,
    pcp_table,
    report_table,
    shifted,
)
from panoptic_ros.evaluation.limits import Limit
from panoptic_ros.evaluation.report import report_of
from panoptic_ros.io.compared_skeletons import only_joints, read_sequence, spelt_alike

PROTOCOLS = ("default", *PCP_RULES)


@dataclass(frozen=True)
class Scores:
    """Result of a comparison: scores by the names of `panoptic evaluate --json`, and a table as text."""

    values: dict[str, Any]
    table: str

    def missed(self, limits: Sequence[Limit]) -> list[str]:
        """Return one phrase for every limit that the scores miss.

        Raises:
            UsageError: if there is no score of that name.
        """
        return failures(self.values, limits)


def read_limits(minimum: Sequence[str], maximum: Sequence[str]) -> list[Limit]:
    """Parse limits for scores, each written as name=number.

    Args:
        minimum: lower limits.
        maximum: upper limits.

    Raises:
        UsageError: if a limit has another form.
    """
    return [parse_limit(text) for text in minimum] + [parse_limit(text, upper=True) for text in maximum]


def evaluate(
    truth_file: Path,
    result_file: Path,
    *,
    joints: str | None = None,
    skip: int = 0,
    align_time: bool = False,
    protocol: str = PROTOCOLS[0],
    plots: Path | None = None,
) -> Scores:
    """Compare a result with the truth.

    Args:
        joints: Restrict the comparison to a skeleton or to joint names separated by commas, see
            `only_joints`.
        skip: Number of frames to leave out at the beginning of the truth.
        align_time: First estimate a constant offset of the result's timestamps from the motion, and remove
            it.
        protocol: One of `PROTOCOLS`. All except the first count correct limbs (PCP).
        plots: Folder for plots.

    Raises:
        UsageError: if options contradict each other.
        DataError: if a file cannot be used.
    """
    if skip < 0:
        raise UsageError(f"--skip {skip} is negative")
    truth, result = read_sequence(truth_file), read_sequence(result_file)
    if not truth.frames:
        raise DataError(f"{truth_file} has no frames")
    if joints is not None:
        if protocol in PCP_RULES:
            raise UsageError("--joints needs the default protocol; those of PCP are fixed")
        truth = only_joints(truth, joints)
    result = spelt_alike(result, truth)
    offset_ms = None
    if align_time:
        offset = find_time_offset(truth, result)
        result, offset_ms = shifted(result, offset.seconds), 1e3 * offset.seconds
    if protocol in PCP_RULES:
        if plots is not None:
            raise UsageError("--plots needs the default protocol")
        scores = _limbs(truth, result, skip, protocol)
    else:
        scores = _joints(truth, result, skip, plots)
    if offset_ms is None:
        return scores
    told = f"\n\n{offset_ms:.1f} ms were added to the result's stamps"
    return Scores({**scores.values, "time_offset_ms": offset_ms}, scores.table + told)


def _limbs(truth: SkeletonSequence, result: SkeletonSequence, skip: int, protocol: str) -> Scores:
    rest = SkeletonSequence(truth.joint_names, truth.frames[skip:])
    pcp = evaluate_pcp(rest, result, protocol)
    return Scores(pcp.to_mapping(), pcp_table(pcp))


def _joints(truth: SkeletonSequence, result: SkeletonSequence, skip: int, plots: Path | None) -> Scores:
    pairs = pair_sequences(truth, result, skip)
    report = report_of(pairs, truth.joint_names)
    if plots is not None:
        from panoptic_ros.view.evaluation_plots import write_plots  # matplotlib is slow to load

        write_plots(plots, pairs, truth.joint_names)
    return Scores(report.to_mapping(), report_table(report))
