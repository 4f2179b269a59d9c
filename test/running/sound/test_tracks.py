"""Runs on videos whose sound is all that tells when they were taken."""

import json
from dataclasses import replace

import av
import numpy as np
import pytest

from panoptic_ros.capture import CaptureFolder, open_capture_folder
from panoptic_ros.domain import Rig
from panoptic_ros.errors import DataError
from panoptic_ros.io.detector_context import noise_only
from panoptic_ros.io.rigs import write_rig
from panoptic_ros.io.wav import write_wav
from panoptic_ros.running.plans.options import RunOptions
from panoptic_ros.running.plans.planning import plan_capture, plan_videos
from panoptic_ros.simulation import SKELETON, scene, simulate
from panoptic_ros.simulation.generators import SAMPLE_RATE, Generator, filmed
from panoptic_ros.view.video_file import VideoAudio, VideoFile

SECOND = 10**9
SECONDS = 1.7
HOUSE = Generator("H", "25", 36_000 * 25)
OTHER = Generator("B", "29.97", (11 * 3600 + 17) * 30 + 4, drift_ppm=31.0)
FREE = Generator("", "30", 0, drift_ppm=-20.0)  # what takes the pictures: it hears, and is locked to nothing
BEGINS = {"cam00": 0.0, "cam01": 0.31, "cam02": 0.754}  # true s, of the first frames
SOUND_LATE = 0.05


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A capture folder of three cameras, still without videos."""
    monkeypatch.setattr(RunOptions, "detector", lambda options: (SKELETON, {}))
    rig = simulate(scene("clean-4p5v"), 0, 1).rig
    cameras = tuple(
        replace(rig.cameras[k], name=name, image_size=(16, 16), clock="") for k, name in enumerate(BEGINS)
    )
    write_rig(tmp_path / "rig.json", Rig(cameras))
    return tmp_path


def shoot(folder, channels, names=tuple(BEGINS), suffix=".mp4", clocks=None):
    """Videos of which every camera hears these generators; None is talk, and no channel no sound."""
    for name in names:
        begin = BEGINS[name]
        own = channels[name] if isinstance(channels, dict) else channels
        noise = np.random.default_rng(len(name)).normal(0.0, 0.05, int(SECONDS * SAMPLE_RATE))
        heard = [
            noise if one is None else filmed([one], FREE, begin + SOUND_LATE, SECONDS)[:, 0] for one in own
        ]
        sound = VideoAudio(np.stack(heard, axis=1), SAMPLE_RATE, SOUND_LATE) if heard else None
        with VideoFile(folder / f"{name}{suffix}", (16, 16), 30.0, sound=sound) as video:
            for k in range(int(SECONDS * 30)):
                video.write(np.full((16, 16, 3), k, np.uint8))
    if clocks is not None:
        document = json.loads((folder / "rig.json").read_text())
        for camera in document["cameras"]:
            camera["clock"] = clocks[camera["name"]]
        (folder / "rig.json").write_text(json.dumps(document))


def of_sound(plan):
    """Notices of a plan, without the one that its detector has no model card."""
    return [line for line in plan.notices if line not in noise_only(())]


def begins(plan, generator):
    """Master times of the first frames of all cameras, as true s."""
    zero = generator.stamp_ns(0.0)
    return np.array([(plan.shifts[name] - zero) / SECOND for name in plan.rig.names])


def test_videos_with_timecode_need_nothing_else(folder):
    shoot(folder, [HOUSE])
    plan = plan_capture(folder)
    np.testing.assert_allclose(begins(plan, HOUSE), list(BEGINS.values()), atol=3e-5)
    assert plan.devices == tuple(BEGINS) == tuple(plan.rig.clock_of(name) for name in BEGINS)
    assert of_sound(plan) == []
    videos = plan_videos(folder / "rig.json", {name: folder / f"{name}.mp4" for name in BEGINS})
    assert videos.shifts == plan.shifts


def test_one_timecode_on_both_channels_is_heard_once_and_talk_beside_it_does_not_matter(folder):
    shoot(folder, {"cam00": [HOUSE, HOUSE], "cam01": [None, HOUSE], "cam02": [HOUSE]}, suffix=".mov")
    plan = plan_capture(folder)
    np.testing.assert_allclose(begins(plan, HOUSE), list(BEGINS.values()), atol=3e-5)
    assert [sound["clocks"] for sound in plan.sounds] == [["cam00", ""], ["", "cam01"], ["cam02"]]


def test_the_track_with_timecode_is_found_among_several_or_named(folder, tmp_path):
    shoot(folder, [None])
    with_timecode = tmp_path / "more"
    with_timecode.mkdir()
    shoot(with_timecode, [HOUSE])
    for name in BEGINS:
        path, other, both = folder / f"{name}.mp4", with_timecode / f"{name}.mp4", folder / f"{name}.mov"
        with av.open(str(path)) as talk, av.open(str(other)) as heard, av.open(str(both), "w") as out:
            taken = [(talk, talk.streams.video[0])]
            taken += [(file, file.streams.audio[0]) for file in (talk, heard)]
            streams = [out.add_stream_from_template(stream) for _, stream in taken]
            for (file, stream), target in zip(taken, streams):
                file.seek(0)
                for packet in file.demux(stream):
                    if packet.dts is not None:
                        packet.stream = target
                        out.mux(packet)
        path.unlink()
    found = plan_capture(folder)
    assert [sound["track"] for sound in found.sounds] == [1, 1, 1]
    np.testing.assert_allclose(begins(found, HOUSE), list(BEGINS.values()), atol=1e-3)  # FFmpeg's edit lists
    (folder / "sound.yaml").write_text("".join(f"{n}.mov: {{clocks: [{n}], track: 1}}\n" for n in BEGINS))
    assert plan_capture(folder).shifts == found.shifts
    (folder / "sound.yaml").write_text("".join(f"{n}.mov: {{clocks: [{n}], track: 2}}\n" for n in BEGINS))
    with pytest.raises(DataError, match="there are 2 tracks, counted from 0, and no 2"):
        plan_capture(folder)


def test_two_timecodes_that_one_camera_hears_align_all(folder):
    shoot(folder, {"cam00": [HOUSE, OTHER], "cam01": [OTHER], "cam02": [HOUSE]})
    (folder / "sound.yaml").write_text("cam00.mp4: [H, B]\ncam01.mp4: [B]\ncam02.mp4: [H]")
    plan = plan_capture(folder)
    np.testing.assert_allclose(begins(plan, HOUSE), list(BEGINS.values()), atol=3e-5)
    plan = plan_capture(folder, cameras=["cam01", "cam02"])  # the first is only heard
    np.testing.assert_allclose(begins(plan, HOUSE), list(BEGINS.values())[1:], atol=3e-5)
    assert plan.devices == tuple(BEGINS)


def test_talk_groups_nothing_and_is_told(folder):
    shoot(folder, [None])
    plan = plan_capture(folder)
    assert plan.devices == () and plan.shifts == {} and [c.clock for c in plan.rig.cameras] == [""] * 3
    (told,) = of_sound(plan)
    assert told.startswith("no timecode in the first 5 s of the sound of cam00.mp4, cam01.mp4, cam02.mp4: th")


def test_videos_without_sound_are_as_ever(folder):
    shoot(folder, [])
    plan = plan_capture(folder)
    assert plan.devices == () and of_sound(plan) == []


def test_sound_of_frames_that_have_stamps_is_left_alone(folder):
    shoot(folder, [HOUSE])
    rows = [f"{name},{k},{k * 33_000_000 + 7}" for name in BEGINS for k in range(51)]
    (folder / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    plan = plan_capture(folder)
    assert plan.devices == ()
    (told,) = of_sound(plan)
    assert told.startswith("the sound of cam00.mp4, cam01.mp4, cam02.mp4 is not used: the frames")


def test_stamps_on_the_clocks_of_the_cameras_are_held_against_their_sound(folder):
    """As of webcams: a table has the stamps of the frames, by each camera's own clock."""
    shoot(folder, [HOUSE], clocks={name: name for name in BEGINS})
    late = {"cam00": 500, "cam01": 7000, "cam02": 20}  # s, of the clocks
    stamps = {name: [late[name] * SECOND + round(k * SECOND / 30) for k in range(51)] for name in BEGINS}
    rows = [f"{name},{k},{stamp}" for name, own in stamps.items() for k, stamp in enumerate(own)]
    (folder / "timestamps.csv").write_text("\n".join(["camera,frame,stamp_ns", *rows]))
    plan = plan_capture(folder)
    firsts = [late[name] + begin for name, begin in zip(BEGINS, begins(plan, HOUSE))]
    np.testing.assert_allclose(firsts, list(BEGINS.values()), atol=3e-5)


