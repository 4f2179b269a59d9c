"""After a run: pictures, video, plot, report."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from panoptic_ros.cli.run.plan import Plan
from panoptic_ros.cli.run.results import MARK, Results
from panoptic_ros.io.files import write_json


def finish(
    plan: Plan, results: Results, counted: Mapping[str, Mapping[str, str]], *, pictures: bool, out: Path
) -> None:
    """Make all that a person looks at."""
    write_json(results.folder / MARK, {"format": "panoptic-report-1", "counted": counted})
    for k, v in counted.items():
        print(k, dict(v))
