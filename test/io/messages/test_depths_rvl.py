"""RVL against an encoder that is written down nibble by nibble, as its paper has it."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from panoptic_ros.errors import DataError
from panoptic_ros.io.messages import depth_from_message
from panoptic_ros.io.messages.depths import decode_rvl


def encode(pixels):
    nibbles = []

    def number(value):
        while True:
            nibble, value = value & 7, value >> 3
            nibbles.append(nibble | (8 if value else 0))
            if not value:
                return

    at, before = 0, 0
    while at < len(pixels):
        zeros = 0
        while at < len(pixels) and pixels[at] == 0:
            at, zeros = at + 1, zeros + 1
        number(zeros)
        end = at
        while end < len(pixels) and pixels[end]:
            end += 1
        number(end - at)
        for value in pixels[at:end]:
            delta, before = value - before, value
            number((delta << 1) ^ (delta >> 31))
        at = end
    nibbles += [0] * (-len(nibbles) % 8)
    rows = [nibbles[i : i + 8] for i in range(0, len(nibbles), 8)]
    words = [sum(nibble << (28 - 4 * k) for k, nibble in enumerate(row)) for row in rows]
    return struct.pack(f"<{len(words)}I", *words)


depth = st.one_of(st.just(0), st.integers(1, 65535), st.integers(1000, 1010))


@settings(max_examples=80, deadline=None)
@given(st.lists(depth, min_size=1, max_size=99))
def test_what_was_encoded_comes_back(pixels):
    assert decode_rvl(encode(pixels), len(pixels), "map").tolist() == pixels


@settings(max_examples=80, deadline=None)
@given(st.binary(max_size=80), st.integers(1, 300))
def test_any_bytes_are_refused_or_read(data, count):
    try:
        assert decode_rvl(data, count, "map").shape == (count,)
    except DataError as error:
        assert "map: its RVL data" in str(error)


def message(pixels, encoding="16UC1", size=(4, 3), a=0.0, b=0.0):
    data = struct.pack("<iff", 0, a, b) + struct.pack("<II", *size) + encode(pixels)
    return SimpleNamespace(format=f"{encoding}; compressedDepth rvl", data=data)


def test_depth_maps_in_millimetres_and_as_inverse_depths():
    millimetres = [0, 0, 1500, 1501, 1499, 0, 4000, 4000, 0, 0, 0, 65535]
    found = depth_from_message(message(millimetres), "left")
    assert found.shape == (3, 4) and np.allclose(found.reshape(-1), np.array(millimetres) / 1000)
    inverse = depth_from_message(message([0, *[200] * 11], "32FC1", a=300.0, b=50.0), "left")
    assert np.isnan(inverse[0, 0]) and np.allclose(inverse.reshape(-1)[1:], 2.0)


def test_broken_headers_are_refused():
    cut = message([1] * 12)
    with pytest.raises(DataError, match="4000000000 x 3 pixels"):
        depth_from_message(message([1] * 12, size=(4_000_000_000, 3)), "left")
    with pytest.raises(DataError, match="depth map of camera left: its RVL data"):
        depth_from_message(SimpleNamespace(format=cut.format, data=cut.data[:-4]), "left")
    with pytest.raises(DataError, match="no RVL"):
        depth_from_message(SimpleNamespace(format=cut.format, data=cut.data[:14]), "left")
