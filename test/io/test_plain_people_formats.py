"""2D people of other programs are named with a remedy, and the program in the docs makes them ours."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from panoptic_ros.errors import DataError
from panoptic_ros.io.plain_formats import read_detections

DOCS = Path(__file__).parents[2] / "docs" / "files.md"
KEYPOINTS = [float(value) for k in range(17) for value in (10 + k, 20 + k, 0.5)]
ALPHAPOSE = [
    {"image_id": f"{number}.jpg", "category_id": 1, "keypoints": KEYPOINTS, "score": 2.9}
    for number in (0, 0, 2)
]


@pytest.mark.parametrize(
    ("document", "name"),
    [
        (ALPHAPOSE, "a result of AlphaPose or of COCO"),
        ([{"frame_id": 0, "instances": []}], "a result of MMPose of each frame"),
        ({"images": [], "annotations": [], "categories": []}, "annotations of COCO"),
    ],
)
def test_a_format_of_another_program_is_named(tmp_path: Path, document: Any, name: str) -> None:
    (tmp_path / "people.json").write_text(json.dumps(document))
    with pytest.raises(DataError, match=f"is {name}, which is not read; write it as panoptic-detections-1"):
        read_detections(tmp_path / "people.json")


@pytest.mark.parametrize("document", [[], {}, [1, 2], "text"])
def test_a_document_that_does_not_name_its_format(tmp_path: Path, document: Any) -> None:
    (tmp_path / "people.json").write_text(json.dumps(document))
    with pytest.raises(DataError, match="does not name its format, expected 'panoptic-detections-1'"):
        read_detections(tmp_path / "people.json")


def test_a_folder_of_openpose_is_named_whatever_its_files_are_called(tmp_path: Path) -> None:
    (tmp_path / "cam01_json").mkdir()
    for name in ("cam01_000000.json", "cam01_000000_keypoints.json"):
        file = tmp_path / "cam01_json" / name
        file.write_text(json.dumps({"version": 1.3, "people": []}))
        with pytest.raises(DataError, match="is a folder of OpenPose, which is not read"):
            read_detections(tmp_path)
        file.unlink()


def test_the_program_in_the_docs_reads_openpose(tmp_path: Path) -> None:
    program(tmp_path)
    for camera in ("cam1", "cam2"):
        (tmp_path / f"{camera}_json").mkdir()
        for number, people in enumerate(([], [KEYPOINTS[:3] * 25, KEYPOINTS[3:6] * 25])):
            document = {"version": 1.3, "people": [{"pose_keypoints_2d": row} for row in people]}
            path = tmp_path / f"{camera}_json" / f"{camera}_{number:012d}_keypoints.json"
            path.write_text(json.dumps(document))
    command = [sys.executable, "convert.py", "cam1_json", "cam2_json"]
    assert subprocess.run(command, cwd=tmp_path).returncode == 0
    people = read_detections(tmp_path / "detections.json")
    assert [frame.stamp_ns for frame in people.frames] == [0, 40_000_000]
    assert [frame.views["cam2"].points.shape for frame in people.frames] == [(0, 25, 2), (2, 25, 2)]
    assert people.joint_names[:2] == ("nose", "neck")
    assert people.frames[1].views["cam1"].points[1, 24].tolist() == [11, 21]


def program(folder: Path) -> None:
    """Write the program in the docs as convert.py."""
    section = DOCS.read_text().partition("2D people of other programs become such a file")[2]
    found = re.search(r"\n((?:    [^\n]*\n|\n)+)", section.partition("\n")[2])
    assert found is not None
    (folder / "convert.py").write_text("\n".join(line[4:] for line in found.group(1).splitlines()))


def test_the_program_in_the_docs_reads_alphapose_by_the_numbers_of_images(tmp_path: Path) -> None:
    program(tmp_path)
    for camera in ("cam1", "cam2"):
        (tmp_path / f"{camera}.json").write_text(json.dumps(ALPHAPOSE))
    command = [sys.executable, "convert.py", "cam1.json", "cam2.json"]
    assert subprocess.run(command, cwd=tmp_path).returncode == 0
    people = read_detections(tmp_path / "detections.json")
    assert [frame.index for frame in people.frames] == [0, 2]
    assert [frame.stamp_ns for frame in people.frames] == [0, 80_000_000]
    assert people.frames[0].views["cam2"].points.shape == (2, 17, 2)
    assert people.joint_names[0] == "nose"
    assert people.frames[1].views["cam1"].points[0, 16].tolist() == [26, 36]
