import hashlib

import numpy as np
import pytest
import yaml

from panoptic_ros.detection.card import ModelCard
from panoptic_ros.errors import BackendError, ConfigError, EnvironmentProblem
from panoptic_ros.io.models import fetch, is_cached, load_detector, read_card
from panoptic_ros.io.models.check import check_model, made_picture


def change(card_path, **values):
    document = yaml.safe_load(card_path.read_text())
    for key, value in values.items():
        if value is None:
            document.pop(key, None)
        else:
            document[key] = value
    card_path.write_text(yaml.safe_dump(document))


def test_fetch_converts_and_the_second_time_does_nothing(npm, tiny_card, tmp_path):
    seen = []
    written = fetch(str(tiny_card), lambda doing, megabytes: seen.append(doing))
    assert written == [tmp_path / "cache" / "models" / "tiny.onnx"]
    assert "converting" in seen and npm.count == 1
    before = written[0].read_bytes()
    npm.fails("npm error code ENOTFOUND")  # offline
    assert fetch(str(tiny_card)) == [] and npm.count == 1
    assert written[0].read_bytes() == before
    model = load_detector(str(tiny_card))
    assert isinstance(model.card, ModelCard) and model.onnx_bytes == before
    assert sorted(p.name for p in written[0].parent.iterdir()) == ["tiny.onnx", "tiny.onnx.sha256"]


def test_without_network_nothing_is_left(npm, tiny_card, tmp_path):
    npm.fails("npm error code ENOTFOUND")
    with pytest.raises(EnvironmentProblem, match="cannot be reached"):
        fetch(str(tiny_card))
    assert not is_cached(read_card(str(tiny_card)))
    assert list((tmp_path / "cache" / "models").iterdir()) == []


def test_a_missing_model_says_how_to_get_it(npm, tiny_card):
    with pytest.raises(BackendError, match="run: panoptic models fetch tiny"):
        load_detector(str(tiny_card))
    change(tiny_card, fetch=None)
    with pytest.raises(BackendError, match="give its path"):
        load_detector(str(tiny_card))
    with pytest.raises(BackendError, match="cannot be fetched"):
        fetch(str(tiny_card))


def test_a_damaged_cache_is_refused_and_fetched_again(npm, tiny_card):
    path = fetch(str(tiny_card))[0]
    path.write_bytes(path.read_bytes()[:-1])
    with pytest.raises(BackendError, match="SHA-256"):
        load_detector(str(tiny_card))
    assert not is_cached(read_card(str(tiny_card)))
    assert fetch(str(tiny_card)) == [path] and npm.count == 2
    load_detector(str(tiny_card))


def test_a_file_of_the_users_with_and_without_a_hash(npm, tiny_card, tmp_path):
    data = fetch(str(tiny_card))[0].read_bytes()
    own = tiny_card.parent / "own.onnx"
    own.write_bytes(data)
    change(tiny_card, file="own.onnx", fetch=None)
    assert load_detector(str(tiny_card)).onnx_bytes == data
    change(tiny_card, sha256=hashlib.sha256(data).hexdigest().upper())
    load_detector(str(tiny_card))
    change(tiny_card, sha256="1" * 64)
    with pytest.raises(BackendError, match=r"own\.onnx has SHA-256 .*, expected 1111"):
        load_detector(str(tiny_card))


def test_a_file_that_is_no_onnx_or_has_other_tensors(npm, tiny_card):
    data = fetch(str(tiny_card))[0].read_bytes()
    own = tiny_card.parent / "own.onnx"
    own.write_bytes(b"<html>not found</html>")
    change(tiny_card, file="own.onnx", fetch=None)
    with pytest.raises(BackendError, match="not an ONNX file"):
        load_detector(str(tiny_card))
    own.write_bytes(data)
    change(tiny_card, joints="coco17")
    with pytest.raises(BackendError, match=r"'heat'.* 3 .*17"):
        load_detector(str(tiny_card))


def test_the_person_detector_comes_along(npm, tiny_card):
    fetch(str(tiny_card))
    crops = tiny_card.with_name("crops.yaml")
    document = yaml.safe_load(tiny_card.read_text())
    document.pop("fetch")
    document |= {
        "name": "crops",
        "family": "single_heads",
        "detector": "tiny.yaml",
        "file": str(tiny_file()),
        "output": {r: r for r in ("center", "heat", "regress", "offset")},
        "input": {**document["input"], "size": [64, 64], "fit": "crop"},
    }
    crops.write_text(yaml.safe_dump(document))
    model = load_detector(str(crops))
    assert model.person_detector is not None and model.person_detector.card.name == "tiny"
    document["detector"] = "crops.yaml"
    crops.write_text(yaml.safe_dump(document))
    with pytest.raises(BackendError, match="finds no people"):
        load_detector(str(crops))


def tiny_file():
    from panoptic_ros.io.resources import cache_folder

    return cache_folder() / "models" / "tiny.onnx"


def test_check_runs_the_model_and_compares_known_values(npm, tiny_card):
    fetch(str(tiny_card))
    source = read_card(str(tiny_card))
    model = load_detector(str(tiny_card))
    result = check_model(model, source)
    assert result.shapes["heat"] == (1, 3, 24, 32) and not result.compared
    document = yaml.safe_load(tiny_card.read_text())
    document["fetch"]["mean_outputs"] = {"heat": 0.123456}
    tiny_card.write_text(yaml.safe_dump(document))
    with pytest.raises(BackendError, match="the mean of heat is"):
        check_model(model, read_card(str(tiny_card)))


def test_the_made_picture_is_always_the_same():
    picture = made_picture(96, 128)
    assert picture.shape == (96, 128, 3) and picture.dtype == np.uint8
    expected = [(10 * (3 + k) + 20 * (5 - k)) % 256 for k in range(3)]
    assert picture[10, 20].tolist() == expected


def test_a_wrong_fetch_entry_is_told(tiny_card):
    change(tiny_card, fetch={"package": "tiny@1"})
    with pytest.raises(ConfigError, match="fetch needs"):
        fetch(str(tiny_card))
