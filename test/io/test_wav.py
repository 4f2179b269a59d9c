"""WAV files of several kinds, and what is none."""

from __future__ import annotations

import struct
import tempfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import wavfile

from panoptic_ros.errors import DataError, UsageError
from panoptic_ros.io.wav import read_wav, write_wav

TONE = np.sin(np.arange(4000) / 7.0) * 0.8


@pytest.mark.parametrize(
    ("dtype", "scale", "offset", "within"),
    [
        (np.uint8, 127, 128, 0.02),
        (np.int16, 32767, 0, 1e-4),
        (np.int32, 2**31 - 1, 0, 1e-6),
        (np.float32, 1, 0, 1e-6),
        (np.float64, 1, 0, 1e-6),
    ],
)
def test_all_sample_formats(tmp_path: Path, dtype: type, scale: int, offset: int, within: float) -> None:
    values = (TONE * scale + offset).round(0 if scale > 1 else 9).astype(dtype)
    wavfile.write(tmp_path / "a.wav", 22050, values)
    rate, samples = read_wav(tmp_path / "a.wav")
    assert rate == 22050 and samples.dtype == np.float32
    np.testing.assert_allclose(samples, TONE, atol=within)


def test_channels(tmp_path: Path) -> None:
    write_wav(tmp_path / "a.wav", 48000, np.stack([TONE, -TONE], axis=1))
    np.testing.assert_allclose(read_wav(tmp_path / "a.wav", 1)[1], -TONE, atol=1e-4)
    with pytest.raises(UsageError, match="has 2 channels, counted from 0; there is no 2"):
        read_wav(tmp_path / "a.wav", 2)


@pytest.mark.parametrize("extensible", [False, True])
def test_24_bits_and_the_extensible_header(tmp_path: Path, extensible: bool) -> None:
    levels = np.round(np.stack([TONE, -TONE], axis=1) * 8388607).astype(np.int32)
    data = levels.astype("<i4").reshape(-1, 1).view(np.uint8)[:, :3].tobytes()
    form = struct.pack("<HHIIHH", 0xFFFE if extensible else 1, 2, 48000, 288000, 6, 24)
    if extensible:
        pcm = bytes.fromhex("0100000000001000800000aa00389b71")
        form += struct.pack("<HHI", 22, 24, 3) + pcm
    body = b"WAVE" + b"fmt " + struct.pack("<I", len(form)) + form
    body += b"LIST" + struct.pack("<I", 4) + b"INFO" + b"data" + struct.pack("<I", len(data)) + data
    (tmp_path / "a.wav").write_bytes(b"RIFF" + struct.pack("<I", len(body)) + body)
    rate, samples = read_wav(tmp_path / "a.wav", 1)
    assert rate == 48000
    np.testing.assert_allclose(samples, -TONE, atol=1e-6)


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 60), st.integers(0, 255), st.integers(0, 400))
def test_broken_headers_say_one_line(place: int, value: int, cut: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.wav"
        write_wav(path, 48000, TONE)
        content = bytearray(path.read_bytes())
        content[place] = value
        path.write_bytes(bytes(content[: len(content) - cut]))
        try:
            rate, samples = read_wav(path)
        except DataError as error:
            assert "\n" not in str(error)
        else:
            assert rate >= 0 and samples.dtype == np.float32


def test_loud_samples_are_clipped(tmp_path: Path) -> None:
    write_wav(tmp_path / "a.wav", 8000, np.array([2.0, -2.0, 0.5]))
    np.testing.assert_allclose(read_wav(tmp_path / "a.wav")[1], [1.0, -1.0, 0.5], atol=1e-4)


def test_what_is_no_wav_file(tmp_path: Path) -> None:
    path = tmp_path / "a.wav"
    with pytest.raises(DataError, match="No such file"):
        read_wav(path)
    write_wav(path, 48000, TONE)
    whole = path.read_bytes()
    for content in (b"", b"RIFF", b"hello world" * 10, whole[:20], whole[:38], b"\x00" * 200):
        path.write_bytes(content)
        with pytest.raises(DataError, match="not a WAV file|no samples"):
            read_wav(path)
    path.write_bytes(whole[:44])
    with pytest.raises(DataError):
        read_wav(path)
    wavfile.write(path, 8000, np.array([0.0, np.nan], np.float32))
    with pytest.raises(DataError, match="not finite"):
        read_wav(path)
