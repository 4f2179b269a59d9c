"""`panoptic bias measure` on made skeletons, and its table in `panoptic solve`."""

import numpy as np
import pytest

from panoptic_ros.cli.main import main
from panoptic_ros.io.biases import read_bias_table
from panoptic_ros.io.files import read_json, write_json
from panoptic_ros.io.skeletons import load_skeleton

NAMES = ["left_shoulder", "right_shoulder", "left_hip", "right_hip", "nose"]
BODY = np.array([[0.0, 0.2, 1.4], [0.0, -0.2, 1.4], [0.0, 0.15, 0.9], [0.0, -0.15, 0.9], [0.1, 0.0, 1.6]])


def write(path, shift):
    frames = []
    for i in range(8):
        people = [BODY + [0.1 * i, 2.0 * k, 0.0] + shift for k in range(2)]
        skeletons = [{"id": 3 + k, "joints": joints.tolist()} for k, joints in enumerate(people)]
        frames.append({"index": i, "stamp_ns": i * 40_000_000, "skeletons": skeletons})
    write_json(path, {"format": "panoptic-skeletons-1", "joint_names": NAMES, "frames": frames})
    return str(path)


@pytest.fixture
def files(tmp_path):
    down = np.zeros((5, 3))
    down[:2, 2] = -0.06  # the true shoulders lie 6 cm below those of the detector
    return write(tmp_path / "truth.json", down), write(tmp_path / "result.json", np.zeros((5, 3)))


def test_a_table_is_measured_written_and_judged(files, tmp_path, capsys):
    out = tmp_path / "table.yaml"
    assert main(["bias", "measure", *files, "--out", str(out), "--detector", "made"]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 4 and printed[1].split() == ["3", "0.0", "0.0", "0.600", "1.000"]
    skeleton = load_skeleton("coco17")
    table = read_bias_table(str(out), skeleton)
    assert np.allclose(table.offsets[skeleton.joint("left_shoulder")], [0, 0, -0.12], atol=1e-4)
    assert np.allclose(table.offsets[skeleton.joint("nose")], 0.0)


def test_people_can_be_left_out(files, tmp_path, capsys):
    out = tmp_path / "table.yaml"
    assert main(["bias", "measure", *files, "--out", str(out), "--leave-out", "4"]) == 0
    assert "8 skeletons of 1 people" in out.read_text()
    assert main(["bias", "measure", *files, "--out", str(out), "--leave-out", "9"]) == 2
    assert "3, 4" in capsys.readouterr().err


def test_mistakes_are_told_in_one_line(files, tmp_path, capsys):
    truth, _ = files
    document = read_json(tmp_path / "result.json")
    document["frames"] = []
    write_json(tmp_path / "nobody.json", document)
    arguments = ["bias", "measure", truth, str(tmp_path / "nobody.json"), "--out", str(tmp_path / "t.yaml")]
    assert main(arguments) == 2
    assert len(capsys.readouterr().err.strip().splitlines()) == 1
    assert not (tmp_path / "t.yaml").exists()


def test_an_interruption_leaves_no_table(files, tmp_path, capsys, monkeypatch):
    def interrupt(bar, share, doing):
        if share > 0.5:
            raise KeyboardInterrupt

    monkeypatch.setattr("panoptic_ros.view.progress.PassBar.show", interrupt)
    before = sorted(tmp_path.iterdir())
    assert main(["bias", "measure", *files, "--out", str(tmp_path / "table.yaml")]) == 2
    assert capsys.readouterr().err == "panoptic bias: interrupted\n"
    assert sorted(tmp_path.iterdir()) == before
