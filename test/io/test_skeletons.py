"""Skeleton files: what is installed, how detectors map onto it, and mistakes in a user's own."""

import pytest
import yaml

from panoptic_ros.errors import ConfigError, DataError
from panoptic_ros.io.skeletons import (
    fullest_skeleton,
    load_skeleton,
    map_joints,
    shared_names,
    skeleton_names,
    skeleton_of,
)

SMALL = {
    "name": "small",
    "root": "hip",
    "head": "top",
    "joints": {"hip": "mid_hip", "top": "nose", "l": "left_hip", "r": "right_hip"},
    "bones": [["hip", "top"], ["hip", "l"], ["hip", "r"]],
    "left_right": [["l", "r"]],
    "mean_of": {"hip": ["l", "r"]},
}


def test_installed_skeletons_are_whole_and_have_sides():
    installed = {"panoptic15", "panoptic19", "coco17", "body25", "blazepose33", "wholebody133"}
    assert set(skeleton_names()) == installed
    for name in skeleton_names():
        model = load_skeleton(name)
        assert model.name == name and model.parents[model.root] == -1
        assert [model.mirror[joint] for joint in model.mirror] == list(range(len(model)))
        assert skeleton_of(model.joint_names) == name


def test_the_skeleton_that_takes_most_joints_of_a_detector():
    coco = shared_names("coco17")
    feet = [name for name in shared_names("body25") if "toe" in name or "heel" in name]
    assert fullest_skeleton([*coco, "head", "neck", *feet]) == "body25"  # HALPE_26 and BODY_25B
    assert fullest_skeleton([*coco, "neck"]) == "panoptic19"
    assert fullest_skeleton(["left_wrist", "right_wrist"]) is fullest_skeleton(["tail"]) is None


def test_joints_that_a_detector_lacks_are_means_or_never_seen(tmp_path):
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump(SMALL, sort_keys=False))
    model, mapping = map_joints(str(path), ["right_hip", "left_hip"])
    assert mapping.sources == ((1, 0), (), (1,), (0,))
    assert model.derived == ((0, (2, 3)),)
    with pytest.raises(ConfigError, match="small has none of the joints"):
        map_joints(str(path), ["left_wrist"])


@pytest.mark.parametrize(
    ("change", "error", "told"),
    [
        ({"joints": ["hip"]}, DataError, "dict 'joints'"),
        ({"bones": [["hip", "top", "l"]]}, DataError, "two joints"),
        ({"bones": [1]}, DataError, "two joints"),
        ({"bones": [["hip", "knee"]]}, DataError, "'knee'"),
        ({"bones": [["hip", "top"], ["hip", "l"]]}, ConfigError, "no bone leads to r"),
        ({"left_right": ["l"]}, DataError, "left_right"),
        ({"mean_of": {"hip": "l"}}, DataError, "mean_of"),
        ({"mean_of": {"hip": ["knee"]}}, DataError, "'knee'"),
        ({"head": "hat"}, ConfigError, "'hat'"),
    ],
)
def test_mistakes_in_a_file_are_named(tmp_path, change, error, told):
    path = tmp_path / "small.yaml"
    path.write_text(yaml.safe_dump({**SMALL, **change}, sort_keys=False))
    with pytest.raises(error, match=told):
        load_skeleton(str(path))
