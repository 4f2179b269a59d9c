"""`panoptic sync kinects`."""

import json

from panoptic_ros.cli.main import main


def test_frames_of_kinects(tmp_path, capsys):
    hd = {"univ_time": [1000.0 + 33.367 * k for k in range(20)]}
    depth = {"KINECTNODE1": {"univ_time": [1002.0 + 33.334 * k for k in range(20)]}}
    path = tmp_path / "tables.json"
    path.write_text(json.dumps({"hd": hd, "kinect": {"depth": depth}}))
    assert main(["sync", "kinects", str(path), "--frame", "3", "--hd-base", "0"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "element N + 0" in lines[0] and lines[2].split() == ["3", "1100.101", "KINECTNODE1", "-", "3"]
    assert main(["sync", "kinects", str(path), "--frame", "99"]) == 2
