"""`panoptic study patches` from the command line."""

from panoptic_ros.cli.main import main
from panoptic_ros.study.names import parsed
from panoptic_ros.study.study import Case
from panoptic_ros.study.surface import patches


def test_bad_numbers_are_told_in_one_line(capsys):
    assert main(["study", "patches", "--views", "1,8"]) == 2
    assert "'1,8' is not a list" in capsys.readouterr().err
    assert main(["study", "patches", "--frames", "3"]) == 2
    assert "from 20" in capsys.readouterr().err


def test_the_table_tells_what_patches_add(monkeypatch):
    row = {
        "views": 8,
        "people": 4,
        "patches": 600.0,
        "flow_ms": 20.0,
        "patches_ms": 15.0,
        "refinement_ms": 6.0,
        "refinement_without_ms": 1.0,
    }
    monkeypatch.setattr(patches, "run_child", lambda function, request: row)
    study = parsed("patches", [])
    rows = study.measure(Case("8 views"), lambda share, doing: None)
    text = study.lines({"rows": rows})
    assert len(text) == 4 and "40.00" in text[3] and "25.0" in text[3] and "66.7" in text[3]
