import pytest

from panoptic_ros.detection.card import card_from_mapping, expected_shapes
from panoptic_ros.errors import ConfigError

SIMCC = {
    "name": "mine",
    "family": "simcc",
    "joints": ["nose", "left_eye"],
    "output": {"x": "a", "y": "b"},
    "input": {"size": [256, 192], "fit": "crop"},
    "split": 2,
}


def test_a_card_is_read_with_defaults_and_lossless_conversions():
    card = card_from_mapping(SIMCC)
    assert card.split == 2.0 and isinstance(card.split, float)
    assert card.input.size == (256, 192) and card.joints == ("nose", "left_eye")
    assert expected_shapes(card) == {"x": (None, 2, 384), "y": (None, 2, 512)}
    assert card_from_mapping({**SIMCC, "input": {"size": [64, 64], "fit": "crop"}}).input.layout == "NCHW"


@pytest.mark.parametrize(
    "change, text",
    [
        ({"family": "magic"}, "family = 'magic'"),
        ({"joints": []}, "joints"),
        ({"joints": "nose"}, "joints"),
        ({"output": {"x": "a"}}, "x, y"),
        ({"output": {"x": "a", "y": "b", "z": "c"}}, "x, y"),
        ({"variant": "dark"}, "variant"),
        ({"input": {"size": [256, 192]}}, "input.fit"),
        ({"input": {"size": "dynamic", "fit": "crop"}}, "input.size"),
        ({"input": {"size": [256], "fit": "crop"}}, "input.size"),
        ({"input": {"size": [256, 192.5], "fit": "crop"}}, "input.size"),
        ({"input": {"size": [256, 192], "fit": "crop", "std": [1, 0, 1]}}, "input.std"),
        ({"input": {"size": [256, 192], "fit": "crop", "color": "GBR"}}, "input.color"),
        ({"input": {"sise": [256, 192]}}, "input.sise"),
        ({"input": 3}, "input"),
        ({"coords": {"origin": "left"}}, "coords.origin"),
        ({"coords": {"udp": 1}}, "coords.udp"),
        ({"sha256": "abc"}, "sha256"),
        ({"stride": "4"}, "stride"),
        ({"split": 0}, "split"),
        ({"max_people": 0}, "max_people"),
        ({"person_px": [200, 100]}, "person_px"),
        ({"joint_threshold": 1.5}, "joint_threshold"),
        ({"colour": "RGB"}, "colour"),
    ],
)
def test_wrong_entries_are_named(change, text):
    with pytest.raises(ConfigError, match=text.replace("(", r"\(")) as caught:
        card_from_mapping({**SIMCC, **change})
    assert "mine" in str(caught.value) and "\n" not in str(caught.value)


def test_missing_entries_are_named():
    with pytest.raises(ConfigError, match="'family' is missing"):
        card_from_mapping({"name": "mine"})


def test_a_person_detector_belongs_to_crops_only():
    with pytest.raises(ConfigError, match="detector"):
        card_from_mapping(
            {
                "name": "mine",
                "family": "points",
                "variant": "rtmo",
                "joints": ["nose"],
                "detector": "other",
                "output": {"boxes": "dets", "points": "keypoints"},
            }
        )
