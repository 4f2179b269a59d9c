"""The rows of a study as a table."""
from __future__ import annotations

from typing import Any

from panoptic_ros.evaluation.studies.score import THRESHOLDS


def study_table(rows: list[dict[str, Any]]) -> list[str]:
    """One line per number of people and kind of cameras; at the end all people together."""
    out = [
        "people  cameras          nodes  outliers  missed  ghosts  node acc.  skel. acc.  median mm"
        "  PCK 1 cm   2 cm   5 cm"
    ]
    for row in rows:
        curve = [row["pck"][int((THRESHOLDS < limit - 1e-9).sum())] for limit in (0.01, 0.02, 0.05)]
        kind = "" if row["kind"] == "given" else row["kind"]
        out.append(
            f"{row['people']:>6}  {row['cameras']:>7} {kind:<4} {row['nodes']:>9}  {row['outlier_nodes']:>8}"
            f"  {row['missed_nodes']:>6}  {row['ghosts']:>6}  {100 * row['node_accuracy']:>7.2f} %"
            f"  {100 * row['skeleton_accuracy']:>8.2f} %  {row['median_mm']:>9.1f}"
            f"  {curve[0]:>8.3f}  {curve[1]:.3f}  {curve[2]:.3f}"
        )
    kinds = list(dict.fromkeys((row["cameras"], row["kind"]) for row in rows))
    if len({row["people"] for row in rows}) > 1:
        out.append("")
        for kind in kinds:
            mine = [row for row in rows if (row["cameras"], row["kind"]) == kind]
            nodes, skeletons = (sum(row[key] for row in mine) for key in ("nodes", "skeletons"))
            wrong = sum(row["outlier_nodes"] + row["missed_nodes"] for row in mine)
            right = sum(row["skeletons"] * row["skeleton_accuracy"] for row in mine)
            name = f"{kind[0]} {'cameras' if kind[1] == 'given' else kind[1]}"
            out.append(
                f"{name:>16}: {skeletons} skeletons, {nodes} nodes, {wrong} outliers or missed: accuracy of "
                f"nodes {100 * (1 - wrong / nodes):.2f} %, of skeletons {100 * right / skeletons:.2f} %"
            )
    return out
