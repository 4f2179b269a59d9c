"""Points of the surface in a capture folder."""

import numpy as np
import pytest

from panoptic_ros.io.surface_truth import part_of_bone, read_surface


@pytest.mark.parametrize(
    ("bone", "part"),
    [
        ("upperarm02.R", "r elbow"),
        ("finger3-2.L", "l wrist"),
        ("toe1-2.R", "r ankle"),
        ("upperleg01.L", "l knee"),
        ("shoulder01.R", "torso"),
        ("spine03", "torso"),
        ("neck01", ""),
        ("oculi01.L", "head"),
    ],
)
def test_bones_are_parts_of_ours(bone, part):
    assert part_of_bone(bone) == part


def test_a_folder_tells_where_the_surface_is_or_does_not(tmp_path):
    assert read_surface(tmp_path) is None
    np.savez(tmp_path / "truth.npz", times=np.array([0.0, 0.04]))
    assert read_surface(tmp_path) is None
    bones = np.array([["jaw", "foot.L"]])
    points = np.ones((2, 1, 2, 3))
    np.savez(tmp_path / "truth.npz", times=np.array([0.0, 0.04]), points=points, point_bone=bones)
    found = read_surface(tmp_path)
    assert found.stamps_ns.tolist() == [0, 40_000_000] and found.parts.tolist() == [["head", "l ankle"]]
