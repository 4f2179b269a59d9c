"""Plans of runs on files: what cameras know of each other, and what is told after the last frame."""

import json
from contextlib import ExitStack

import av
import captures
import numpy as np
import pytest

from panoptic_ros.capture import open_recording
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.running.plans.planning import plan_capture, plan_videos

COUNT = 12


@pytest.fixture
def folder(tmp_path):
    """Videos of two cameras at 25 Hz; the second begins 0.2 s late, and its frame 7 is damaged."""
    folder = tmp_path / "take"
    folder.mkdir()
    write_rig(folder / "rig.json", captures.RIG.subset(["cam0", "cam1"]))
    for name, late in (("cam0", 0), ("cam1", 5)):
        with av.open(str(folder / f"{name}.mp4"), "w") as file:
            stream = file.add_stream("mjpeg", rate=25)
            stream.width, stream.height, stream.pix_fmt = 1280, 720, "yuvj420p"
            for k in range(COUNT):
                frame = av.VideoFrame.from_ndarray(np.full((720, 1280, 3), 9 * k, np.uint8), format="bgr24")
                frame.pts = k + late
                file.mux(stream.encode(frame))
            file.mux(stream.encode())
    path = folder / "cam1.mp4"
    with av.open(str(path)) as file:
        place = [(packet.pos, packet.size) for packet in file.demux(video=0)][7]
    data = bytearray(path.read_bytes())
    data[place[0] : place[0] + place[1]] = bytes(place[1])
    path.write_bytes(data)
    return folder


@pytest.mark.parametrize("by_file", [False, True])
def test_cameras_that_are_opened_alone_begin_as_together(folder, by_file):
    if by_file:
        files = {name: folder / f"{name}.mp4" for name in ("cam0", "cam1")}
        plan = plan_videos(folder / "rig.json", files, skip_damaged=True)
    else:
        plan = plan_capture(folder, skip_damaged=True)
    sources = json.loads(json.dumps(plan.sources))  # as other processes get it
    assert any("cam1 begins 0.2 s after the first" in line for line in plan.notices)
    told = []
    with ExitStack() as stack:
        records = open_recording(plan.rig, sources, stack, told.append)
        stamps = {name: [frame.stamp_ns for frame in records["image", name]] for name in plan.rig.names}
    assert stamps["cam0"] == [40_000_000 * k for k in range(COUNT)]
    assert stamps["cam1"] == [200_000_000 + 40_000_000 * k for k in range(COUNT) if k != 7]
    (notice,) = told
    assert (notice.code, notice.values) == ("source.damaged", {"device": "cam1"})
    assert "cam1.mp4: 1 of 12 frames are damaged and left out" in notice.text
