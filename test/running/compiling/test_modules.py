"""What Python makes of sources is kept ahead, even where it is told not to keep it."""

from panoptic_ros.running.compiling.modules import compile_modules


def test_modules_are_compiled_whatever_the_environment_says(monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("PYTHONPYCACHEPREFIX", str(tmp_path))
    compile_modules("panoptic_ros.domain")
    kept = {path.name.partition(".")[0] for path in tmp_path.rglob("panoptic_ros/domain/*.pyc")}
    assert {"__init__", "camera", "detections"} <= kept
    assert list(tmp_path.rglob("numpy/_core/multiarray.*.pyc"))  # what they load besides
