"""Build the documentation page of the committed study results."""

from __future__ import annotations

import json
import math
import shlex
from pathlib import Path
from typing import Any

from panoptic_ros.study.names import STUDIES, parsed

PAGE, RESULTS = "docs/accuracy.md", "docs/results"  # in the repository
HEAD = "head.md"  # in the folder of results: the hand-written part of the page


def results_page(root: Path) -> str:
    """Return the text of the page.

    The page has a table of all studies, then the command and the table of each committed result.

    Args:
        root: root folder of the repository.
    """
    head = (root / RESULTS / HEAD).read_text()
    rows = "".join(f"| `{name}` | {about} |\n" for name, (_, about) in STUDIES.items())
    sections = (_section(path) for path in sorted((root / RESULTS).glob("*.json")))
    return f"{head}\n## All studies\n\n| name | subject |\n|---|---|\n{rows}{''.join(sections)}"


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
