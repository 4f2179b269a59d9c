"""The bag in the repository becomes skeletons, without a model."""
import json

import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.resources import share_folder

SAMPLE = share_folder() / "bags" / "sample"


@pytest.mark.skipif(not SAMPLE.is_dir(), reason="the sample bag is part of the checkout only")
def test_sample_bag_gives_two_people_with_one_id_each(tmp_path, monkeypatch):
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "no models here"))
    out = tmp_path / "out"
    assert main(["run", "--bag", str(SAMPLE), "--out", str(out), "--in-process"]) == 0
    report = json.loads((out / "report.json").read_text())
    assert [person["frames"] for person in report["people"]] == [60, 60]
    assert report["reprojection_px"]["all"]["median"] < 15.0
    assert (out / "skeletons.png").stat().st_size > 10_000


def test_sample_bag_is_small():
    assert sum(path.stat().st_size for path in SAMPLE.iterdir()) < 1_000_000
