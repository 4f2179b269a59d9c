"""Videos that are written: complete or not there, and what was put into them at its time."""

import resource
import signal

import av
import cv2
import numpy as np
import pytest

from panoptic_ros.errors import DataError, EnvironmentProblem, UsageError
from panoptic_ros.view.video_file import FINE, VideoAudio, VideoFile, codec

SIZE = (96, 64)


def picture(number, size=SIZE):
    """A smooth picture with a bright column that says its number."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    image = np.stack([2 * x % 200, 3 * y % 180, (x + y) % 160], axis=-1).astype(np.uint8)
    image[:, 4 * number : 4 * number + 4] = 255
    return image


def record(path, numbers=range(12), **more):
    with VideoFile(path, SIZE, 29.97002997, quality=FINE, **more) as video:
        for k, number in enumerate(numbers):
            video.write(picture(k), number)
            assert not path.exists()
    return path


def read(path):
    """Pictures, and when they are shown, in frames of 30000/1001 Hz."""
    with av.open(str(path)) as file:
        frames = list(file.decode(video=0))
    return [frame.to_ndarray(format="bgr24") for frame in frames], [
        float(frame.pts * frame.time_base * 30000 / 1001) for frame in frames
    ]


def test_pictures_come_back_at_their_times(tmp_path):
    path = record(tmp_path / "deep" / "a.mp4", [0, 1, 2, 5, 6, 20])
    pictures, times = read(path)
    assert times == [0, 1, 2, 5, 6, 20]
    assert min(cv2.PSNR(image, picture(k)) for k, image in enumerate(pictures)) > 30.0
    assert [file.name for file in path.parent.iterdir()] == ["a.mp4"]
    with av.open(str(path)) as file:
        assert file.streams.video[0].codec_context.name == "h264" and codec() == "libx264"
        assert file.streams.video[0].codec_context.pix_fmt == "yuv420p"  # what browsers play


def test_equal_pictures_give_equal_bytes(tmp_path):
    assert record(tmp_path / "a.mp4").read_bytes() == record(tmp_path / "b.mp4").read_bytes()


def test_without_an_encoder_for_h264_it_is_mpeg4(tmp_path, monkeypatch):
    monkeypatch.setattr(av, "codecs_available", {"mpeg4"})
    pictures, times = read(record(tmp_path / "a.mp4"))
    assert times == list(range(12)) and codec() == "mpeg4"
    assert min(cv2.PSNR(image, picture(k)) for k, image in enumerate(pictures)) > 30.0


@pytest.mark.parametrize(("name", "noise"), [("a.mp4", 0.02), ("a.mov", 1e-4)])
def test_sound_lies_beside_the_pictures(tmp_path, name, noise):
    seconds = np.arange(24_000) / 48_000
    samples = 0.5 * np.sin(2 * np.pi * np.outer(seconds, [440.0, 700.0]))
    path = record(tmp_path / name, sound=VideoAudio(samples, 48_000, 0.125))
    with av.open(str(path)) as file:
        frames = list(file.decode(audio=0))
    start = float(frames[0].pts * frames[0].time_base)
    stored = np.concatenate(
        [f.to_ndarray().T if f.format.is_planar else f.to_ndarray().reshape(-1, 2) for f in frames]
    )
    stored = stored / (1.0 if stored.dtype.kind == "f" else 32768.0)
    early = round((0.125 - start) * 48_000)  # AAC begins with what its filters need
    assert np.std(stored[early + 1000 :][:20_000] - samples[1000:21_000]) < noise


def test_what_fails_leaves_nothing(tmp_path):
    with pytest.raises(KeyboardInterrupt), VideoFile(tmp_path / "a.mp4", SIZE, 25.0) as video:
        video.write(picture(0))
        raise KeyboardInterrupt
    video = VideoFile(tmp_path / "a.mp4", SIZE, 25.0)  # no picture, no file
    video.close()
    video.close()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(UsageError, match="closed"):
        video.write(picture(0))


def test_a_full_disk_is_told(tmp_path):
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    noise = np.random.default_rng(0)
    try:
        with pytest.raises(EnvironmentProblem, match="cannot write .*a.mp4"):
            with VideoFile(tmp_path / "a.mp4", SIZE, 25.0) as video:
                for _ in range(40):
                    video.write(noise.integers(0, 256, (64, 96, 3), dtype=np.uint8))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, handler)
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises((EnvironmentProblem, DataError), match="cannot write"):
        VideoFile(tmp_path / "file" / "a.mp4", SIZE, 25.0)
    with pytest.raises(UsageError, match="even"):
        VideoFile(tmp_path / "a.mp4", (63, 48), 25.0)
    with pytest.raises(UsageError, match="at 0.0 Hz"):
        VideoFile(tmp_path / "a.mp4", SIZE, 0.0)
    with pytest.raises(UsageError, match=r"\.mp4"):
        VideoFile(tmp_path / "a.avi", SIZE, 25.0)
    with VideoFile(tmp_path / "a.mp4", SIZE, 25.0) as video:
        with pytest.raises(DataError, match="96x64"):
            video.write(picture(0, (64, 64)))
        video.write(picture(0), 3)
        with pytest.raises(DataError, match="picture 3 is not after the previous one"):
            video.write(picture(1), 3)
