"""The study of refinement from the command line."""

from panoptic_ros.cli.main import main
from panoptic_ros.study.names import parsed


def test_a_capture_and_its_truth_are_asked_for(tmp_path, capsys):
    assert main(["study", "refine"]) == 2
    assert "--capture" in capsys.readouterr().err
    assert main(["study", "refine", "--capture", str(tmp_path)]) == 2
    assert "truth.json.gz" in capsys.readouterr().err


def test_the_table_has_a_line_for_every_row():
    row = {
        "method": "smoother, patches",
        "lag_s": 0.12,
        "lag": "0.12",
        "acceleration_error": 1.16,
        "mpjpe_mm": 25.5,
        "offset_free_mm": 10.21,
        "offset_free_p95_mm": 24.7,
        "fast_mm": 12.0,
        "pck_10cm": 1.0,
    }
    motion = {
        "t_median_mm": 0.94,
        "t_p90_mm": 4.1,
        "t_available": 0.99,
        "free_true": 0.0,
        "free_measured": 0.001,
        "free_outliers": 0.54,
    }
    result = {"capture": "social", "rows": [row, row], "motions": {"depth": motion}}
    lines = list(parsed("refine", ["--capture", "social"]).lines(result))
    assert len(lines) == 5 and "10.21" in lines[2]
    assert "4.1 mm (90 %)" in lines[3] and "54%" in lines[4]