@pytest.mark.parametrize(
    ("channels", "names", "message"),
    [
        (
            {"cam00": [HOUSE], "cam01": [None], "cam02": [HOUSE]},
            None,
            "cam01 have neither stamps nor timecode in their sound, but cam00, cam02 have timecode",
        ),
        ({"cam00": [HOUSE], "cam01": [HOUSE], "cam02": []}, None, "cam02 have neither stamps nor timecode"),
        (
            [HOUSE, OTHER],
            None,
            r"cam00.mp4 has two timecodes, 10:00:00:\d+ and 11:00:17:\d+, on channels 0 and 1",
        ),
        (
            {"cam00": [HOUSE], "cam01": [OTHER], "cam02": [HOUSE]},
            None,
            "never overlap: cam00, cam02 from 10:00:00.0 to 10:00:02.4; cam01 from 11:00:57.1",
        ),
        (
            {"cam00": [OTHER, HOUSE], "cam01": [OTHER], "cam02": [HOUSE]},
            "cam00.mp4: [H, B]\ncam01.mp4: [B]\ncam02.mp4: [H]",
            "clock B has 25 fps at cam00 and 29.97 fps at",
        ),
        (
            {"cam00": [HOUSE], "cam01": [OTHER], "cam02": [HOUSE]},
            "cam00.mp4: [H]\ncam01.mp4: [B]\ncam02.mp4: [H]",
            "clock cam01, which stamps cam01: .*no recording has the timecodes of both B and H",
        ),
        (
            [HOUSE],
            "cam00.mp4: [H, B]\ncam01.mp4: [H]\ncam02.mp4: [H]",
            "2 channels of .*cam00.mp4 are named .H, B., but its sound has 1",
        ),
        (
            [HOUSE],
            "cam00.mp4: {clocks: [H], start_ns: 5}",
            "the sound of a video begins where the video does",
        ),
        ([HOUSE], "cam03.mp4: [H]", "names cam03.mp4; .* has cam00.mp4, cam01.mp4, cam02.mp4"),
    ],
)
def test_what_would_be_grouped_wrongly_is_told(folder, channels, names, message):
    shoot(folder, channels)
    if names:
        (folder / "sound.yaml").write_text(names)
    with pytest.raises(DataError, match=message):
        plan_capture(folder)


def test_timecode_beside_videos_that_have_no_stamps_is_told(folder):
    shoot(folder, [], clocks=dict.fromkeys(BEGINS, "H"))
    write_wav(folder / "box.wav", SAMPLE_RATE, filmed([HOUSE], FREE, 0.0, SECONDS))
    (folder / "sound.yaml").write_text("box.wav: [H]")
    with pytest.raises(DataError, match="cam00, cam01, cam02 have neither .*but the rig states that time"):
        plan_capture(folder)


def test_a_camera_with_a_recording_of_its_own_needs_no_track(folder):
    shoot(folder, [None])
    write_wav(folder / "cam00.wav", SAMPLE_RATE, filmed([HOUSE], FREE, 0.0, SECONDS))
    with open_capture_folder(folder) as capture:
        assert isinstance(capture, CaptureFolder)
        kinds = {sound["device"]: sound["kind"] for sound in capture.sounds}
    assert kinds == {"cam00": "wav", "cam01": "video", "cam02": "video"}
    (folder / "sound.yaml").write_text("cam00.wav: [cam00]\ncam00.mp4: [cam00]")
    with pytest.raises(DataError, match="names two recordings of cam00; remove cam00.mp4"):
        open_capture_folder(folder)
