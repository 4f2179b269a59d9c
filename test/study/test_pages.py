"""The page of results is that of the committed JSON, and a result is shown as its study prints it."""

import json
from pathlib import Path

from panoptic_ros.io.resources import share_folder
from panoptic_ros.study.names import STUDIES, parsed
from panoptic_ros.study.pages import HEAD, PAGE, results_page
from panoptic_ros.study.study import run_study


def test_the_committed_page_is_built_from_the_committed_results():
    root = share_folder()
    assert (root / PAGE).read_text() == results_page(root), "run: panoptic config write"


def test_a_result_is_shown_with_its_command_and_its_table(tmp_path: Path):
    study = parsed("ltc-starts", ["--number", "2", "--json", str(tmp_path / "x.json")])
    result = run_study(study)
    assert result["options"] == ["--number", "2"]
    folder = tmp_path / "docs" / "results"
    folder.mkdir(parents=True)
    (folder / "ltc-starts.json").write_text(json.dumps(result))
    (folder / HEAD).write_text("# Accuracy\n")
    page = results_page(tmp_path)
    assert page.startswith("# Accuracy\n\n## All studies")
    assert "`panoptic study ltc-starts --number 2`" in page and "starts  not decoded  wrong labels" in page
    assert all(f"| `{name}` |" in page for name in STUDIES)
