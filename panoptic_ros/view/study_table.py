"""The result of a study as a table."""

from __future__ import annotations

from typing import Any

from panoptic_ros.evaluation.studies.score import THRESHOLDS

Row = dict[str, Any]
PROCEDURES = {  # of Table 2, by the stage that does it here
    "detection": "2D pose detection (5.1)",
    "association": "association of 2D people (not there)",
    "voting": "node and part proposals (5.1-5.2)",
    "assembly": "skeletal proposals, refined (5.3)",
}
PCK = (0.01, 0.02, 0.05)  # m


def study_table(result: dict[str, Any]) -> list[str]:
    """One line per number of people, kind of cameras and method; at the end all people together."""
    rows = result["rows"]
    width = max(len(row["method"]) for row in rows)
    curve = " ".join(f"{100 * limit:.0f} cm".rjust(6) for limit in PCK)
    out = [
        f"people  cameras       {'method':<{width}}      nodes  outliers  missed  ghosts  node acc."
        f"  skel. acc.  median mm  PCK {curve}"
    ]
    out += [_line(row, width) for row in rows]
    if len({row["people"] for row in rows}) > 1:
        kinds = dict.fromkeys(_kind(row) for row in rows)
        out += ["", *(_together([row for row in rows if _kind(row) == kind]) for kind in kinds)]
    return out


def time_table(result: dict[str, Any]) -> list[str]:
    """What one minute of capture costs, as in Table 2 of the paper: procedures by methods."""
    out = []
    for people, cameras in dict.fromkeys((row["people"], row["cameras"]) for row in result["rows"]):
        mine = [row for row in result["rows"] if (row["people"], row["cameras"]) == (people, cameras)]
        what = f"{result['instants']} instants, {cameras} views, {people} people"
        out += [
            f"One minute of capture ({what}), one thread",
            f"{'':<40}" + "".join(f"{row['method']:>18}" for row in mine),
        ]
        for stage, procedure in PROCEDURES.items():
            out.append(f"{procedure:<40}" + "".join(f"{duration(row['seconds'][stage]):>18}" for row in mine))
    return out


def duration(seconds: float) -> str:
    """A time in the unit that suits it."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    return f"{seconds / 60.0:.0f} m" if seconds < 7200.0 else f"{seconds / 3600.0:.1f} h"


def _kind(row: Row) -> tuple[str, str]:
    """Which cameras, and which method."""
    return f"{row['cameras']} {'cameras' if row['kind'] == 'given' else row['kind']}", row["method"]


def _line(row: Row, width: int) -> str:
    curve = " ".join(f"{row['pck'][int((THRESHOLDS < limit - 1e-9).sum())]:6.3f}" for limit in PCK)
    kind = "" if row["kind"] == "given" else row["kind"]
    return (
        f"{row['people']:>6}  {row['cameras']:>7} {kind:<4}  {row['method']:<{width}}  {row['nodes']:>9}"
        f"  {row['outlier_nodes']:>8}  {row['missed_nodes']:>6}  {row['ghosts']:>6}"
        f"  {100 * row['node_accuracy']:>7.2f} %  {100 * row['skeleton_accuracy']:>8.2f} %"
        f"  {row['median_mm']:>9.1f}      {curve}"
    )


def _together(rows: list[Row]) -> str:
    """The accuracy of nodes and skeletons, as in Table 3, over all numbers of people."""
    nodes, skeletons = (sum(row[key] for row in rows) for key in ("nodes", "skeletons"))
    wrong = sum(row["outlier_nodes"] + row["missed_nodes"] for row in rows)
    right = sum(row["skeletons"] * row["skeleton_accuracy"] for row in rows)
    return (
        f"{', '.join(_kind(rows[0]))}: {skeletons} skeletons, {nodes} nodes, {wrong} outliers or missed: "
        f"accuracy of nodes {100 * (1 - wrong / nodes):.2f} %, of skeletons {100 * right / skeletons:.2f} %"
    )
