"""What `panoptic study detection` runs, and the table and plot that it makes of it."""

import pytest

from panoptic_ros.errors import ConfigError, UsageError
from panoptic_ros.study.detection.detection import FULL, variants
from panoptic_ros.study.names import parsed
from panoptic_ros.view.detection_plot import write_plot


def study(*words):
    return parsed("detection", ["--capture", "folder", *words])


def row(setting, cpu_ms):
    return {
        "setting": setting,
        "cpu_ms": cpu_ms,
        "gain": 400.0 / cpu_ms,
        "after_ms": 5.0,
        "beside_ms": 2.4,
        "carry_ms": None,
        "median_mm": 20.0,
        "pck_5": 0.9,
        "pck_10": None,
        "found_persons": 9,
        "truth_persons": 9,
        "result_persons": 10,
        "id_switches": 0,
        "instants": 12,
        "newcomers": 2,
        "newcomers_missed": 0,
        "newcomers_wait_s": 0.32,
    }


def test_looks_follow_the_rate_of_the_frames():
    found = variants(30.0)
    assert found[FULL] == {} and found["every 3. image"] == {"looks_per_s": 10.0}
    assert found["every 3. image, whole"]["regions"] == "off"


def test_every_image_is_always_among_the_settings():
    more = ("--detection", "looks_per_s=6,regions=off")
    chosen = study("--only", "every 3", *more).chosen()
    assert list(chosen) == [FULL, "every 3. image, whole", "every 3. image", "looks_per_s=6,regions=off"]
    assert chosen["looks_per_s=6,regions=off"] == {"looks_per_s": 6.0, "regions": "off"}


@pytest.mark.parametrize(
    ("words", "error", "told"),
    [
        (["--only", "every 9"], UsageError, "no setting contains 'every 9'"),
        (["--every", "0"], UsageError, "'0' is not a whole number from 1"),
        (["--apart"], UsageError, "--apart needs --every 2"),
        (["--detection", "regions=perhaps"], ConfigError, "perhaps"),
        (["--detection", "threads=2"], UsageError, "one thread"),
    ],
)
def test_what_makes_no_sense_is_told(words, error, told):
    with pytest.raises(error, match=told):
        study(*words).cases()


def test_the_table_and_the_plot(tmp_path):
    rows = [row(FULL, 400.0), row("every 3. image", 90.0)]
    lines = study().lines({"capture": "here", "rows": rows})
    assert "12 instants" in lines[0] and lines[-1].split()[3:6] == ["90.0", "4.44", "2.40"]
    assert " - " in lines[-1]  # a score that is not known
    write_plot(tmp_path / "curve.png", rows, "here")
    assert (tmp_path / "curve.png").read_bytes()[:4] == b"\x89PNG"
