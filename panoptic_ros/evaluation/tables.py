"""Text tables of reports."""

from __future__ import annotations

import math

from panoptic_ros.evaluation.identity_scores import IdentityScores
from panoptic_ros.evaluation.motion_scores import Consistency, ViewCountConsistency
from panoptic_ros.evaluation.pcp import PcpReport
from panoptic_ros.evaluation.report import Report


def report_table(report: Report, joints: bool = True) -> str:
    """Return the scores as lines of text; `joints` adds a table with a row per joint."""
    scores, people, identities = report.joints, report.people, report.identities
    rows = [
        ("frames", f"{report.paired_frames} of {report.frames} have a result"),
        ("stamp offset", _offsets(report)),
        ("MPJPE", f"{_number(scores.mpjpe_mm, 1)} mm mean, {_number(scores.median_mm, 1)} mm median"),
        ("PCK", _pck(scores.pck)),
        ("PCK of all people", _pck(scores.pck_of_everybody)),
        ("joint recall", _number(scores.recall)),
        ("joint precision", _number(scores.precision)),
        (
            "people",
            f"{people.found} found of {people.truth} true and {people.result} reported; "
            f"{_number(people.unmatched_per_frame, 2)} per frame are of no true person",
        ),
        ("person recall", _number(people.recall)),
        ("person precision", _number(people.precision)),
        ("id switches", f"{identities.switches}{_over_gaps(identities)}, fragments {identities.fragments}"),
        ("same ids", f"{_number(identities.same_ids)} of the found people have equal ids in both files"),
        ("MOTA", f"{_number(identities.mota)}, IDF1 {_number(identities.idf1)}"),
        ("acceleration error", f"{_number(report.acceleration_error, 1)} m/s^2"),
        ("NEES", _consistency(report)),
    ]
    if report.consistency is not None:
        rows += [(f"  {some.kind}", _consistency_of(some)) for some in report.consistency.by_views]
    lines = [f"{name:<20}{text}" for name, text in rows]
    return "\n".join([*lines, "", *_joint_rows(report)] if joints else lines)


def pcp_table(report: PcpReport) -> str:
    """Return PCP per actor and limb as lines of text, in percent."""
    head = "".join(f"{'actor ' + str(actor):>10}" for actor in report.actors)
    lines = [f"{'PCP % (' + report.rule + ')':<28}{head}{'all':>10}"]
    for limb, shares, total in zip(report.limbs, report.by_limb, report.limb_means):
        cells = "".join(f"{_percent(share):>10}" for share in (*shares, total))
        lines.append(f"{limb:<28}{cells}")
    cells = "".join(f"{_percent(share):>10}" for share in (*report.by_actor, report.mean))
    lines.append(f"{'total':<28}{cells}")
    counts = "".join(f"{count:>10}" for count in (*report.poses, sum(report.poses)))
    lines.append(f"{'poses that count':<28}{counts}")
    return "\n".join(lines)


def _joint_rows(report: Report) -> list[str]:
    rows = [f"{'joint':<16}{'mean mm':>9}{'median':>9}{'p90':>9}{'recall':>9}"]
    for joint in report.joints.by_joint:
        numbers = (joint.mean_mm, joint.median_mm, joint.p90_mm)
        cells = "".join(f"{_number(value, 1):>9}" for value in numbers)
        rows.append(f"{joint.name:<16}{cells}{_number(joint.recall):>9}")
    return rows


def _pck(curve: tuple[tuple[float, float], ...]) -> str:
    return "  ".join(f"{_number(share)} at {100 * limit:.0f} cm" for limit, share in curve)


def _over_gaps(identities: IdentityScores) -> str:
    count = identities.switches_over_gaps
    return f" ({count} over gaps of the truth)" if count else ""


def _consistency(report: Report) -> str:
    if report.consistency is None:
        return "no covariances were reported"
    return f"{_consistency_of(report.consistency)} (per degree of freedom, 1 = consistent)"


def _consistency_of(nees: Consistency | ViewCountConsistency) -> str:
    return f"{nees.mean_per_dof:.2f}, {nees.cover95:.3f} within the 95 % ellipsoid, {nees.joints} joints"


def _number(value: float, digits: int = 3) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.2f}"


def _offsets(report: Report) -> str:
    return f"{_number(report.mean_offset_ms)} ms mean, {_number(report.largest_offset_ms)} ms at most"
