"""TRC and MOT for OpenSim."""

import numpy as np
import pytest
from bodies import BODY, MODEL, placed, some_pose
from scipy.spatial.transform import Rotation

from panoptic_ros.domain.subjects import BodyState
from panoptic_ros.export.opensim import mot_text, trc_text


@pytest.fixture(scope="module")
def states():
    found = []
    for k in range(4):
        frames, places = placed(some_pose(k))
        found.append(BodyState(10_000_000 * k, 3, places, frames))
    return found


def test_markers_are_joint_centres_in_mm_with_y_up(states):
    lines = trc_text(MODEL, states, "a.trc").splitlines()
    rate, _, frames, markers, unit = lines[2].split("\t")[:5]
    assert (float(rate), frames, markers, unit) == (pytest.approx(100), "4", "21", "mm")
    assert [name for name in lines[3].split("\t")[2:] if name] == list(MODEL.names)
    assert lines[4].split() == [f"{axis}{k}" for k in range(1, 22) for axis in "XYZ"] and lines[5] == ""
    rows = np.array([line.split("\t") for line in lines[6:]], float)
    assert rows[:, 0].tolist() == [1, 2, 3, 4] and rows[:, 1] == pytest.approx([0, 0.01, 0.02, 0.03])
    x, y, z = rows[:, 2:].reshape(4, 21, 3).transpose(2, 0, 1)
    own = 1e3 * np.array([state.places for state in states])
    assert np.stack([x, -z, y], -1) == pytest.approx(own, abs=1e-3)


def test_joint_angles_give_the_segments_back(states):
    lines = mot_text(MODEL, states, "a").splitlines()
    begin = lines.index("endheader") + 1
    assert "nRows=4" in lines and "inDegrees=yes" in lines
    columns = lines[begin].split("\t")
    assert f"nColumns={len(columns)}" in lines
    for line, state in zip(lines[begin + 1 :], states):
        row = dict(zip(columns, map(float, line.split("\t"))))
        root = Rotation.from_euler("ZYX", [row[f"root_{w}"] for w in ("yaw", "pitch", "roll")], degrees=True)
        frames, places = [root.as_matrix()], [np.array([row[f"root_t{axis}"] for axis in "xyz"])]
        for s in range(1, 21):
            names = MODEL.joint_names[3 * s - 3 : 3 * s]
            own = Rotation.from_euler(MODEL.orders[s].upper(), [row[name] for name in names], degrees=True)
            above = MODEL.parents[s]
            places.append(places[above] + frames[above] @ BODY.offsets[s])
            frames.append(frames[above] @ own.as_matrix())
        assert np.array(places) == pytest.approx(state.places, abs=1e-5)
        assert np.array(frames) == pytest.approx(state.frames, abs=1e-6)
