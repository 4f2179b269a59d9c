"""Bias tables: installed ones, round trips, and files that are none."""

import numpy as np
import pytest

from panoptic_ros.errors import ConfigError
from panoptic_ros.io.biases import bias_table_names, read_bias_table, torso_of, write_bias_table
from panoptic_ros.io.skeletons import load_skeleton, map_joints

COCO = load_skeleton("coco17").joint_names


@pytest.mark.parametrize("name", bias_table_names())
def test_installed_tables_fit_the_skeleton_of_their_name(name):
    skeleton, _ = map_joints(name.rsplit("-", 1)[1], COCO)
    table = read_bias_table(name, skeleton)
    left, right = skeleton.joint("lShoulder"), skeleton.joint("rShoulder")
    assert np.allclose(table.offsets[left], table.offsets[right] * [1, -1, 1])
    assert np.allclose(table.offsets[skeleton.joint("Neck")], table.offsets[[left, right]].mean(axis=0))
    assert 0.0 < np.abs(table.offsets).max() < 0.2


def test_what_is_written_is_read_for_any_spelling(tmp_path):
    path = tmp_path / "mine.yaml"
    write_bias_table(path, {"left_hip": [0.01, -0.02, 0.03], "nose": [0.1, 0.0, 0.0]}, {"detector": "x"})
    for name in ("panoptic19", "coco17", "body25"):
        skeleton = load_skeleton(name)
        table = read_bias_table(str(path), skeleton)
        left, right = torso_of(skeleton.joint_names, name)[2:]
        assert np.allclose(table.offsets[left], [0.01, -0.02, 0.03])
        assert np.allclose(table.offsets[right], [0.01, 0.02, 0.03])
        assert np.allclose(table.offsets[skeleton.head], [0.1, 0.0, 0.0])
        assert np.count_nonzero(np.abs(table.offsets).sum(axis=1)) == 3


@pytest.mark.parametrize(
    "text, says",
    [
        ("offsets: {nose: [0, 0, 0]}", "format"),
        ("format: panoptic-biases-1", "no offsets"),
        ("format: panoptic-biases-1\noffsets: {nose: [0, 0]}", "nose"),
        ("format: panoptic-biases-1\noffsets: {nose: [0, 0, .nan]}", "nose"),
        ("format: panoptic-biases-1\noffsets: {right_hip: [0, 0, 0]}", "right_hip"),
        ("format: panoptic-biases-1\noffsets: {nose: [2, 0, 0]}", "torso length"),
    ],
)
def test_files_that_are_no_tables_are_refused_by_name(tmp_path, text, says):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError, match=says):
        read_bias_table(str(path), load_skeleton("panoptic19"))


def test_unknown_names_and_skeletons_without_a_torso_are_refused():
    with pytest.raises(ConfigError, match="nobodys"):
        read_bias_table("nobodys", load_skeleton("panoptic19"))
