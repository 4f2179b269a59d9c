"""The public Python API: the names of the package, and what README and docs say of them."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import panoptic_ros
from panoptic_ros.io.plain_formats import read_skeletons
from panoptic_ros.kernels.sources import closure
from panoptic_ros.running.simulations.takes import write_take

ROOT = Path(panoptic_ros.__file__).parents[1]
pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="the documents are in the checkout only")


def section(document, title):
    """The text of a section of a document."""
    return (ROOT / document).read_text().split(f"## {title}\n", 1)[1].split("\n## ", 1)[0]


def test_the_lines_of_the_readme_run(tmp_path, monkeypatch, capsys):
    (code,) = re.findall(r"```python\n(.*?)```", section("README.md", "From Python"), re.DOTALL)
    assert code.count("\n") <= 12 and "panoptic_ros." in code and "from panoptic_ros" not in code
    write_take("clean-4p5v", tmp_path / "sim", frames=6)
    monkeypatch.chdir(tmp_path)
    exec(code, {})
    told = capsys.readouterr().out
    frames = read_skeletons(tmp_path / "sim" / "skeletons.json.gz").frames
    people = sum(len(frame.ids) for frame in frames)
    assert len(frames) == 6 and people > 0
    assert told.count("ns, person") == people and told.count("Neck [") == people


def test_names_are_sorted_documented_and_there():
    listed = re.findall(r"^\| `(\w+)` \|", section("docs/architecture.md", "The Python API"), re.MULTILINE)
    assert panoptic_ros.__all__ == sorted(panoptic_ros.__all__) == sorted(listed)
    for name in listed:
        assert getattr(panoptic_ros, name).__doc__
    assert set(listed) <= set(dir(panoptic_ros))
    with pytest.raises(AttributeError, match="no attribute 'nothing'"):
        _ = panoptic_ros.nothing


def test_documents_import_public_names_only():
    for document in ("README.md", "docs/architecture.md"):
        assert "from panoptic_ros." not in (ROOT / document).read_text()


def test_the_package_and_its_version_need_no_numpy():
    code = (
        "import sys, panoptic_ros.cli.main as main\nsys.argv = ['panoptic', '--version']\n"
        "try: main.program()\nexcept SystemExit: pass\nprint('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["panoptic", panoptic_ros.__version__, "False"]


def test_people_are_rows_of_a_frame(tmp_path):
    write_take("clean-4p5v", tmp_path, seed=1, frames=4)
    rig = panoptic_ros.load_rig(str(tmp_path), cameras=["cam00", "cam01", "cam02"])
    recording = panoptic_ros.open_detections(
        tmp_path / "detections.json.gz", rig, {"refinement": {"lag": 0.0}}
    )
    for frame in panoptic_ros.solve(recording):
        assert [person.id for person in frame.people] == frame.ids.tolist()
        for k, person in enumerate(frame.people):
            assert np.array_equal(person.positions, frame.positions[k], equal_nan=True)
            assert person.covariances.shape == (len(recording.joint_names), 3, 3)


def test_kernels_do_not_depend_on_the_public_names():
    sources = {path.relative_to(ROOT).parts[1] for path in closure("panoptic_ros.solving.joints")}
    assert not sources & {"io", "graph", "running"}
