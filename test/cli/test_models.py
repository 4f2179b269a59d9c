import pytest

from panoptic_ros.cli.main import main


@pytest.fixture(autouse=True)
def empty_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("PANOPTIC_CACHE", str(tmp_path))


def test_list_names_all_cards_and_what_to_do(capsys):
    assert main(["models", "list"]) == 0
    out = capsys.readouterr().out
    for word in ("rtmpose", "yolox", "Apache-2.0", "panoptic models fetch movenet-multipose"):
        assert word in out


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["check"], ["run: panoptic models fetch movenet-multipose"]),
        (["check", "rtmpose"], ["there is no file", "file"]),
        (["check", "nowhere.onnx"], ["nowhere.yaml"]),
        (["fetch", "rtmpose"], ["cannot be fetched"]),
        (["fetch", "nothing"], ["unknown model 'nothing'"]),
    ],
)
def test_what_cannot_be_done_is_one_line(capsys, arguments, words):
    assert main(["models", *arguments]) == 2
    captured = capsys.readouterr()
    assert captured.out == "" and captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err
