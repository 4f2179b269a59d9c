"""`panoptic bench patches` from the command line."""

from panoptic_ros.bench.patches import lines
from panoptic_ros.cli.main import main


def test_bad_numbers_are_told_in_one_line(capsys):
    assert main(["bench", "patches", "--views", "1,8"]) == 2
    assert "--views 1,8" in capsys.readouterr().err
    assert main(["bench", "patches", "--frames", "3"]) == 2
    assert "20 at least" in capsys.readouterr().err


def test_the_table_tells_what_patches_add():
    row = {
        "views": 8,
        "people": 4,
        "patches": 600.0,
        "flow_ms": 20.0,
        "patches_ms": 15.0,
        "refinement_ms": 6.0,
        "refinement_without_ms": 1.0,
    }
    text = lines({"rows": [row]})
    assert len(text) == 3 and "40.00" in text[2] and "25.0" in text[2] and "66.7" in text[2]
