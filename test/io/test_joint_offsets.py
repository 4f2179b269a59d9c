"""Files of where a detector sees joints."""

import pytest

from panoptic_ros.domain.segments import JointOffset
from panoptic_ros.errors import UserError
from panoptic_ros.io.body_context import body_extras
from panoptic_ros.io.body_models import read_body_model
from panoptic_ros.io.joint_offsets import read_joint_offsets, write_joint_offsets

MODEL = read_body_model()
HEAD = "format: panoptic-joint-offsets-1\noffsets:\n"


def test_what_is_written_is_read_with_the_other_side(tmp_path):
    path = tmp_path / "o.yaml"
    rows = {
        "left_shoulder": JointOffset("spine4", (0.01, 0.02, 0.04)),
        "nose": JointOffset("head", (0.01, 0.0, 0.0)),
    }
    write_joint_offsets(path, rows, {"detector": "made"})
    found = read_joint_offsets(path, MODEL).offsets
    assert found["lShoulder"] == rows["left_shoulder"]
    assert found["rShoulder"] == JointOffset("spine4", (0.01, -0.02, 0.04))
    assert set(found) == {"lShoulder", "rShoulder", "Nose"}
    assert body_extras((), offsets=str(path))["segments"].offsets == found


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("format: panoptic-biases-1\n", "needs format"),
        (HEAD, "no offsets"),
        (HEAD + "  right_hip: {frame: rThigh, offset: [0, 0, 0]}\n", "on the left"),
        (HEAD + "  tail: {frame: hips, offset: [0, 0, 0]}\n", "tail is not a joint"),
        (HEAD + "  left_hip: [0, 0, 0]\n", "needs frame"),
        (HEAD + "  left_hip: {frame: lThigh, offset: [0, 0]}\n", "three numbers"),
        (HEAD + "  left_hip: {frame: lThigh, offset: [0, 0, .nan]}\n", "0.2 m"),
        (HEAD + "  left_hip: {frame: lThigh, offset: [0, 0, 3]}\n", "0.2 m"),
        (HEAD + "  left_hip: {frame: head, offset: [0, 0, 0]}\n", "none of lThigh, hips"),
        (HEAD + "  nose: {frame: neck, offset: [0, 0, 0]}\n", "none of head"),
        ("{", "not valid YAML"),
    ],
)
def test_mistakes_are_told_in_one_line(tmp_path, text, told):
    path = tmp_path / "o.yaml"
    path.write_text(text)
    with pytest.raises(UserError, match=told) as error:
        read_joint_offsets(path, MODEL)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
