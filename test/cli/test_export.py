"""`panoptic export`: a file by its suffix."""
from recorded_scene import write_scene

from panoptic_ros.cli.main import main


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
