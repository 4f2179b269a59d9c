"""One of each: what is done in one place is done nowhere else, and `panoptic solve` starts with little."""

import re
import subprocess
import sys
from pathlib import Path

import layers
import pytest

import panoptic_ros
from panoptic_ros.cli.main import main

SOURCES = {
    name: path.read_text() for name, path in layers.modules(Path(panoptic_ros.__file__).parent).items()
}
ONE_PLACE = {
    "the tracker of points": (r"calcOpticalFlowPyrLK", {"geometry.optical_flow"}),
    "progress bars": (r"^(?:from|import) rich", {"view.progress"}),
    "Cauchy's weight": (r"/ \(1\.0 \+ \(?[\w.]+ / [\w.]+\)? ?\*\* ?2\)", set()),  # 1 / geometry.robust.growth
    "the growth of its noise": (r"(?i)\(?1\.0 \+ [^=\n]*/ \(?(?:cauchy|outlier|soft|far) ?\*\* ?2", set()),
    "its inverse square of a scale": (r"(?i)\bsoftness = 1\.0 /", set()),
    "numba's own classes": (r"numba\.core\.caching", {"kernels.cache"}),
    "the order of numbers in kernels": (r"^def (?:median|nth_smallest|descending)\b", set()),
}
HEAVY = ("av", "cv2", "matplotlib", "onnxruntime", "rclpy", "rich", "rosbags")
SOLVE = """
import sys
from panoptic_ros.cli.main import main
code = main(sys.argv[1:])
print(code, *sorted(sys.modules))
"""


@pytest.mark.parametrize("what", ONE_PLACE)
def test_it_is_in_one_place(what):
    pattern, places = ONE_PLACE[what]
    found = {name for name, source in SOURCES.items() if re.search(pattern, source, re.M)}
    assert found == {f"panoptic_ros.{place}" for place in places}


@pytest.mark.parametrize(
    ("what", "source"),
    [
        ("Cauchy's weight", "weights = given / (1.0 + (residual / cauchy) ** 2)\n"),
        ("Cauchy's weight", "weight = dt / (1.0 + square / SOFT**2)\n"),
        ("the growth of its noise", "less = (1.0 + odd / CAUCHY**2)[:, None, None]\n"),
        ("the growth of its noise", "noise = sigma**2 * (1.0 + d**2 / (OUTLIER**2 * (e + sigma**2)))\n"),
        ("its inverse square of a scale", "softness = 1.0 / (cauchy * cauchy)\n"),
        ("progress bars", "from rich.progress import Progress\n"),
    ],
)
def test_a_second_one_would_be_found(what, source):
    assert re.search(ONE_PLACE[what][0], source, re.M)


def test_numba_is_not_patched():
    """Nothing in the room of kernels replaces an attribute of a module or class of numba."""
    for name, source in SOURCES.items():
        if name.startswith("panoptic_ros.kernels"):
            assert not re.search(r"setattr\(|^numba\.\S+ = |_library_class|pipeline_class", source, re.M), (
                name
            )


def test_solving_loads_nothing_that_it_does_not_need(tmp_path):
    """The budget of a start: what only images, sound, bags and plots need is loaded by them."""
    assert main(["simulate", "clean-4p5v", "--frames", "3", "--out", str(tmp_path)]) == 0
    files = ["--rig", tmp_path / "rig.json", "--detections", tmp_path / "detections.json.gz"]
    command = [sys.executable, "-c", SOLVE, "solve", *files, "--out", tmp_path / "s.json", "--quiet"]
    subprocess.run(command, capture_output=True, check=True)  # whatever has to be compiled is now
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    code, *loaded = done.stdout.split()
    assert code == "0" and [name for name in HEAVY if name in loaded] == []
