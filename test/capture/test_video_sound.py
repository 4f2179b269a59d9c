"""Sound tracks of videos: every sample once, on the time line of the frames."""

from fractions import Fraction
from itertools import pairwise

import av
import numpy as np
import pytest

from panoptic_ros.capture import VideoSource
from panoptic_ros.capture.sound import SoundSource, VideoSound, described_sound, known_tracks, open_sound
from panoptic_ros.capture.sound.track import SoundTrack, _SampleCounter, read_track
from panoptic_ros.errors import DataError, UsageError

RATE = 48_000
SECONDS = 1.2
CLICKS = np.arange(4800, int(SECONDS * RATE) - 2000, 9600)  # samples, in the time of the file


def clicking(rate=RATE, channels=1):
    """Silence with a click every 0.2 s, louder on the second channel."""
    samples = np.zeros((int(SECONDS * rate), channels), np.float32)
    samples[CLICKS * rate // RATE] = np.linspace(0.5, 0.8, channels)
    return samples


def make(path, codec="aac", *, rate=RATE, channels=1, video_at=0, sound_at=0, gap=None, frames=30):
    """A video of 25 Hz from `video_at` ms on, and clicks from `sound_at` on; none of `gap`, ms."""
    layout = {1: "mono", 2: "stereo"}[channels]
    with av.open(str(path), "w") as file:
        webm = path.suffix == ".webm"
        video = file.add_stream("libvpx" if webm else "libx264", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        video.codec_context.time_base = Fraction(1, 1000)
        sound = file.add_stream(codec, rate=rate)
        sound.layout = layout
        for k in range(frames):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 8 * k, np.uint8), format="bgr24")
            frame.pts, frame.time_base = 40 * k + video_at, Fraction(1, 1000)
            file.mux(video.encode(frame))
        file.mux(video.encode())
        pieces = [(0, None)] if gap is None else [(0, gap[0] * rate // 1000), (gap[1] * rate // 1000, None)]
        size = sound.codec_context.frame_size or 1024
        for begin, end in pieces:
            fifo = av.AudioResampler(sound.format.name, layout, rate, size)
            planar = np.ascontiguousarray(clicking(rate, channels)[begin:end].T)
            frame = av.AudioFrame.from_ndarray(planar, format="fltp", layout=layout)
            frame.sample_rate, frame.time_base = rate, Fraction(1, rate)
            frame.pts = begin + sound_at * rate // 1000
            for part in [*fifo.resample(frame), *fifo.resample(None)]:
                file.mux(sound.encode(part))
        file.mux(sound.encode())
    return path


def heard(source):
    """All samples by index, and where the clicks lie in the stamps, s."""
    blocks = list(source)
    assert all(b.first_sample >= a.first_sample + len(a.samples) for a, b in pairwise(blocks))
    assert all(b.stamp_ns > a.stamp_ns for a, b in pairwise(blocks))
    assert max(len(block.samples) for block in blocks) <= 0.1 * blocks[0].sample_rate
    return blocks, np.array(list(clicks_of(blocks)))


def clicks_of(blocks):
    """Instants of the largest samples, s."""
    for block in blocks:
        loud = np.abs(block.samples[:, 0])
        for k in np.flatnonzero(loud > 0.3):
            yield 1e-9 * block.stamp_ns + k / block.sample_rate


@pytest.mark.parametrize(
    ("name", "codec", "late"),
    [
        ("a.mp4", "aac", 0),
        ("a.mov", "pcm_s16le", 0),
        ("a.mkv", "pcm_s24le", 0),
        ("a.mov", "pcm_f32le", 0),
        ("a.mkv", "aac", 0),
        ("a.mp4", "flac", 120),
        ("a.mkv", "aac", 70),
        ("a.avi", "pcm_s16le", 0),
    ],
)
def test_clicks_lie_where_the_frames_beside_them_do(tmp_path, name, codec, late):
    source = VideoSound("cam", make(tmp_path / name, codec, sound_at=late), start_ns=5 * 10**9)
    assert isinstance(source, SoundSource)
    blocks, clicks = heard(source)
    np.testing.assert_allclose(clicks, 5 + CLICKS / RATE + 1e-3 * late, atol=0.5 / RATE)
    assert [b.stamp_ns for b in source] == [b.stamp_ns for b in blocks]  # as often as one likes


def test_opus_begins_where_it_was_recorded(tmp_path):
    """What it does to a click is not what it does to its place."""
    _, samples = read_track(make(tmp_path / "a.webm", "libopus"))
    places = [
        4800 * (2 * k + 1) + np.argmax(np.abs(samples[4800 * (2 * k + 1) - 200 :][:400])) - 200
        for k in range(len(CLICKS))
    ]
    np.testing.assert_allclose(places, CLICKS, atol=3)


def test_two_channels_of_another_rate(tmp_path):
    path = make(tmp_path / "a.mov", "pcm_s16le", rate=44_100, channels=2)
    blocks, clicks = heard(VideoSound("cam", path, clocks=("A", "B")))
    np.testing.assert_allclose(clicks, CLICKS / RATE, atol=1 / 44_100)
    samples = np.concatenate([block.samples for block in blocks])
    np.testing.assert_allclose(samples, clicking(44_100, 2), atol=1e-4)
    assert {block.clocks for block in blocks} == {("A", "B")} and blocks[0].sample_rate == 44_100
    rate, other = read_track(path, 1)
    assert rate == 44_100
    np.testing.assert_allclose(other, clicking(44_100, 2)[:, 1], atol=1e-4)
    with pytest.raises(UsageError, match="has 2 channels, counted from 0; there is no 2"):
        read_track(path, 2)
    with pytest.raises(DataError, match="3 channels of .* are named .A, B, C., but its sound has 2"):
        VideoSound("cam", path, clocks=("A", "B", "C"))


def test_sound_before_the_first_frame_has_stamps_before_it(tmp_path):
    path = make(tmp_path / "a.mkv", "pcm_s16le", video_at=300)
    _, clicks = heard(VideoSound("cam", path, start_ns=10**9))
    np.testing.assert_allclose(clicks, 0.7 + CLICKS / RATE, atol=1 / RATE)
    blocks, clicks = heard(VideoSound("cam", path))  # nothing lies before stamp 0
    np.testing.assert_allclose(clicks, CLICKS[1:] / RATE - 0.3, atol=1 / RATE)
    assert (blocks[0].first_sample, blocks[0].stamp_ns) == (14_400, 0)


def test_lost_sound_shows_in_the_count_of_samples(tmp_path):
    blocks, clicks = heard(VideoSound("cam", make(tmp_path / "a.mkv", "pcm_s16le", gap=(250, 650))))
    np.testing.assert_allclose(clicks, CLICKS[[0, 3, 4, 5]] / RATE, atol=1e-3)
    steps = [b.first_sample - a.first_sample - len(a.samples) for a, b in pairwise(blocks)]
    assert sum(steps) == pytest.approx(0.4 * RATE, abs=RATE / 1000) and steps.count(0) == len(steps) - 1


def test_other_stamps_of_the_frames_move_the_sound_with_them(tmp_path):
    """Frames that were stamped by a clock that runs 1 % fast, with jitter."""
    path = make(tmp_path / "a.mp4", "aac")
    noise = np.random.default_rng(0).uniform(-2e6, 2e6, 30)
    stamps = [int(7e9 + 1.01 * 4e7 * k + noise[k] * (k > 0)) for k in range(30)]
    _, clicks = heard(VideoSound("cam", path, stamps=stamps))
    np.testing.assert_allclose(clicks, 7 + 1.01 * CLICKS / RATE, atol=6e-3)


def test_sound_that_lasts_longer_than_the_images_is_no_damage(tmp_path):
    path = make(tmp_path / "a.mkv", frames=2, sound_at=1500)  # 0.08 s of images, 2.7 s of sound
    for told in (True, False):
        if not told:  # as by recorders that do not say how long each track is
            path.write_bytes(path.read_bytes().replace(b"DURATION", b"DURATIOM"))
        with VideoSource("cam", path) as source:
            assert len(list(source)) == 2 and (source.frame_count == 2) == told


def test_it_begins_where_it_is_told(tmp_path):
    path = make(tmp_path / "a.mov", "pcm_s16le")
    whole, begun = list(VideoSound("cam", path)), list(VideoSound("cam", path, from_sample=5000))
    assert (begun[0].first_sample, begun[0].stamp_ns) == (5000, 5000 * 10**9 // RATE + 1)
    after = np.concatenate([block.samples for block in whole])[5000:]
    np.testing.assert_array_equal(np.concatenate([block.samples for block in begun]), after)


def test_what_is_no_sound_is_told(tmp_path, make_video):
    silent = make_video(tmp_path / "silent.mp4", 3)
    with pytest.raises(DataError, match=r"sound of .*silent.mp4: there is no sound track"):
        open_sound(described_sound("video", "silent", [], path=str(silent)))
    (tmp_path / "text.mp4").write_text("nothing")
    with pytest.raises(DataError, match="text.mp4 cannot be opened: no video, or damaged"):
        VideoSound("cam", tmp_path / "text.mp4")


def test_closing_ends_what_is_under_way(tmp_path):
    with VideoSound("cam", make(tmp_path / "a.mov", "pcm_s16le")) as source:
        blocks = iter(source)
        next(blocks)
    assert list(blocks) == []


def test_times_that_jitter_are_used_and_the_count_goes_on():
    count = _SampleCounter(Fraction(1, 90_000))
    times = [Fraction(1), Fraction(1) + Fraction(1, 10) + Fraction(3, 1000), Fraction(12, 10)]
    placed = [count.place(time, 4800, RATE) for time in times]
    assert [first for first, _ in placed] == [0, 4800, 9600]
    assert [time for _, time in placed] == times
    assert count.place(Fraction(1), 4800, RATE) is None  # again: left out
    assert count.place(Fraction(2), 4800, RATE) == (9600 + int(0.8 * RATE), Fraction(2))


def test_integers_of_all_widths_are_parts_of_one(tmp_path):
    for codec in ("pcm_u8", "pcm_s16le", "pcm_s32le", "pcm_f64le"):
        _, samples = read_track(make(tmp_path / f"{codec}.mkv", codec))
        np.testing.assert_allclose(samples, clicking()[:, 0], atol=0.01)
    with SoundTrack(tmp_path / "pcm_u8.mkv", "it") as track:
        assert track.channels == 1


def unknown(path, number):
    """Make a sound track of an MP4 one of a codec that nobody knows."""
    data = bytearray(path.read_bytes())
    entries = [k for k in range(len(data)) if data[k : k + 4] == b"esds"]
    data[entries[number] : entries[number] + 4] = b"free"  # what says which codec it is
    at = data.rindex(b"mp4a", 0, entries[number])
    data[at : at + 4] = b"apac"  # spatial sound of a phone
    path.write_bytes(data)
    return path


@pytest.mark.parametrize("number", [0, 1])
def test_tracks_without_a_decoder_are_left_out(tmp_path, number):
    first, path = make(tmp_path / "a.mp4", "aac"), tmp_path / "b.mp4"
    with av.open(str(first)) as one, av.open(str(first)) as again, av.open(str(path), "w") as out:
        taken = [(one, one.streams.video[0]), (one, one.streams.audio[0]), (again, again.streams.audio[0])]
        streams = [out.add_stream_from_template(stream) for _, stream in taken]
        for (file, stream), target in zip(taken, streams):
            file.seek(0)
            for packet in file.demux(stream):
                if packet.dts is not None:
                    packet.stream = target
                    out.mux(packet)
    unknown(path, number)
    assert known_tracks(path) == [1 - number]
    source = VideoSource("cam", path)
    assert source.has_sound and source.sound_track == 1 - number and len(list(source)) == 30
    assert source.notices == (f"sound track {number + 1} has no decoder and is left out",)
    rate, samples = read_track(path)
    assert rate == RATE and np.abs(samples).max() > 0.3
    only = unknown(make(tmp_path / "c.mp4", "aac"), 0)
    silent = VideoSource("cam", only)
    assert not silent.has_sound and len(list(silent)) == 30 and known_tracks(only) == []
