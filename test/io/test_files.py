"""Files are written whole or not at all, and errors name them."""

import gzip

import pytest

from panoptic_ros.errors import DataError, EnvironmentProblem
from panoptic_ros.io.files import (
    atomic_path,
    file_errors,
    known,
    read_json,
    read_yaml,
    write_bytes,
    write_json,
)
from panoptic_ros.io.folders import staged_folder


def test_a_failure_leaves_the_old_file(tmp_path):
    path = tmp_path / "a" / "result.json"
    write_bytes(path, b"old")
    with pytest.raises(ValueError, match="mine"), atomic_path(path) as temporary:
        temporary.write_bytes(b"half")
        raise ValueError("mine")
    assert path.read_bytes() == b"old" and list(path.parent.iterdir()) == [path]


def test_equal_documents_give_equal_bytes(tmp_path):
    for name in ("a.json.gz", "b.json.gz"):
        write_json(tmp_path / name, {"x": [1.5, None]})
    assert (tmp_path / "a.json.gz").read_bytes() == (tmp_path / "b.json.gz").read_bytes()
    assert read_json(tmp_path / "a.json.gz") == {"x": [1.5, None]}


def test_nan_is_no_json(tmp_path):
    with pytest.raises(ValueError, match="JSON"):
        write_json(tmp_path / "a.json", float("nan"))
    assert list(tmp_path.iterdir()) == []


def test_figures_that_are_not_known_become_null(tmp_path):
    document = {"a": [1.5, float("nan")], "b": ({"c": float("inf")}, "x", 3)}
    write_json(tmp_path / "a.json", known(document))
    assert read_json(tmp_path / "a.json") == {"a": [1.5, None], "b": [{"c": None}, "x", 3]}


@pytest.mark.parametrize("data", [b"", b"{", b"\xff\xfe", gzip.compress(b"[1]", mtime=0)[:-6]])
def test_what_is_no_json_is_named(tmp_path, data):
    path = tmp_path / "x.json"
    path.write_bytes(data)
    with pytest.raises(DataError, match=r"x\.json"):
        read_json(path)


def test_yaml_errors_tell_the_line(tmp_path):
    path = tmp_path / "x.yaml"
    path.write_text("a: 1\nb: [1\n")
    with pytest.raises(DataError, match=r"x\.yaml.*line 3"):
        read_yaml(path)


@pytest.mark.parametrize(
    ("cause", "kind"),
    [
        (FileNotFoundError(2, "No such file"), DataError),
        (IsADirectoryError(21, "Is a directory"), DataError),
        (PermissionError(13, "Permission denied"), EnvironmentProblem),
        (OSError(28, "No space left on device"), EnvironmentProblem),
    ],
)
def test_trouble_of_the_system_becomes_one_line(tmp_path, cause, kind):
    with pytest.raises(kind, match=f"cannot write .*{cause.strerror}"), file_errors(tmp_path, "write"):
        raise cause


def test_staged_folder_replaces_its_own_and_keeps_the_rest(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "mine").write_text("kept")
    (out / "a").write_text("old")
    with staged_folder(out) as folder:
        (folder / "a").write_text("new")
        assert (out / "a").read_text() == "old"
    assert {p.name: p.read_text() for p in out.iterdir()} == {"mine": "kept", "a": "new"}
    with pytest.raises(KeyError), staged_folder(out) as folder:
        (folder / "a").write_text("half")
        raise KeyError
    assert (out / "a").read_text() == "new" and list(tmp_path.iterdir()) == [out]
