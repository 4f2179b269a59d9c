"""CMU's sync tables beside images: each frame at its time, and frames without one left out."""

import json

import numpy as np
import pytest

from panoptic_ros.capture import DepthSource, open_capture_folder
from panoptic_ros.domain import Camera, Rig
from panoptic_ros.errors import DataError
from panoptic_ros.geometry import Intrinsics, Rigid
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.view.pictures import write_image

K = Intrinsics(np.array([[10.0, 0, 4], [0, 10, 3], [0, 0, 1]]), np.zeros(5))
KINDS = {"00_00": "hd", "00_01": "hd", "01_01": "vga", "50_02": "kinect-color"}
HD = [53000.004 + 33.367 * k for k in range(8)]
VGA = [53003.1 + 40.0 * k for k in range(7)]
COLOR = [-1.0, 53020.5, 53053.8, -1.0, 53120.4]
FRAMES = 5


@pytest.fixture
def folder(tmp_path):
    cameras = [Camera(name, (8, 6), K, Rigid.identity(), type=kind) for name, kind in KINDS.items()]
    write_rig(tmp_path / "rig.json", Rig(tuple(cameras)))
    for name in KINDS:
        (tmp_path / name).mkdir()
        for k in range(FRAMES):
            write_image(tmp_path / name / f"{k}.png", np.full((6, 8, 3), k, np.uint8))
    systems = {"hd": {"univ_time": HD}, "vga": {"univ_time": VGA}}
    (tmp_path / "synctables_170404.json").write_text(json.dumps(systems))
    color = {"index": list(range(5)), "univ_time": COLOR}
    tables = {"kinect": {"color": {"KINECTNODE2": color}, "depth": {"KINECTNODE2": color}}}
    (tmp_path / "ksynctables_170404.json").write_text(json.dumps(tables))
    return tmp_path


def frames_of(capture):
    return {
        source.camera: [(f.frame_number, f.stamp_ns, int(f.image[0, 0, 0])) for f in source]
        for source in capture.sources
    }


def test_every_frame_has_the_time_of_its_table(folder):
    with open_capture_folder(folder) as capture:
        frames = frames_of(capture)
        assert [s.frame_count for s in capture.sources] == [5, 5, 5, 3]
    hd = [(k, round(1e6 * HD[k + 1]), k) for k in range(FRAMES)]  # CMU's demo takes the entry after
    assert frames["00_00"] == frames["00_01"] == hd
    assert frames["01_01"] == [(k, round(1e6 * VGA[k]), k) for k in range(FRAMES)]
    assert frames["50_02"] == [(k, round(1e6 * (COLOR[k] - 6.25)), k) for k in (1, 2, 4)]
    assert any("entry N + 1 of hd.univ_time" in line for line in capture.notices)


def test_timestamps_of_the_folder_go_before_the_tables(folder):
    rows = [f"{name},{k},{k + 1}" for name in KINDS for k in range(FRAMES)]
    (folder / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    with open_capture_folder(folder) as capture:
        assert [stamp for _, stamp, _ in frames_of(capture)["50_02"]] == [1, 2, 3, 4, 5]
        assert not capture.notices


def test_depth_maps_stay_with_their_frames(folder):
    (folder / "50_02_depth").mkdir()
    for k in range(FRAMES):
        write_image(folder / "50_02_depth" / f"{k}.png", np.full((6, 8), 1000 + k, np.uint16))
    with open_capture_folder(folder) as capture:
        (source,) = [s for s in capture.sources if isinstance(s, DepthSource)]
        assert [round(1000 * float(source.depth_of(f).depth[0, 0])) for f in source] == [1001, 1002, 1004]


def test_what_the_tables_lack_is_told(folder):
    (folder / "ksynctables_170404.json").unlink()
    with pytest.raises(DataError, match="have no color/KINECTNODE2 for camera 50_02; they have hd, vga"):
        open_capture_folder(folder)
    with open_capture_folder(folder, cameras=["00_00", "01_01"]) as capture:
        assert len(capture.sources) == 2


def test_tables_of_another_time_are_told(folder):
    path = folder / "synctables_170404.json"
    path.write_text(json.dumps({"hd": {"univ_time": HD}, "vga": {"univ_time": [-1.0] * 9}}))
    with pytest.raises(DataError, match="sync table of camera 01_01 has no time for any of the 5 frames"):
        open_capture_folder(folder)
    path.write_text(json.dumps({"hd": {"univ_time": HD[::-1]}, "vga": {"univ_time": VGA}}))
    with pytest.raises(DataError, match="sync table of camera 00_00: the stamp of frame 1"):
        open_capture_folder(folder)
