"""A WAV file as what a device heard: its blocks, stamps and clocks."""

from itertools import pairwise

import numpy as np
import pytest
from scipy.io import wavfile

from panoptic_ros.capture.sound import SoundSource, WavSource, described_sound, open_sound
from panoptic_ros.errors import DataError, UsageError

RATE = 8000
SAMPLES = (np.random.default_rng(1).uniform(-0.9, 0.9, (RATE, 2)) * 32767).astype(np.int16)


@pytest.fixture
def file(tmp_path):
    wavfile.write(tmp_path / "mic.wav", RATE, SAMPLES)
    return tmp_path / "mic.wav"


def whole(source):
    """All samples, after a check that blocks follow each other."""
    blocks = list(source)
    assert all(b.first_sample == a.first_sample + len(a.samples) for a, b in pairwise(blocks))
    return blocks, np.concatenate([block.samples for block in blocks])


def test_all_channels_on_the_clock_of_the_sound_card(file):
    source = WavSource("mic", file, clocks=("A", "B"), start_ns=7)
    assert isinstance(source, SoundSource) and source.seconds == 1.0
    blocks, samples = whole(source)
    np.testing.assert_allclose(samples, SAMPLES / 32768.0, atol=1e-7)
    assert [b.stamp_ns for b in blocks] == [7 + b.first_sample * 10**9 // RATE for b in blocks]
    assert {b.clocks for b in blocks} == {("A", "B")} and max(len(b.samples) for b in blocks) == RATE // 10
    assert [b.stamp_ns for b in source] == [b.stamp_ns for b in blocks]  # as often as one likes


def test_stamps_of_samples_begin_blocks(file):
    rows = [(0, 10**9), (1000, 10**9 + 125_200_000), (5000, 10**9 + 625_100_000)]
    blocks, samples = whole(WavSource("mic", file, stamps=rows))
    np.testing.assert_allclose(samples, SAMPLES / 32768.0, atol=1e-7)
    stamps = {b.first_sample: b.stamp_ns for b in blocks}
    assert all(stamps[sample] == stamp for sample, stamp in rows)
    assert stamps[1800] == 10**9 + 225_200_000
    begun, _ = whole(WavSource("mic", file, stamps=rows, from_sample=1400))
    assert (begun[0].first_sample, begun[0].stamp_ns) == (1400, 10**9 + 175_200_000)


def test_24_bits_are_read_too(tmp_path):
    path = tmp_path / "deep.wav"
    data = b"".join(int(v).to_bytes(3, "little", signed=True) for v in (SAMPLES.astype(int) * 256).ravel())
    head = b"RIFF" + (36 + len(data)).to_bytes(4, "little") + b"WAVEfmt " + (16).to_bytes(4, "little")
    fields = (1, 2), (2, 2), (RATE, 4), (RATE * 6, 4), (6, 2), (24, 2)
    form = b"".join(number.to_bytes(size, "little") for number, size in fields)
    path.write_bytes(head + form + b"data" + len(data).to_bytes(4, "little") + data)
    np.testing.assert_allclose(whole(WavSource("deep", path))[1], SAMPLES / 32768.0, atol=1e-7)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"clocks": ["A"]}, "1 channels of .*mic.wav are named"),
        ({"stamps": [(0, 5), (0, 6)]}, "sample 0 at 6 ns is not after the previous row"),
        ({"stamps": [(0, 5), (9, 5)]}, "sample 9 at 5 ns is not after the previous row"),
        ({"stamps": [(0, 5), (1, 6), (2, 7)]}, "a frame is the index of the first sample"),
    ],
)
def test_what_does_not_fit_is_told(file, more, message):
    with pytest.raises(DataError, match=message):
        WavSource("mic", file, **more)


def test_descriptions(file, tmp_path):
    with open_sound(described_sound("wav", "mic", ["", "B"], path=str(file), start_ns=5)) as source:
        assert next(iter(source)).clocks == ("", "B")
    with pytest.raises(UsageError, match="sound of mic: there is no source of kind 'tape'"):
        open_sound(described_sound("tape", "mic", []))
    (tmp_path / "no.wav").write_text("nothing")
    with pytest.raises(DataError, match="not a WAV file"):
        open_sound(described_sound("wav", "mic", [], path=str(tmp_path / "no.wav")))
    with pytest.raises(DataError, match="absent"):
        open_sound(described_sound("wav", "mic", [], path=str(tmp_path / "absent.wav")))
