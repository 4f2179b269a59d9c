"""Live sound: what PortAudio hands over becomes blocks on this machine's clock; a file stands in for it."""

from types import SimpleNamespace

import numpy as np
import pytest

from panoptic_ros.capture.sound import described_sound, open_sound
from panoptic_ros.capture.sound.described import MicrophoneSource, SoundPlaybackSource
from panoptic_ros.errors import BackendError, EnvironmentProblem
from panoptic_ros.io.wav import write_wav

SECOND = 10**9
DEVICES = [
    {"index": 0, "name": "Speakers", "max_input_channels": 0, "default_samplerate": 48_000.0},
    {"index": 1, "name": "USB Line (hw:1,0)", "max_input_channels": 4, "default_samplerate": 48_000.0},
]


class PortAudio:
    """The part of sounddevice that is used."""

    class PortAudioError(Exception):
        pass

    def __init__(self, fails=""):
        self.fails, self.opened = fails, []

    def query_devices(self, device=None, kind=None):
        if device is None:
            return DEVICES
        found = [d for d in DEVICES if device in (d["index"], *[d["name"]] * (str(device) in d["name"]))]
        if not found and str(device) not in DEVICES[1]["name"]:
            raise ValueError(f"No input device matching {device!r}")
        return DEVICES[1]

    def InputStream(self, **options):  # noqa: N802 - PortAudio's name
        if self.fails:
            raise self.PortAudioError(self.fails)
        stream = SimpleNamespace(options=options, start=lambda: None, close=lambda: None)
        self.opened.append(stream)
        return stream


def played(library, blocks, lost=()):
    """Hand blocks over as PortAudio does: 7 ms late, and 5 ms more until Python has them."""
    for k, block in enumerate(blocks):
        library.opened[0].time = 5.0 + 0.1 * k
        times = SimpleNamespace(currentTime=5.0 + 0.1 * k - 0.005, inputBufferAdcTime=5.0 + 0.1 * k - 0.012)
        status = SimpleNamespace(input_overflow=True) if k in lost else None
        library.opened[0].options["callback"](block, len(block), times, status)


def test_blocks_are_stamped_with_the_instant_of_their_first_sample():
    library, now = PortAudio(), iter(range(100 * SECOND, 200 * SECOND, SECOND // 10))
    source = MicrophoneSource("mic", "hw:1", clocks=("A", "B"), clock=lambda: next(now), library=library)
    assert library.opened[0].options["channels"] == 2 and source.sample_rate == 48_000
    library.opened[0].options["callback"](np.ones((48_000, 2), np.float32), 48_000, None, None)  # not trusted
    samples = np.random.default_rng(0).uniform(-1.2, 1.2, (3, 4800, 2)).astype(np.float32)
    played(library, samples)
    blocks = [block for _, block in zip(range(3), source)]
    assert [b.stamp_ns for b in blocks] == [100 * SECOND + k * SECOND // 10 - 12_000_000 for k in range(3)]
    assert [b.first_sample for b in blocks] == [0, 4800, 9600] and blocks[0].clocks == ("A", "B")
    np.testing.assert_array_equal(blocks[1].samples, np.clip(samples[1], -1, 1))
    source.close()
    assert list(source) == []


def test_what_is_lost_shows_in_the_count_of_samples():
    library = PortAudio()
    source = MicrophoneSource("mic", "1", library=library)
    played(library, np.zeros((100, 480, 2), np.float32))  # the first second
    played(library, np.zeros((104, 480, 2), np.float32), lost=(3,))
    firsts = [block.first_sample for _, block in zip(range(100), source)]
    assert firsts[:4] == [0, 480, 960, 1920]  # an overflow
    played(library, np.zeros((1, 480, 2), np.float32))
    assert next(iter(source)).first_sample == 105 * 480  # the last ones found no room


def test_devices_that_are_not_there_or_do_not_open_are_told():
    with pytest.raises(BackendError, match=r"mic at hw:7: no such input; there are 1 USB Line \(hw:1,0\)$"):
        MicrophoneSource("mic", "hw:7", library=PortAudio())
    with pytest.raises(BackendError, match="has 4 channels; 5 clocks are named"):
        MicrophoneSource("mic", "1", clocks="ABCDE", library=PortAudio())
    with pytest.raises(BackendError, match="mic at 1 cannot be opened: Device unavailable"):
        MicrophoneSource("mic", "1", library=PortAudio("Device\nunavailable"))


@pytest.mark.parametrize(("error", "remedy"), [(ImportError, "pip install"), (OSError, "libportaudio2")])
def test_without_the_package_it_says_what_to_do(monkeypatch, error, remedy):
    def missing(name):
        raise error(name)

    monkeypatch.setattr("importlib.import_module", missing)
    with pytest.raises(EnvironmentProblem, match=f"microphones need .*{remedy}"):
        open_sound(described_sound("microphone", "mic", [], address="hw:1"))


def test_a_file_is_played_in_real_time(tmp_path):
    write_wav(tmp_path / "a.wav", 8000, np.zeros((2000, 2)))
    now, waited = [50 * SECOND], []

    def wait(seconds):
        waited.append(seconds)
        now[0] += round(seconds * SECOND)
        return False

    source = SoundPlaybackSource("mic", tmp_path / "a.wav", clocks=("A", ""), clock=lambda: now[0], wait=wait)
    blocks = list(source)
    assert [b.stamp_ns for b in blocks] == [50 * SECOND + k * SECOND // 10 for k in range(3)]
    assert waited == pytest.approx([0.1, 0.1, 0.05]) and blocks[0].clocks == ("A", "")
    assert isinstance(
        open_sound(described_sound("microphone", "m", [], address=str(tmp_path / "a.wav"))),
        SoundPlaybackSource,
    )
