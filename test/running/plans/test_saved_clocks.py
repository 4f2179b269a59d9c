"""Saved clocks and line delays of a rig and a recording."""

import json

import captures
import pytest
from rolling import with_line_delays as rolling

from panoptic_ros.domain import DetectionSet
from panoptic_ros.errors import UsageError
from panoptic_ros.io.clock_files import SavedClock
from panoptic_ros.running.plans.saved_clocks import RecordingClocks, saved_clocks, with_line_delays

START, SECOND = 10**13, 10**9
NAMES = captures.RIG.names


def written(folder, reference_ns=START, **cameras):
    path = folder / "clocks.json"
    clocks = {name: {"offset_s": 0.05, "drift_ppm": 1000.0, **more} for name, more in cameras.items()}
    path.write_text(
        json.dumps({"format": "panoptic-clocks-1", "reference_ns": reference_ns, "cameras": clocks})
    )
    return path


def sets(seconds=10, start=START):
    """One set per second."""
    stamps = [start + k * SECOND for k in range(seconds + 1)]
    views = [[captures.view(c, k, stamp) for c in captures.RIG.cameras] for k, stamp in enumerate(stamps)]
    hashed = captures.SKELETON.hash
    return [DetectionSet(k, at, hashed, tuple(own)) for k, (at, own) in enumerate(zip(stamps, views))]


@pytest.mark.parametrize("before_s", [0, 5, 10, -0.5])
def test_drifts_count_in_the_recording_of_the_reference(tmp_path, before_s):
    reference = START + round(before_s * SECOND)
    clocks = RecordingClocks.of(written(tmp_path, reference, cam0={}), NAMES, sets())
    for stamp in (START, START + 7 * SECOND):
        expected = stamp + SECOND // 20 + round(1e-3 * (stamp - reference))
        assert clocks.drifting and clocks.corrected("cam0", stamp) == expected
        assert clocks.corrected("cam1", stamp) == stamp
    assert any("drift +1000 ppm" in line for line in clocks.told(NAMES))


def test_elsewhere_offsets_are_added_without_drifts(tmp_path):
    clocks = RecordingClocks.of(written(tmp_path, START - 3600 * SECOND, cam0={}), NAMES, sets())
    assert clocks.corrected("cam0", START + SECOND) == START + SECOND + SECOND // 20
    (line,) = [line for line in clocks.told(NAMES) if "cam0 drifts" in line]
    assert "+60.0 ms a minute" in line


def test_without_a_reference_offsets_hold_at_the_first_timestamp(tmp_path):
    clocks = RecordingClocks.of(written(tmp_path, None, cam0={}), NAMES, sets())
    assert clocks.corrected("cam0", START + SECOND) == START + SECOND + SECOND // 20 + SECOND // 1000


def test_saved_line_delays_replace_those_of_the_rig():
    rig = rolling(captures.RIG, (10.0,))
    saved = {
        "cam0": SavedClock(0.0, line_delay_us=25.0),
        "cam1": SavedClock(0.0, line_delay_us=-0.3),  # noise about a global shutter
        "cam2": SavedClock(0.01),
    }
    found = with_line_delays(rig, saved)
    assert [camera.line_delay_us for camera in found.cameras] == [25.0, 0.0, 10.0, 10.0]
    assert with_line_delays(rig, {"cam2": SavedClock(0.01)}) is rig


def test_cameras_that_are_not_observable_keep_their_stamps(tmp_path):
    path = written(tmp_path, cam0={"observable": False, "offset_s": None}, cam1={})
    assert list(saved_clocks(path, NAMES)) == ["cam1"]
    with pytest.raises(UsageError, match="corrects none of the cameras cam0, cam2"):
        saved_clocks(path, ("cam0", "cam2"))
