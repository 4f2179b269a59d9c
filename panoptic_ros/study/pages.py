"""Build the documentation page of the committed study results."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Any

from panoptic_ros.study.names import STUDIES, parsed

PAGE, RESULTS = "docs/results.md", "docs/results"  # paths relative to the repository root
HEAD = """# Results of studies

This page is generated. `panoptic study NAME [OPTION ...] --json docs/results/NAME.json` measures, and
`panoptic config write` builds the page from the committed JSON. A test compares both.
Times are those of two shared cores.

`panoptic study` lists all studies, `panoptic study NAME --help` the options of one. Options that a study
does not understand are refused. Error bars are half widths of the 95 % interval (Student's t).

## All studies

| name | subject |
|---|---|
"""


def results_page(root: Path) -> str:
    """Return the text of the page.

    The page has a table of all studies, then the command and the table of each committed result.

    Args:
        root: root folder of the repository.
    """
    rows = "".join(f"| `{name}` | {about} |\n" for name, (_, about) in STUDIES.items())
    return HEAD + rows + "".join(_section(path) for path in sorted((root / RESULTS).glob("*.json")))


def _numbers(value: Any) -> Any:
    """Return the document with NaN instead of null, which stands for NaN in JSON."""
    if isinstance(value, dict):
        return {key: _numbers(own) for key, own in value.items()}
    if isinstance(value, list):
        return [_numbers(own) for own in value]
    return math.nan if value is None else value


def _section(path: Path) -> str:
    result = _numbers(json.loads(path.read_text()))
    study = parsed(result["study"], result["options"])
    command = shlex.join(["panoptic", "study", study.name, *study.words])
    lines = "\n".join(line.rstrip() for line in study.lines(result))
    return f"\n## {path.stem}\n\n`{command}`\n\n```\n{lines}\n```\n"
