"""`panoptic export`: a file by its suffix."""

import numpy as np
import pytest
from recorded_scene import make_rig, write_scene

from panoptic_ros.cli.main import main
from panoptic_ros.domain import ViewDetections
from panoptic_ros.io.bags import BagWriter
from panoptic_ros.io.files import write_json
from panoptic_ros.io.messages import bag_messages, from_message, to_message
from panoptic_ros.io.messages.family import decode_cdr
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.skeletons import load_skeleton
from panoptic_ros.running.viewer.recordings import open_recorded
from panoptic_ros.view.page.presence import SKELETONS


def test_one_page(tmp_path, capsys):
    write_scene(tmp_path / "bag", 40)
    out = tmp_path / "result.html"
    assert main(["export", str(tmp_path / "bag"), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"<!doctype html>") and b'id="data"' in out.read_bytes()
    assert "opens in any browser" in capsys.readouterr().out


def test_formats_that_there_are_not_are_told(tmp_path, capsys):
    write_scene(tmp_path / "bag", 2)
    for name, what in (("a.fbx", "'.fbx'"), ("a", "'without suffix'")):
        assert main(["export", str(tmp_path / "bag"), "--out", str(tmp_path / name)]) == 2
        assert f"there is no format {what}; there are .html" in capsys.readouterr().err


def write_plain(folder, names=("nose", "left_hip", "right_hip", "spine")):
    """What `panoptic solve` leaves: people in joints of no installed skeleton, some missing, and the rig."""
    rig = make_rig(3)
    joints = [[0.0, 0.0, 1.6], [0.1, 0.0, 0.9], None, [0.0, 0.0, 1.2]]
    people = [{"id": k, "joints": joints[: len(names)], "scores": [0.9] * len(names)} for k in (3, 8)]
    frames = [{"index": k, "stamp_ns": k * 40_000_000, "skeletons": people} for k in range(5)]
    document = {"format": "panoptic-skeletons-1", "joint_names": list(names), "frames": frames}
    write_json(folder / "skeletons.json.gz", document)
    write_rig(folder / "rig.json", rig)
    return rig


@pytest.mark.parametrize("names", [("nose", "left_hip", "right_hip", "spine"), ("nose",), ("a", "b")])
def test_the_skeletons_of_solve_are_a_scene(tmp_path, names):
    write_plain(tmp_path, names)
    for path in (tmp_path, tmp_path / "skeletons.json.gz"):
        scene = open_recorded(path)
        facts = scene.facts()
        assert [camera["name"] for camera in facts["cameras"]] == ["cam0", "cam1", "cam2"]
        assert facts["skeleton"]["joints"] == list(names)
        (message, *_) = scene.messages(0)
        poses = from_message(decode_cdr(message.data, SKELETONS), "RefinedPoseSet")
        assert poses.ids.tolist() == [3, 8] and np.allclose(poses.positions[0, 0], [0.0, 0.0, 1.6])
        scene.scan(lambda: False, lambda: None)
        assert [span[0] for span in scene.presence.spans] == [3, 8]
        scene.close()


def test_skeletons_in_another_order_than_the_installed_ones(tmp_path):
    names = load_skeleton("panoptic19").joint_names[::-1]
    joints = [[0.1 * k, 0.0, 1.0] for k in range(len(names))]
    people = [{"id": 0, "joints": joints}]
    document = {
        "format": "panoptic-skeletons-1",
        "joint_names": list(names),
        "frames": [{"index": 0, "stamp_ns": 0, "skeletons": people}],
    }
    write_json(tmp_path / "skeletons.json", document)
    write_rig(tmp_path / "rig.json", make_rig(2))
    scene = open_recorded(tmp_path)
    assert scene.facts()["skeleton"]["name"] == "panoptic19"
    (message, *_) = scene.messages(0)
    poses = from_message(decode_cdr(message.data, SKELETONS), "RefinedPoseSet")
    assert np.allclose(poses.positions[0, :, 0], 0.1 * np.arange(len(names))[::-1])
    scene.close()


def test_a_page_of_the_skeletons_of_solve(tmp_path, capsys):
    write_plain(tmp_path)
    out = tmp_path / "page.html"
    assert main(["export", str(tmp_path / "skeletons.json.gz"), "--out", str(out)]) == 0
    assert out.read_bytes().startswith(b"<!doctype html>") and b'id="data"' in out.read_bytes()
    (tmp_path / "rig.json").rename(tmp_path / "other.txt")
    assert main(["export", str(tmp_path / "skeletons.json.gz"), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert "the rig of these skeletons is not known" in error and "give --rig" in error
    assert error.count("\n") == 1
    (tmp_path / "other.txt").rename(tmp_path / "cal.json")
    rig = ["--rig", str(tmp_path / "cal.json")]
    assert main(["export", str(tmp_path / "skeletons.json.gz"), *rig, "--out", str(out)]) == 0


def test_a_bag_without_skeletons_says_so(tmp_path, capsys):
    rig, model = make_rig(2), load_skeleton("panoptic19")
    points, scores = np.full((1, len(model), 2), 10.0), np.full((1, len(model)), 0.9)
    with BagWriter(tmp_path / "bag") as bag:
        for name, record in (("/rig", rig), ("/skeleton_model", model)):
            bag.write(name, 0, to_message(record, bag_messages()))
        for k in range(3):
            view = ViewDetections("cam0", k, k, (640, 480), model.hash, points, scores, scores.max(1))
            bag.write("/cam0/detections", k, to_message(view, bag_messages()))
    assert main(["export", str(tmp_path / "bag"), "--out", str(tmp_path / "out.html")]) == 2
    error = capsys.readouterr().err
    assert f"{tmp_path / 'bag'} has no skeletons; `panoptic run --bag" in error and error.count("\n") == 1
    assert not (tmp_path / "out.html").exists()
    scene = open_recorded(tmp_path / "bag")
    scene.scan(lambda: False, lambda: None)  # as `panoptic view` does
    assert scene.presence.complete and scene.presence.spans == []
    scene.close()
