import pytest
import yaml

from panoptic_ros.errors import ConfigError, UsageError
from panoptic_ros.io.models import card_names, read_card
from panoptic_ros.io.resources import cache_folder
from panoptic_ros.io.skeletons import map_joints


def test_all_installed_cards_are_sound_and_the_default_comes_first():
    names = card_names()
    assert names[0] == "movenet-multipose" and len(names) >= 10
    families = set()
    for name in names:
        source = read_card(name)
        assert source.card.name == name and source.card.licence and source.card.source
        families.add((source.card.family, source.card.variant))
        if source.card.joints:
            map_joints("panoptic19", source.card.joints)
        if source.card.detector:
            assert read_card(source.card.detector).card.family == "center_heads"
    assert len(families) >= 8


def test_the_model_is_in_the_cache_or_beside_the_card(tmp_path, monkeypatch, tiny_card):
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path / "here"))
    assert read_card("movenet-multipose").model_path == cache_folder() / "models" / "movenet-multipose.onnx"
    document = yaml.safe_load(tiny_card.read_text())
    tiny_card.write_text(yaml.safe_dump({**document, "file": "nets/mine.onnx"}))
    assert read_card(str(tiny_card)).model_path == tiny_card.parent / "nets" / "mine.onnx"
    tiny_card.write_text(yaml.safe_dump({**document, "file": "/somewhere/mine.onnx"}))
    assert str(read_card(str(tiny_card)).model_path) == "/somewhere/mine.onnx"


def test_the_card_beside_an_onnx_file_is_taken(tiny_card):
    assert read_card(str(tiny_card.with_suffix(".onnx"))).card.name == "tiny"
    with pytest.raises(UsageError, match=r"other\.yaml beside it"):
        read_card(str(tiny_card.with_name("other.onnx")))


def test_joints_can_be_those_of_a_skeleton(tiny_card):
    document = yaml.safe_load(tiny_card.read_text())
    tiny_card.write_text(yaml.safe_dump({**document, "joints": "body25"}))
    assert len(read_card(str(tiny_card)).card.joints) == 25


@pytest.mark.parametrize(
    "change, text",
    [
        ({"family": "magic"}, "family"),
        ({"joints": "cow"}, "cow"),
        ({"fetch": {"package": "x"}}, "fetch needs"),
        ({"fetch": "x"}, "fetch needs"),
        ({"inputs": {}}, "inputs"),
    ],
)
def test_wrong_cards_name_the_file_and_the_entry(tiny_card, change, text):
    tiny_card.write_text(yaml.safe_dump({**yaml.safe_load(tiny_card.read_text()), **change}))
    with pytest.raises(ConfigError, match=text) as caught:
        read_card(str(tiny_card))
    assert "tiny.yaml" in str(caught.value) and "\n" not in str(caught.value)


def test_files_that_are_no_cards(tmp_path):
    path = tmp_path / "list.yaml"
    path.write_text("- 1\n- 2\n")
    with pytest.raises(ConfigError, match="not a model card"):
        read_card(str(path))


def test_unknown_names_list_the_known_ones():
    with pytest.raises(UsageError, match="movenet-multipose"):
        read_card("movenet")


def test_the_onnx_file_that_was_named_is_used(tiny_card):
    named = tiny_card.with_suffix(".onnx")
    assert read_card(str(named)).model_path == named
